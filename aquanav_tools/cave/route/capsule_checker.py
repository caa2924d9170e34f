"""Whether a vehicle touches the walls: its capsule in a cavity, exactly."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Capsule, Pose, rotation_matrix


class CapsuleChecker:
    """Tells exactly how far a capsule is from the walls, and on which side of them."""

    def __init__(self, cavity: Cavity, field: DistanceField, capsule: Capsule) -> None:
        """Take a cavity, its field and a capsule."""
        self._surface = cavity.surface
        self._capsule = capsule
        self._field = field

    def distance(self, pose: Pose) -> float:
        """Return the gap between the capsule and the nearest wall, m; not positive when it touches or is in rock."""
        half_axis = 0.5 * self._capsule.axis_length * rotation_matrix(pose.orientation)[:, 0]
        ends = pose.position + np.array([[-1.0], [0.0], [1.0]]) * half_axis
        if self._field.clearance(ends).min() <= 0.0:
            return 0.0
        return self._surface.gap(ends[0], ends[-1], self._capsule.radius)
