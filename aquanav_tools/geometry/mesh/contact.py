"""Exact distances from a surface: of points (libigl) and of capsules (FCL)."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from aquanav_tools.types import Array, IntArray, Mesh

MIN_AXIS = 1e-9
"""Shorter axes have no direction, m: the capsule is a sphere."""


class Surface:
    """The triangles of a mesh, ready for exact distance queries."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    @cached_property
    def _collider(self) -> Any:
        import fcl

        model = fcl.BVHModel()
        model.beginModel(len(self._mesh.vertices), len(self._mesh.faces))
        model.addSubModel(self._mesh.vertices, self._mesh.faces)
        model.endModel()
        return fcl.CollisionObject(model)

    @cached_property
    def _tree(self) -> Any:
        import igl

        tree = igl.AABB()
        tree.init(self._mesh.vertices, self._mesh.faces)
        return tree

    def distance(self, points: Array) -> Array:
        """Return the (N,) distances of (N, 3) points from the surface, m."""
        squared: Array = self._tree.squared_distance(self._mesh.vertices, self._mesh.faces, points)[0]
        return np.sqrt(squared)

    def nearest_faces(self, points: Array) -> IntArray:
        """Return the (N,) faces that are nearest to (N, 3) points."""
        faces = self._tree.squared_distance(self._mesh.vertices, self._mesh.faces, points)[1]
        return np.asarray(faces, dtype=np.int64)

    def gap(self, start: Array, end: Array, radius: float) -> float:
        """Return the distance from the surface to the capsule of `radius` around a segment, m; 0 when they touch.

        Args:
            start: (3,) one end of the capsule's axis, m.
            end: (3,) the other end, m.
            radius: of the capsule, m; positive.
        """
        import fcl

        axis = np.asarray(end) - start
        length = float(np.linalg.norm(axis))
        shape = fcl.Capsule(radius, length)
        body = fcl.CollisionObject(shape, fcl.Transform(_frame(axis, length), 0.5 * (np.asarray(start) + end)))
        if fcl.collide(self._collider, body):
            return 0.0
        return float(fcl.distance(self._collider, body))


def _frame(axis: Array, length: float) -> Array:
    """Return a (3, 3) rotation that takes z, the axis of FCL's capsules, to `axis`."""
    if length < MIN_AXIS:
        return np.eye(3)
    ahead = axis / length
    beside = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
    beside /= np.linalg.norm(beside)
    return np.column_stack([beside, np.cross(ahead, beside), ahead])
