"""What rays meet first on a mesh (Embree)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

NOTHING = -1
"""In place of a face where a ray meets none."""
FAR = 1e30
"""Embree's lengths beyond which nothing was met."""


@dataclass(frozen=True)
class Hits:
    """What N rays meet first."""

    faces: IntArray
    """(N,) NOTHING where none is met."""
    lengths: Array
    """(N,) in lengths of the directions; inf where nothing is met."""
    places: Array
    """(N, 2) weights of the second and the third corner of a face in the place on it that is met."""

    @property
    def weights(self) -> Array:
        """(N, 3) of all corners there; they add up to 1."""
        return np.column_stack([1.0 - self.places.sum(axis=1), self.places])

    @property
    def is_hit(self) -> BoolArray:
        """(N,) whether anything is met."""
        is_hit: BoolArray = self.faces != NOTHING
        return is_hit


class RayScene:
    """A mesh that rays are cast at, from either side of its faces."""

    def __init__(self, mesh: Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        # Embree works in float32: near the origin its coordinates are finest.
        self._centre = mesh.vertices.mean(axis=0)
        self._scene = EmbreeScene()
        self._triangles = TriangleMesh(self._scene, (mesh.triangles - self._centre).astype(np.float32))  # read by it

    def hits(self, origins: Array, directions: Array) -> Hits:
        """Return what is met from (N, 3) origins, or one for all, (3,), in (N, 3) directions of any length, m."""
        found = self._scene.run(*self._rays(origins, directions), output=1)
        faces = np.asarray(found["primID"], dtype=np.int64)
        lengths = np.where(faces != NOTHING, np.asarray(found["tfar"], dtype=np.float64), np.inf)
        return Hits(faces, lengths, np.column_stack([found["u"], found["v"]]).astype(np.float64))

    def faces(self, origins: Array, directions: Array) -> IntArray:
        """Return the (N,) faces alone, as `hits` has them: faster."""
        return np.asarray(self._scene.run(*self._rays(origins, directions)), dtype=np.int64)

    def lengths(self, origins: Array, directions: Array) -> Array:
        """Return the (N,) lengths alone, as `hits` has them: faster."""
        found = np.asarray(self._scene.run(*self._rays(origins, directions), query="DISTANCE"), dtype=np.float64)
        return np.where(found < FAR, found, np.inf)

    def is_clear(self, starts: Array, ways: Array) -> BoolArray:
        """Return the (N,) flags of straight lines from (N, 3) starts along (N, 3) ways that meet nothing."""
        clear: BoolArray = self.lengths(starts, ways) >= 1.0
        return clear

    def _rays(self, origins: Array, directions: Array) -> tuple[np.ndarray, np.ndarray]:
        starts = np.broadcast_to((origins - self._centre).astype(np.float32), directions.shape)
        return np.ascontiguousarray(starts), np.ascontiguousarray(directions, dtype=np.float32)
