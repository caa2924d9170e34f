"""Where a vehicle is, by dead reckoning from what it observes ("full"), with the goal for a compass.

The velocity log tells how far it moves, the accelerometers how it is tilted. No compass is observed, and a gyroscope
that is read once per decision is off by 15 to 30 degrees after a few turns. But the goal stands still: its bearing
tells the heading, its distance and elevation hold the place: to 0.1 m after four minutes in a real cave.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aquanav_tools.sim.scales import DISTANCE_SCALE, RATE_SCALE, SPEED_SCALE, unsoft
from aquanav_tools.types import Array, rotation_matrix

NEAR_GOAL = 1.0
"""Level distance below which the goal's bearing swings too fast to be a compass, m; the gyroscope takes its place."""


@dataclass(frozen=True)
class Fix:
    """Where it is, in a level frame with z up that begins where the episode did, x along the bow."""

    position: Array
    """(3,) m."""
    yaw: float
    """rad, from x towards y."""
    quaternion: Array
    """(4,) w, x, y, z: from the body to the frame."""


class DeadReckoning:
    """Follows a vehicle through an episode."""

    def __init__(self, seconds: float) -> None:
        """Begin an episode; a decision takes so many seconds."""
        self._seconds = seconds
        self.reset()

    def reset(self) -> None:
        """Begin an episode."""
        self._position, self._yaw = np.zeros(3), 0.0
        self._velocity: Array | None = None
        self._goal = np.zeros(3)

    def __call__(self, read: Mapping[str, Array]) -> Fix:
        """Return where the vehicle is; to be called once before every decision.

        Args:
            read: The slices of the observation "full" by their names (`envs.observation`).
        """
        level, up, azimuth = _goal_in(read["goal"])
        velocity = unsoft(read["velocity"], SPEED_SCALE)
        if self._velocity is None:
            self._goal = np.array([level * np.cos(azimuth), level * np.sin(azimuth), up])
        else:
            # Turns begin and end within a decision, so that the rate of now is nearer to its mean than that before.
            self._yaw += self._seconds * float(unsoft(read["rates"], RATE_SCALE)[2])
            moved = 0.5 * (self._velocity + self._turned(read) @ velocity)
            self._position = self._held(self._position + self._seconds * moved, level, up, azimuth)
        quaternion = tilted(self._yaw, *np.arcsin(np.clip(read["tilt"], -1.0, 1.0)))
        self._velocity = rotation_matrix(quaternion) @ velocity
        return Fix(self._position, self._yaw, quaternion)

    def _turned(self, read: Mapping[str, Array]) -> Array:
        return rotation_matrix(tilted(self._yaw, *np.arcsin(np.clip(read["tilt"], -1.0, 1.0))))

    def _held(self, guess: Array, level: float, up: float, azimuth: float) -> Array:
        """Return a guess of the place, moved as far from the goal as is observed; turn to the goal's bearing."""
        offset = self._goal - guess
        if level > NEAR_GOAL:
            self._yaw = float(np.arctan2(offset[1], offset[0])) - azimuth
            offset[:2] *= level / float(np.hypot(offset[0], offset[1]))
        return self._goal - np.array([offset[0], offset[1], up])


def tilted(yaw: float, pitch_up: float, left_up: float) -> Array:
    """Return the quaternion (w, x, y, z) of a heading, with nose and left side up by some angles, rad."""
    half = 0.5 * np.array([left_up, -pitch_up, yaw])
    (cx, cy, cz), (sx, sy, sz) = np.cos(half), np.sin(half)
    return np.array([
        cx * cy * cz + sx * sy * sz,
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
    ])  # fmt: skip


def _goal_in(goal: Array) -> tuple[float, float, float]:
    """Return the goal's level distance and height above the vehicle, m, and its azimuth, rad."""
    distance, elevation = float(unsoft(goal[0], DISTANCE_SCALE)), 0.5 * np.pi * float(goal[2])
    return distance * np.cos(elevation), distance * np.sin(elevation), np.pi * float(goal[1])
