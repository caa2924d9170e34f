"""A planner around a policy that steers to a goal: it remembers what was met, and leads out of where the policy stays.

A policy that sees 4 m and steers to where the goal lies in a straight line turns for minutes where the way to it leads
away. What is known is what a real vehicle has: ranges, velocity log, tilt and the goal's bearing; neither the map nor
the current. While the vehicle comes to new places the policy sees the goal. Where it has come to none for STUCK, it
sees in the goal's place, and as if 10 m away, a place ahead on the way that `occupancy` finds, until it is nearer to
the goal than it ever was before (as TangentBug leaves a wall: Kamon, Rivlin and Rimon, IEEE ICRA 1996).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.observation import layout
from aquanav_tools.evaluate.occupancy import Occupancy
from aquanav_tools.evaluate.policy_kinds import Vectorised
from aquanav_tools.evaluate.reckoning import DeadReckoning, Fix
from aquanav_tools.sim.batch.sensors.fan_spec import echo_sounders
from aquanav_tools.sim.scales import DISTANCE_SCALE, soft
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.types import Array, IntArray, rotation_matrix

STUCK = 10.0
"""Time without a new place after which the planner leads, s. Chosen in mylna rura and a maze of the generator."""
NEW_PLACE = 0.5
"""A place is new farther than this from all before, m."""
NEARER = 1.0
"""It leads until the goal is nearer than before by this, m."""
PLAN_EVERY = 1.0
"""Time between two plans, s."""
AHEAD = 14
"""Cells of the way ahead that are looked along for the farthest that is in sight: 4.2 m, as far as rays reach."""
LEAST_AHEAD = 3
"""Cells ahead that the policy is led to where less is in sight."""
SHOWN = 10.0
"""Distance at which a place ahead is shown, m: farther than the policy slows down for."""
NO_ECHO = 1.0 - 1e-3
"""Share of a ray's reach from which it met nothing."""
ECHO_SOUNDERS = "echosounders"


class Planner:
    """Follows one vehicle through an episode."""

    def __init__(self, seconds: float, directions: Array) -> None:
        self._seconds, self._directions = seconds, directions
        self._reckoning = DeadReckoning(seconds)
        self._places = np.zeros((0, 3))
        self._occupancy: Occupancy | None = None
        self._way: Array | None = None
        self._since_new = self._since_plan = self._nearest = 0.0
        self.is_leading = False

    def __call__(self, read: dict[str, Array], ranges: Array, has_echo: npt.NDArray[np.bool_]) -> Array | None:
        """Return azimuth and elevation, rad, of the place to steer to, as `goal` has them; None for the goal itself.

        Args:
            read: The slices of the observation "full" by their names.
            ranges: (R,) of the rays, m.
            has_echo: (R,) whether each met a wall.
        """
        fix = self._reckoning(read)
        if self._occupancy is None:
            self._occupancy = Occupancy(fix.position, self._reckoning.goal, self._directions)
            self._nearest = float(np.linalg.norm(self._reckoning.goal))
        turned = rotation_matrix(fix.quaternion)
        self._occupancy.see(fix.position, fix.position + ranges[:, None] * (self._directions @ turned.T), has_echo)
        self._judge(fix)
        point = self._ahead(self._occupancy, fix) if self.is_leading else None
        if point is None:
            return None
        offset = point - fix.position
        azimuth = (np.arctan2(offset[1], offset[0]) - fix.yaw + np.pi) % (2.0 * np.pi) - np.pi
        return np.array([azimuth, np.arctan2(offset[2], np.hypot(offset[0], offset[1]))])

    def _judge(self, fix: Fix) -> None:
        """Tell whether the vehicle is to be led."""
        self._since_new += self._seconds
        if not (((self._places - fix.position) ** 2).sum(axis=1) < NEW_PLACE**2).any():
            self._places, self._since_new = np.vstack([self._places, fix.position]), 0.0
        distance = float(np.linalg.norm(fix.position - self._reckoning.goal))
        if self.is_leading:
            self.is_leading = distance > self._nearest - NEARER
        elif self._since_new >= STUCK:
            self.is_leading, self._way = True, None
        if not self.is_leading:
            self._nearest = min(self._nearest, distance)

    def _ahead(self, occupancy: Occupancy, fix: Fix) -> Array | None:
        """Return the farthest place on the way that is in sight; None where that is the goal, or there is no way."""
        self._since_plan += self._seconds
        if self._way is None or self._since_plan >= PLAN_EVERY:
            self._way, self._since_plan = occupancy.way(fix.position), 0.0
        if self._way is None:
            return None
        way, last = self._way, len(self._way) - 1
        here = int(((way - fix.position) ** 2).sum(axis=1).argmin())
        ahead = min(here + LEAST_AHEAD, last)
        for place in range(here + 1, min(here + AHEAD, last) + 1):
            if occupancy.is_clear(fix.position, way[place]):
                ahead = max(ahead, place)
            elif place > here + LEAST_AHEAD:
                break
        return None if ahead == last else way[ahead]


class PlannedPolicy:
    """Observes what the policy inside does, "full" and perhaps sensors behind it; hands it on with another goal."""

    def __init__(self, inner: Vectorised, sensors: tuple[str, ...]) -> None:
        """Wrap a policy that observes "full" and sensors behind it; echo sounders are used where they come first."""
        self._inner = inner
        self._parts = layout("full")
        self._end = max(part.stop for part in self._parts.values())
        pattern, sounders = original_pattern(), echo_sounders().pattern
        self._lengths, self._num_sounders, directions = pattern.lengths, 0, pattern.directions
        if sensors[:1] == (ECHO_SOUNDERS,):
            self._reach, self._num_sounders = sounders.lengths, len(sounders.lengths)
            directions = np.concatenate([directions, sounders.directions])
        self._directions = directions
        self._seconds = 0.0
        self._planners: dict[int, Planner] = {}
        self._last: dict[int, tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]] = {}

    def bind(self, env: Any) -> None:
        """Learn how long a decision takes, and nothing of the cave."""
        self._seconds = float(env.decision_seconds)

    def within(self, batch: Any) -> PlannedPolicy:
        """Learn how long a decision of a batch takes."""
        self._seconds = float(batch.decision_seconds)
        return self

    def reset(self, seed: int) -> None:
        """Forget the last episode's walls."""
        self._inner.reset(seed)
        self._planners, self._last = {}, {}

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return the action for one observation, (O,)."""
        return self.decide(self.logits(np.asarray(observation)[None], np.zeros(1, dtype=np.int64))[0])

    def decide(self, logits: npt.NDArray[np.float32]) -> Any:
        """Return the action that a row stands for."""
        return self._inner.decide(logits)

    def logits(self, observations: npt.NDArray[np.float32], slots: IntArray) -> npt.NDArray[np.float32]:
        """Return what the policy makes of (N, O) observations with the goals that the vehicles are led to."""
        rows = np.stack([self._led(row, slot) for row, slot in zip(observations, slots.tolist(), strict=True)])
        return self._inner.logits(rows, slots)

    def _led(self, row: npt.NDArray[np.float32], slot: int) -> npt.NDArray[np.float32]:
        """Return an observation with the goal that its vehicle is led to; asked again, the same."""
        if slot in self._last and np.array_equal(self._last[slot][0], row):
            return self._last[slot][1]
        planner = self._planners.setdefault(slot, Planner(self._seconds, self._directions))
        read = {name: row[part].astype(np.float64) for name, part in self._parts.items()}
        ranges, has_echo = read["rays"] * self._lengths, read["rays"] < NO_ECHO
        if self._num_sounders:
            sounded = row[self._end : self._end + self._num_sounders].astype(np.float64)
            ranges = np.concatenate([ranges, sounded])
            has_echo = np.concatenate([has_echo, sounded < NO_ECHO * self._reach])
        angles, led = planner(read, ranges, has_echo), row.copy()
        if angles is not None:
            led[self._parts["goal"]] = soft(SHOWN, DISTANCE_SCALE), angles[0] / np.pi, angles[1] / (0.5 * np.pi)
        self._last[slot] = row.copy(), led
        return led
