"""Free-space constraints, what is known to be water: where cameras and surveyors were, the legs between, a named place.

A cavity must hold all of it: whoever closes a scan must neither wall in a camera nor seal a passage that was walked.
Cameras also saw how far the water reaches; what they looked through is water too.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aquanav_tools.cave.scan.sight import Sight
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh, Sim3

LEG_STEP = 0.5
"""Legs are looked at every half voxel: a seal is at least a voxel thick."""
TOLERANCE_VOXELS = 1.0
"""A place in rock still counts as water this close to the wall: stations are marked on walls."""


NO_POINTS: Array = np.zeros((0, 3))
NO_LEGS: Array = np.zeros((0, 2, 3))


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Constraints: places and lines in the water."""

    inside: Array = field(default_factory=lambda: NO_POINTS)
    """(N, 3) points, m."""
    legs: Array = field(default_factory=lambda: NO_LEGS)
    """(M, 2, 3) straight lines that nothing blocks, m."""
    sight: Sight | None = None
    """What the cameras saw; None without photos."""

    def moved(self, offset: Array) -> FreeSpace:
        """Return the same with a (3,) offset added, m."""
        sight = None if self.sight is None else self.sight.moved(Sim3(1.0, np.eye(3), offset))
        return FreeSpace(self.inside + offset, self.legs + offset, sight)

    def chosen(self, among: Contradictions) -> FreeSpace:
        """Return only the places and legs that were found to be contradicted."""
        return FreeSpace(self.inside[among.points], self.legs[among.legs], self.sight)

    @property
    def count(self) -> int:
        """How many places and legs there are."""
        return len(self.inside) + len(self.legs)


NONE_KNOWN = FreeSpace()


@dataclass(frozen=True, eq=False)
class Contradictions:
    """What a closed surface gets wrong."""

    points: IntArray
    """Indices of points that lie in rock."""
    legs: IntArray
    """Indices of legs that rock blocks."""

    @property
    def count(self) -> int:
        """How many there are in all."""
        return len(self.points) + len(self.legs)


def contradictions(closed: Mesh, free_space: FreeSpace, voxel: float) -> Contradictions:
    """Return which places and legs a closed surface (normals out of the water) leaves in rock."""
    lengths = np.linalg.norm(free_space.legs[:, 1] - free_space.legs[:, 0], axis=1)
    counts = np.maximum(np.ceil(lengths / (LEG_STEP * voxel)).astype(np.int64), 1) + 1
    leg_ids = np.repeat(np.arange(len(lengths)), counts)
    rank = np.arange(len(leg_ids)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (rank / np.maximum(counts[leg_ids] - 1, 1))[:, None]
    samples = (1.0 - share) * free_space.legs[leg_ids, 0] + share * free_space.legs[leg_ids, 1]
    is_dry = ~_is_water(closed, np.concatenate([free_space.inside, samples]), voxel)
    num_points = len(free_space.inside)
    return Contradictions(np.flatnonzero(is_dry[:num_points]), np.unique(leg_ids[is_dry[num_points:]]))


def _is_water(closed: Mesh, points: Array, voxel: float) -> BoolArray:
    import igl

    if not len(points):
        return np.zeros(0, dtype=bool)
    is_wet: BoolArray = igl.fast_winding_number(closed.vertices, closed.faces, points) > 0.5
    dry = np.flatnonzero(~is_wet)
    if len(dry):
        squared = igl.point_mesh_squared_distance(points[dry], closed.vertices, closed.faces)[0]
        is_wet[dry] = squared <= (TOLERANCE_VOXELS * voxel) ** 2
    return is_wet
