"""From a command to what the vehicle's motion takes: ballast, steer and thrust."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numba
import numpy as np

from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array

SURGE, HEAVE, YAW = 0, 2, 5


class ActuatorModel(ABC):
    """The vehicle's actuators with their one state, the trim."""

    def __init__(self, substeps: int) -> None:
        self._commands = np.zeros((substeps, 6))

    @property
    @abstractmethod
    def trim(self) -> float:
        """In [-1, 1]: 0 floats, 1 is full buoyancy up."""

    @abstractmethod
    def set_trim(self, trim: float) -> None:
        """Bring the ballast to a trim in [-1, 1] at once: for looking ahead from a state that was measured."""

    @abstractmethod
    def reset(self) -> None:
        """Trim to neutral."""

    @abstractmethod
    def apply(self, ballast: float, steer: float, thrust: float) -> Array:
        """Hold a command for all substeps of a decision.

        Args:
            ballast: -1 (let the trim sink) to 1 (let it rise).
            steer: -1 (right) to 1 (left).
            thrust: -1 (reverse) to 1 (ahead).

        Returns:
            (substeps, 6) for `motion.advance`; valid until the next call.
        """


def actuator_model(vehicle: Vehicle, dt: float, substeps: int) -> ActuatorModel:
    """Return the actuators of a vehicle, for decisions of `substeps` steps of `dt` (s)."""
    if isinstance(vehicle, FossenVehicle):
        return WrenchActuators(vehicle, dt, substeps)
    if isinstance(vehicle, OriginalVehicle):
        return OriginalActuators(vehicle, dt, substeps)
    raise TypeError(f"No actuators are known for a {type(vehicle).__name__}.")


class WrenchActuators(ActuatorModel):
    """Asks for a wrench in the body frame, N and N m.

    Ballast moves the trim at a rate and leaves it where it is when nothing is commanded; steer asks the autopilot for
    a rate of turn; thrust pushes ahead, or in reverse with a share of the force.
    """

    def __init__(self, vehicle: FossenVehicle, dt: float, substeps: int) -> None:
        super().__init__(substeps)
        self._trim = 0.0
        self._actuators = vehicle.actuators
        self._yaw_moment = vehicle.full_steer
        self._trim_step = vehicle.actuators.trim_rate * dt

    @property
    def trim(self) -> float:
        """In [-1, 1]: 0 floats, 1 is full buoyancy up."""
        return self._trim

    def set_trim(self, trim: float) -> None:
        """Bring the ballast to a trim at once."""
        self._trim = trim

    def reset(self) -> None:
        """Trim to neutral."""
        self._trim = 0.0

    def apply(self, ballast: float, steer: float, thrust: float) -> Array:
        """Return the (substeps, 6) wrench of a held command, body frame, N and N m."""
        actuators = self._actuators
        surge = actuators.surge_force * (thrust if thrust > 0.0 else thrust * actuators.reverse_share)
        step, force = ballast * self._trim_step, actuators.heave_force
        self._trim = _hold(self._commands, surge, steer * self._yaw_moment, self._trim, step, -1.0, 1.0, force)
        return self._commands


class OriginalActuators(ActuatorModel):
    """Sets thrust (N), moment (N m) and the floaters' power (N/m, in the place of heave) as the original does."""

    def __init__(self, vehicle: OriginalVehicle, dt: float, substeps: int) -> None:
        super().__init__(substeps)
        self._drive = vehicle.drive
        self._ballast = vehicle.ballast
        self._power = 0.0
        self._power_step = 0.0 if vehicle.ballast is None else vehicle.ballast.power_rate * dt
        self.reset()

    @property
    def trim(self) -> float:
        """In [-1, 1]: 0 is the power at the start, 1 and -1 are the most and the least."""
        if self._ballast is None:
            return 0.0
        neutral = self._ballast.power
        limit = self._ballast.max_power if self._power > neutral else self._ballast.min_power
        return (self._power - neutral) / abs(limit - neutral)

    def set_trim(self, trim: float) -> None:
        """Bring the ballast's power to a trim at once."""
        if self._ballast is not None:
            neutral = self._ballast.power
            limit = self._ballast.max_power if trim > 0.0 else self._ballast.min_power
            self._power = neutral + trim * abs(limit - neutral)

    def reset(self) -> None:
        """Set the power to the start's."""
        self._power = 0.0 if self._ballast is None else self._ballast.power

    def apply(self, ballast: float, steer: float, thrust: float) -> Array:
        """Return the (substeps, 6) thrust, power and moment of a held command."""
        drive = self._drive
        surge = drive.force * (thrust if thrust > 0.0 else thrust * drive.reverse_share)
        moment = drive.steer_moment * (steer if drive.steers_at_rest else steer * thrust)
        low, high = (0.0, 0.0) if self._ballast is None else (self._ballast.min_power, self._ballast.max_power)
        step = ballast * self._power_step
        self._power = _hold(self._commands, surge, moment, self._power, step, low, high, 1.0)
        return self._commands


@numba.njit(cache=True)
def _hold(commands, surge, moment, level, step, low, high, heave_per_level):  # type: ignore[no-untyped-def]
    """Write one row per physics step, in which the level of the ballast goes on by `step`; return its last."""
    for row in range(len(commands)):
        level = min(max(level + step, low), high)
        commands[row, SURGE], commands[row, YAW], commands[row, HEAVE] = surge, moment, heave_per_level * level
    return level
