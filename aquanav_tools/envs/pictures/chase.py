"""Where a camera that follows a vehicle through a cave is: behind and above it, in the water, and never jerking."""

from __future__ import annotations

import math

import numpy as np

from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array

BEHIND, PER_LENGTH = 0.7, 1.5
"""How far behind the middle of a vehicle it is, m, and how much farther per metre of the vehicle's length."""
AHEAD = 0.6
"""It looks at a place so far before the vehicle, m."""
CLEAR, CLEAR_SHARE = 0.25, 0.6
"""It keeps so far off every wall, m, or this share of what the middle of the vehicle keeps where that is less."""
RISES, TURNS = np.radians([18.0, 4.0, 34.0, -12.0]), np.radians([0.0, 25.0, -25.0])
"""How much higher than the vehicle, and beside its wake, it may be: the first that suits."""
AVERSION = 0.12
"""A place that is one step less usual must give this share more of the whole distance."""
SAMPLES = 48
"""Along the line from the vehicle to the camera, on which clearance is looked up."""
TURNING, MOVING = 0.45, 0.8
"""Times in which its direction follows the vehicle's, and its place the best one, s."""
UP = np.array([0.0, 0.0, 1.0])


class ChaseCamera:
    """A camera that follows a vehicle."""

    def __init__(self, field: DistanceField, length: float) -> None:
        """Prepare a camera that follows a vehicle of a length (m) through the water of a field."""
        self._field, self._distance = field, BEHIND + PER_LENGTH * length
        self.reset()

    def reset(self) -> None:
        """Forget where the camera was."""
        self._heading: Array | None = None
        self._direction = np.zeros(3)
        self._reach = 0.0

    def pose(self, position: Array, turn: Array, seconds: float) -> tuple[Array, Array]:
        """Return the camera's (3,) place, m, and its (3, 3) rotation, camera from world.

        Args:
            position: Of the vehicle, m.
            turn: (3, 3) world from body.
            seconds: Since the pose before.
        """
        ahead = level(turn[:, 0])
        is_first = self._heading is None
        kept = 0.0 if is_first else math.exp(-seconds / TURNING)
        heading = ahead if self._heading is None else level(kept * self._heading + (1.0 - kept) * ahead, ahead)
        kept = 0.0 if is_first else math.exp(-seconds / MOVING)
        direction = kept * self._direction + (1.0 - kept) * self._best(position, heading)
        direction /= np.linalg.norm(direction)
        reach = self._clear_distance(position, direction)
        # It is drawn near at once, since it must not enter the wall, and moves off slowly.
        self._reach = min(reach, kept * self._reach + (1.0 - kept) * reach)
        self._heading, self._direction = heading, direction
        return self._look(position, heading)

    def _best(self, position: Array, heading: Array) -> Array:
        """Return the (3,) direction from the vehicle to the place that suits best."""
        left = np.cross(UP, heading)
        directions = [
            math.cos(rise) * (-math.cos(yaw) * heading + math.sin(yaw) * left) + math.sin(rise) * UP
            for yaw in TURNS for rise in RISES
        ]  # fmt: skip
        unusual = [abs(i) + j for i in range(len(TURNS)) for j in range(len(RISES))]
        seen = np.array([self._clear_distance(position, direction) for direction in directions])
        gains = seen / self._distance - AVERSION * np.array(unusual)
        best: Array = directions[int(np.argmax(gains))]
        return best

    def _clear_distance(self, position: Array, direction: Array) -> float:
        """Return how far from the vehicle the camera can be in a direction, m."""
        steps = np.linspace(0.0, self._distance, SAMPLES)
        clearances = self._field.clearance(position + steps[:, None] * direction)
        needed = min(CLEAR, CLEAR_SHARE * float(clearances[0]))
        tight = np.flatnonzero(clearances < needed)
        return float(steps[max(int(tight[0]) - 1, 0)]) if len(tight) else self._distance

    def _look(self, position: Array, heading: Array) -> tuple[Array, Array]:
        centre = position + self._reach * self._direction
        look = position + AHEAD * heading - centre
        look /= np.linalg.norm(look)
        right = np.cross(look, UP)
        right /= np.linalg.norm(right)
        return centre, np.stack([right, np.cross(look, right), look])


def level(direction: Array, otherwise: Array | None = None) -> Array:
    """Return the (3,) level unit vector along a direction; east, or `otherwise`, for one that points straight up."""
    flat = direction * [1.0, 1.0, 0.0]
    size = float(np.linalg.norm(flat))
    if size < 1e-6:
        return np.array([1.0, 0.0, 0.0]) if otherwise is None else otherwise
    return np.asarray(flat / size)
