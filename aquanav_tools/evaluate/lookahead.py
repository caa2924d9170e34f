"""Where commands would take a vehicle in free water, by its own equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numba
import numpy as np

from aquanav_tools.envs.action import IDLE, NUM_CHOICES, Command
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.sim.actuators import actuator_model
from aquanav_tools.sim.motion import advance
from aquanav_tools.types import Array, IntArray

CHOICES = tuple(
    Command(1.0 - ballast, 1.0 - steer, thrust - 1.0)
    for ballast, steer, thrust in product(range(NUM_CHOICES), repeat=3)
)
"""The 27 commands of the multidiscrete form, in the order of the discrete one."""


class Lookahead:
    """The motion of an environment's vehicle, from any state and trim."""

    def __init__(self, env: CaveEnv) -> None:
        limits = env.scenario.settings.limits
        self.dt = limits.dt * limits.substeps
        """Of a decision, s."""
        self._step = limits.dt
        self._actuators = actuator_model(env.vehicle, limits.dt, limits.substeps)
        self._parameters = env.vehicle.motion_parameters(env.scenario.settings.water.density).packed()
        self.after(env.state, 0.0, IDLE, env.water_velocity)  # compiles now, not while a first action is timed

    def after(self, state: Array, trim: float, command: Sequence[float], current: Array) -> tuple[Array, float]:
        """Return state and trim after one decision in water of one (3,) velocity, world frame, m/s."""
        self._actuators.set_trim(trim)
        wrenches = self._actuators.apply(*command)
        return _swim(state, wrenches, current, self._parameters, self._step), self._actuators.trim


def choices_of(command: Command) -> IntArray:
    """Return the multidiscrete action [ballast, steer, thrust] of one of CHOICES."""
    return np.array([1 - command.ballast, 1 - command.steer, 1 + command.thrust]).astype(np.int64)


@numba.njit(cache=True)
def _swim(state, wrenches, current, parameters, dt):  # type: ignore[no-untyped-def]
    for n in range(len(wrenches)):
        state = advance(state, wrenches[n], current, parameters, dt)
    return state
