"""A planner around a policy that steers to a goal: it remembers what was met, and leads out of where the policy stays.

A policy that sees 4 m and steers to where the goal lies in a straight line turns for minutes where the way to it leads
away. What is known is what a real vehicle has: ranges, velocity log, tilt and the goal's bearing; neither the map nor
the current. While the vehicle comes to new places the policy sees the goal. Where it has come to none for STUCK, it
sees in the goal's place, and as if 10 m away, a place ahead on the way that `sim.way` finds, until it is nearer to
the goal than it ever was before (as TangentBug leaves a wall: Kamon, Rivlin and Rimon, IEEE ICRA 1996).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.observation import layout
from aquanav_tools.evaluate.policy_kinds import Vectorised
from aquanav_tools.evaluate.reckoning import DeadReckoning, Fix
from aquanav_tools.sim import occupancy, way
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
SHOWN = 10.0
"""Distance at which a place ahead is shown, m: farther than the policy slows down for."""
ECHO_SOUNDERS = "echosounders"


class Planner:
    """Follows one vehicle through an episode."""

    def __init__(self, seconds: float, directions: Array, reaches: Array) -> None:
        """Prepare for decisions of so many seconds and (R, 3) rays, unit vectors in the body, with (R,) reaches, m."""
        self._seconds, self._directions, self._reaches = seconds, directions, reaches
        self._reckoning = DeadReckoning(seconds)
        self._places = np.zeros((0, 3))
        self._maps, self._search = occupancy.make_maps(1), way.make_search()
        self._since_new = self._since_plan = self._nearest = 0.0
        self.is_leading = False

    def __call__(self, read: dict[str, Array], ranges: Array) -> Array | None:
        """Return azimuth and elevation, rad, of the place to steer to, as `goal` has them; None for the goal itself.

        Args:
            read: The slices of the observation "full" by their names.
            ranges: (R,) of the rays, m.
        """
        fix = self._reckoning(read)
        if not len(self._places):
            occupancy.begin(self._maps, 0, fix.position, self._reckoning.goal, fix.yaw)
            self._nearest = float(np.linalg.norm(self._reckoning.goal))
        occupancy.be_at(self._maps, 0, fix.position)
        rays = self._directions @ rotation_matrix(fix.quaternion).T
        occupancy.see(self._maps, 0, fix.position, rays, ranges, self._reaches)
        self._judge(fix)
        point = self._ahead(fix) if self.is_leading else None
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
            self.is_leading, self._since_plan = True, way.PLAN_EVERY
        if not self.is_leading:
            self._nearest = min(self._nearest, distance)

    def _ahead(self, fix: Fix) -> Array | None:
        """Return the farthest place on the way that is in sight; None where that is the goal, or there is no way."""
        self._since_plan += self._seconds
        if self._since_plan >= way.PLAN_EVERY:
            self._since_plan = 0.0
            way.plan(self._maps, self._search, 0, fix.position, self._reckoning.goal)
        _, ahead, _ = way.look_along(self._maps, 0, fix.position)
        is_goal = ahead == self._maps.lengths[0, 1]
        place: Array | None = None if ahead < 0 or is_goal else way.middle(self._maps, 0, ahead)
        return place


class PlannedPolicy:
    """Observes what the policy inside does, "full" and perhaps sensors behind it; hands it on with another goal."""

    def __init__(self, inner: Vectorised, sensors: tuple[str, ...]) -> None:
        """Wrap a policy that observes "full" and sensors behind it; echo sounders are used where they come first."""
        self._inner = inner
        self._parts = layout("full")
        self._end = max(part.stop for part in self._parts.values())
        pattern, sounders = original_pattern(), echo_sounders().pattern
        self._directions, self._reaches = pattern.directions, pattern.lengths
        self._num_rays = len(pattern.lengths)
        if sensors[:1] == (ECHO_SOUNDERS,):
            self._directions = np.concatenate([pattern.directions, sounders.directions])
            self._reaches = np.concatenate([pattern.lengths, sounders.lengths])
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
        planner = self._planners.setdefault(slot, Planner(self._seconds, self._directions, self._reaches))
        read = {name: row[part].astype(np.float64) for name, part in self._parts.items()}
        sounded = row[self._end : self._end + len(self._reaches) - self._num_rays].astype(np.float64)
        ranges = np.concatenate([read["rays"] * self._reaches[: self._num_rays], sounded])
        angles, led = planner(read, ranges), row.copy()
        if angles is not None:
            led[self._parts["goal"]] = soft(SHOWN, DISTANCE_SCALE), angles[0] / np.pi, angles[1] / (0.5 * np.pi)
        self._last[slot] = row.copy(), led
        return led
