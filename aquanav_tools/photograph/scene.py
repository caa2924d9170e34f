"""A smooth mesh as a camera sees it."""

from __future__ import annotations

import numpy as np

from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.types import Array, Mesh


class SmoothScene:
    """A mesh that rays are cast at, whose normals go over from vertex to vertex."""

    def __init__(self, mesh: Mesh) -> None:
        solid = mesh.to_trimesh()
        self._normals = np.asarray(solid.vertex_normals)
        self._faces = mesh.faces
        self._scene = RayScene(mesh)

    def cast(self, origin: Array, rays: Array) -> tuple[Array, Array]:
        """Return (N,) how many times each (N, 3) ray fits to the first hit (NaN without), and (N, 3) smooth normals."""
        met = self._scene.hits(origin, rays)
        corners = self._faces[np.maximum(met.faces, 0)]
        normals = np.einsum("nk,nkd->nd", met.weights, self._normals[corners])
        return np.where(met.is_hit, met.lengths, np.nan), normals
