"""A mesh that rays can be shot at."""

from __future__ import annotations

import numpy as np

from aquanav_tools.types import Array, Mesh


class RayScene:
    """A mesh that rays can be shot at."""

    def __init__(self, mesh: Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        solid = mesh.to_trimesh()
        self._normals = np.asarray(solid.vertex_normals, dtype=np.float32)
        self._faces = mesh.faces
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, mesh.triangles.astype(np.float32))

    def cast(self, origin: Array, rays: Array) -> tuple[Array, Array]:
        """Return (N,) how many times each (N, 3) ray fits to the first hit (NaN without), and (N, 3) smooth normals."""
        origins = np.broadcast_to(origin.astype(np.float32), rays.shape)
        hit = self._scene.run(np.ascontiguousarray(origins), rays.astype(np.float32), output=1)
        is_hit = hit["primID"] >= 0
        corners = self._faces[np.where(is_hit, hit["primID"], 0)]
        u, v = hit["u"][:, None], hit["v"][:, None]
        normals = (1.0 - u - v) * self._normals[corners[:, 0]]
        normals += u * self._normals[corners[:, 1]] + v * self._normals[corners[:, 2]]
        return np.where(is_hit, hit["tfar"], np.nan).astype(np.float64), normals.astype(np.float64)
