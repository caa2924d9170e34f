"""A safety shield around any policy: of the action that it chooses, the nearest one that is safe is taken.

What is known is what a real vehicle has: the 28 ranges, the velocity log, the gyroscope, the tilt and its own
software's trim and equations of motion; neither the map nor the current. Rule: before each decision the vehicle is
run ahead through the chosen action and then a full stop. The action is safe where on all of this the hull keeps
MARGIN from every wall that the rays have met lately, or, where it is nearer already, comes no nearer and ends farther
away. If it is not, the safe action that differs least takes its place; if none is, the one that ends farthest away.

Source of the rule: a predictive safety filter whose backup is to stop (Wabersich and Zeilinger, A predictive safety
filter for learning-based control of constrained nonlinear dynamical systems, Automatica 129, 2021). It promises
nothing: between rays, behind the vehicle and in a current it sees less than there is. Evaluations count what it does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import ActionModel, choices_of
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.observation import layout
from aquanav_tools.evaluate.lookahead import CHOICES, predictor_of
from aquanav_tools.evaluate.reckoning import DeadReckoning
from aquanav_tools.sim.batch.stopping import Stopping
from aquanav_tools.sim.command import Command
from aquanav_tools.sim.scales import RATE_SCALE, SPEED_SCALE, unsoft
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.types import Array, BoolArray, Pose, rotation_matrix, yaw_quaternion

CAVEAT = (
    "The shield helps policies that collide often and harms careful ones. It takes at least nine in ten collisions off "
    "random actions, and a third to a half off policies of the paper's curriculum in strong current; but the reference "
    "policy collided more with it, 2.64 and 1.94 instead of 1.56 and 1.21 times per 100 m in two caves in full "
    "current, at two to four times the computing time. Evaluate the policy without it as well."
)
"""Measured in the test caves and in two fresh caves of the generator."""
MARGIN = 0.15
"""Room that is kept between hull and wall, m: about the hull's radius; chosen, see test_shield."""
STOP_DECISIONS = 30
"""Longest full stop that is run ahead; the ballast alone takes 2 s from full up to full down."""
MEMORY = 20
"""Decisions for which walls are remembered: 2 s, in which a BlueROV2 swims a few of its lengths."""
NEAR = 2.5
"""Walls beyond this distance do not matter, m: no vehicle here needs as much to stop."""
STEEP = np.radians(30.0)
"""Rays above this elevation tell of roof and floor, which are taken to go on level above and below the vehicle."""
NO_ECHO = 1.0 - 1e-3
"""Share of a ray's length from which it met nothing."""
STILL = 0.05
"""Speed that counts as stopped, m/s."""
SLACK = 1e-4
"""A vehicle beside a wall may come nearer by this, m: less is no motion."""
GAIN = 1e-3
"""It must end farther away by this, m: merely not nearer by rays that miss what is between them, it would creep on."""


class ShieldedPolicy:
    """Observes "full", and behind it what the policy inside does; hands that what it was made for."""

    def __init__(self, inner: Any, observation: str, action: str) -> None:
        self._inner, self._form = inner, action
        # "paper" is the beginning of "full"; sensors and earlier decisions stand behind it.
        self._size = None if observation == "full" else max(part.stop for part in layout(observation).values())
        self._command = ActionModel(action).command
        self._parts = layout("full")
        pattern = original_pattern()
        self._directions, self._lengths = pattern.directions, pattern.lengths
        self._steep = np.abs(np.arcsin(pattern.directions[:, 2])) > STEEP
        self.interventions = 0
        """Decisions of this episode in which it took another action than the policy's."""

    def bind(self, env: CaveEnv) -> None:
        """Learn the vehicle's own equations and size, and nothing of the cave."""
        limits = env.scenario.settings.limits
        predictor, most_walls = predictor_of(env, has_map=False), MEMORY * (len(self._lengths) + 2)
        self._stopping = Stopping(predictor, most_walls, STOP_DECISIONS, STILL)
        # Compiles now, not while a first action is timed.
        self._stopping.foresee(env.state, 0.0, np.zeros((1, 3)), np.zeros((0, 3)))
        self._vehicle = env.vehicle
        self._reckoning = DeadReckoning(limits.dt * limits.substeps)
        half = 0.5 * env.vehicle.capsule.axis_length
        self._axis = np.array([-half, 0.0, half])
        self._radius = env.vehicle.capsule.radius
        if hasattr(self._inner, "bind"):
            self._inner.bind(env)

    def reset(self, seed: int) -> None:
        """Forget the walls of the last episode."""
        self._inner.reset(seed)
        self.interventions = 0
        self._reckoning.reset()
        self._walls: deque[Array] = deque(maxlen=MEMORY)

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return the policy's action, or the safe one nearest to it."""
        action = self._inner.act(observation[: self._size])
        wanted = self._command(action)
        read = {name: observation[part].astype(np.float64) for name, part in self._parts.items()}
        state, trim = self._estimate(read), float(read["trim"][0])
        walls = self._remember(read["rays"], state)
        now = self._room(state, walls)
        enough, end = (MARGIN, MARGIN) if now >= MARGIN else (now - SLACK, now + GAIN)

        def foresee(commands: Sequence[Command]) -> tuple[BoolArray, Array]:
            least, last = self._stopping.foresee(state, trim, np.array(commands), walls)
            return (least >= enough) & (last >= end), last

        if foresee([wanted])[0][0]:
            return action
        self.interventions += 1
        return self._as_action(_nearest_safe(wanted, foresee))

    def _room(self, state: Array, walls: Array) -> float:
        if not len(walls):
            return np.inf
        middles = state[:3] + self._axis[:, None] * rotation_matrix(state[3:7])[:, 0]
        return float(np.sqrt(((walls[None] - middles[:, None]) ** 2).sum(axis=2).min())) - self._radius

    def _estimate(self, read: dict[str, Array]) -> Array:
        """Return the state in a frame that begins where the episode did, dead-reckoned."""
        fix = self._reckoning(read)
        state = self._vehicle.state_at(Pose(fix.position, yaw_quaternion(fix.yaw)))
        state[3:7] = fix.quaternion
        state[7:10], state[10:13] = unsoft(read["velocity"], SPEED_SCALE), unsoft(read["rates"], RATE_SCALE)
        return state

    def _remember(self, shares: Array, state: Array) -> Array:
        """Return the (N, 3) points of wall that the rays met now and lately."""
        has_echo = shares < NO_ECHO
        hits = (shares * self._lengths)[:, None] * self._directions @ rotation_matrix(state[3:7]).T
        heights = hits[self._steep & has_echo, 2]
        lids = [float(heights[heights > 0].min(initial=np.inf)), float(heights[heights < 0].max(initial=-np.inf))]
        level = np.array([(0.0, 0.0, height) for height in lids if np.isfinite(height)]).reshape(-1, 3)
        self._walls.append(state[:3] + np.concatenate([hits[has_echo], level]))
        walls = np.concatenate(self._walls)
        return walls[((walls - state[:3]) ** 2).sum(axis=1) < NEAR**2]

    def _as_action(self, command: Command) -> Any:
        if self._form == "continuous":
            return np.array(command, dtype=np.float32)
        choices = choices_of(command)
        return choices if self._form == "multidiscrete" else int(choices @ (9, 3, 1))


def _nearest_safe(wanted: Command, foresee: Callable[[Sequence[Command]], tuple[BoolArray, Array]]) -> Command:
    """Return the safe command that differs least from a wanted one, or the one that ends farthest from the walls."""
    order = sorted(CHOICES, key=lambda command: sum(abs(a - b) for a, b in zip(command, wanted, strict=True)))
    is_safe, last = foresee(order)
    return order[int(is_safe.argmax() if is_safe.any() else last.argmax())]
