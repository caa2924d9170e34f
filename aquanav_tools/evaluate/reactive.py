"""A hand-written policy without learning, memory or map: the bar that a trained policy has to clear.

Steering goes for the heading that is open, towards the goal and straight on, and away from the nearer side wall.
Thrust keeps a speed from which there is room to stop. Ballast keeps the middle between floor and roof, and follows the
goal's elevation where both are far. Its numbers were chosen in the demo caves and a scanned cave; the tests hold it to
reaching the goal without a collision.
"""

from __future__ import annotations

from math import cos

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.observation import layout
from aquanav_tools.sim.scales import RATE_SCALE, SPEED_SCALE, unsoft
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.types import Array, BoolArray

UP, KEEP_TRIM, DOWN = 0, 1, 2
LEFT, STRAIGHT, RIGHT = 0, 1, 2
REVERSE, STOP, AHEAD = 0, 1, 2

STEEP = np.radians(30.0)
"""Rays above or below this elevation look at roof and floor, the others along the passage."""
HEADINGS = np.radians(np.arange(-90.0, 91.0, 5.0))
"""Azimuths it can choose, left positive."""
GOAL_WEIGHT, STRAIGHT_WEIGHT = 0.35, 0.3
"""Worth of the goal's direction and of straight on, against 1 for a heading that is open as far as a ray reaches."""
CENTRING = 0.6
"""Turn from the nearer side wall when it touches, rad."""
LOOKAHEAD_S = 0.25
"""The rate of turn is taken to go on for so long; damps the steering."""
STEER_DEADBAND = np.radians(5.0)
SLOWEST, FASTEST = 0.15, 0.8
"""Range of the speed it keeps, m/s."""
STOPPING_DISTANCE, SPEED_PER_METRE = 0.6, 0.5
"""It keeps its slowest speed from this distance to a wall ahead; beyond, so much more per metre, 1/s."""
OVERSPEED = 0.25
"""It reverses when faster than it wants by this much, m/s."""
CLIMB_PER_METRE, FASTEST_CLIMB = 0.6, 0.3
"""Vertical speed per metre off the middle, 1/s, and its limit, m/s."""
FAR = 1.5
"""Above this distance to roof and floor along the steep rays the goal's elevation counts instead, m."""
TRIM_PER_SPEED, TRIM_DEADBAND = 3.0, 0.08


class ReactivePolicy:
    """Acts on the observation preset "full" with multidiscrete actions."""

    def __init__(self) -> None:
        pattern = original_pattern()
        elevation = np.arcsin(pattern.directions[:, 2])
        azimuth = np.arctan2(pattern.directions[:, 1], pattern.directions[:, 0])
        self._lengths = pattern.lengths
        self._roof, self._floor = elevation > STEEP, elevation < -STEEP
        self._fans = _level_fans(azimuth, np.abs(elevation) < STEEP)
        azimuths = azimuth[self._fans[0]]
        self._is_ahead = np.abs(azimuths) < STEEP
        self._between = _interpolation(HEADINGS, azimuths)
        self._straight_worth = STRAIGHT_WEIGHT * np.cos(HEADINGS)
        self._reach = self._lengths.max()
        self._parts = layout("full")

    def reset(self, seed: int) -> None:
        """Do nothing: it keeps no state and draws no random numbers."""

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return [ballast, steer, thrust] for one observation."""
        # Plain numbers where one is enough: NumPy's calls on scalars take most of a decision's time.
        seen, parts = observation.astype(np.float64), self._parts
        distances = seen[parts["rays"]] * self._lengths
        level = distances[self._fans].min(axis=0)
        goal, velocity = seen[parts["goal"]].tolist(), unsoft(seen[parts["velocity"]], SPEED_SCALE).tolist()
        heading = self._choose_heading(level, goal[1] * np.pi)
        steer = _steer(heading, float(unsoft(seen[parts["rates"]][2], RATE_SCALE)))
        thrust = _thrust(heading, float(level[self._is_ahead].min()), velocity[0])
        roof, floor = float(distances[self._roof].min()), float(distances[self._floor].min())
        ballast = _ballast(roof, floor, goal[2], velocity[2], float(seen[parts["trim"]][0]))
        return np.array([ballast, steer, thrust])

    def _choose_heading(self, level: Array, goal_azimuth: float) -> float:
        """Return the azimuth to turn to, rad, from the distances along the passage, from right to left."""
        below, part = self._between
        openness = (level[below] + part * (level[below + 1] - level[below])) / self._reach
        worth = openness + GOAL_WEIGHT * np.cos(HEADINGS - goal_azimuth) + self._straight_worth
        outer = level.tolist()
        right, left = min(outer[:2]), min(outer[-2:])
        away = CENTRING * (left - right) / max(left + right, 1e-9)
        return float(HEADINGS[np.argmax(worth)] + away)


def _level_fans(azimuth: Array, is_level: BoolArray) -> npt.NDArray[np.int64]:
    """Return the (2, 9) indices of the rays along the passage, a row per fan, from right to left."""
    rays = np.flatnonzero(is_level).reshape(2, -1)
    return rays[:, np.argsort(azimuth[rays[0]])]


def _interpolation(places: Array, known: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Return below which known place, and at what share of the way to the next, each place lies; ends go on level."""
    below = np.clip(np.searchsorted(known, places, side="right") - 1, 0, len(known) - 2)
    return below, np.clip((places - known[below]) / (known[below + 1] - known[below]), 0.0, 1.0)


def _steer(heading: float, rate: float) -> int:
    error = heading - LOOKAHEAD_S * rate
    if abs(error) <= STEER_DEADBAND:
        return STRAIGHT
    return LEFT if error > 0.0 else RIGHT


def _thrust(heading: float, ahead: float, speed: float) -> int:
    wanted = _within(SPEED_PER_METRE * (ahead - STOPPING_DISTANCE), SLOWEST, FASTEST) * max(cos(heading), 0.2)
    if speed < wanted:
        return AHEAD
    return REVERSE if speed > wanted + OVERSPEED else STOP


def _within(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def _ballast(roof: float, floor: float, goal_elevation: float, climb: float, trim: float) -> int:
    """Return the choice of ballast; `goal_elevation` is scaled to [-1, 1], `climb` in m/s, `trim` in [-1, 1]."""
    off_middle = 2.0 * goal_elevation if min(roof, floor) > FAR else 0.5 * (roof - floor)
    wanted_climb = _within(CLIMB_PER_METRE * off_middle, -FASTEST_CLIMB, FASTEST_CLIMB)
    wanted_trim = _within(TRIM_PER_SPEED * (wanted_climb - climb), -1.0, 1.0)
    if abs(wanted_trim - trim) <= TRIM_DEADBAND:
        return KEEP_TRIM
    return UP if wanted_trim > trim else DOWN
