"""Dents: where the surface invented across an open end curves into the water, so that a flat cut misses it.

A cut takes away what lies outside of its plane. The middle of a patch that lies inside of it would stay, as a wall that
nobody saw in the middle of the end. What lies between such faces and the plane becomes water before the cut.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import from_manifold
from aquanav_tools.types import Array, IntArray, Mesh

FLAT_SHARE = 1e-3
"""Faces that lie inside of the plane by less than this share of a voxel are flat."""
NO_WATER = 1e-6
"""Water smaller than this share of a voxel is rounding."""
BEYOND_VOXELS = 1.0
"""Water reaches this far beyond the plane before the cut, voxels: no sliver is left where both meet."""


def carve_dents(solid: Any, mesh: Mesh, patch: IntArray, point: Array, normal: Array, voxel: float) -> Any:
    """Return the manifold3d solid with water from the faces of an invented patch out to a plane.

    Each face is swept along the normal, where nothing but the patch itself is in its way: rock that was observed stays,
    and no other passage is broken into.

    Args:
        solid: that of the mesh, perhaps with other dents carved out.
        mesh: closed, normals out of the water.
        patch: (N,) its faces that were invented across one open end.
        point: (3,) on the plane, m.
        normal: (3,) unit vector out of the water.
        voxel: resolution of the scan, m.
    """
    heights = (mesh.triangles[patch] - point) @ normal
    is_inside = heights.min(axis=1) < -FLAT_SHARE * voxel
    if not is_inside.any():
        return solid
    chosen = is_inside & (mesh.normals[patch] @ normal > 0.0)
    prisms = _prisms(mesh.triangles[patch[chosen]], heights[chosen], normal, voxel)
    limit = -normal, -float((point + BEYOND_VOXELS * voxel * normal) @ normal)
    least = NO_WATER * voxel**3
    for water in _other_water(solid ^ _union(prisms).trim_by_plane(*limit), mesh, patch, least):
        prisms = [prism for prism in prisms if (prism ^ water).volume() < least]
    return _without_flaps(solid + _union(prisms).trim_by_plane(*limit), least)


def _prisms(corners: Array, heights: Array, normal: Array, voxel: float) -> list[Any]:
    """Return the solids from (N, 3, 3) corners, (N, 3) m above the plane, to the same distance outside of it."""
    import manifold3d

    # Above all corners: a prism over a face that crosses the plane is then above that face everywhere.
    top = max(float(heights.max(initial=0.0)), BEYOND_VOXELS * voxel) + voxel
    lids = corners + (top - heights)[..., None] * normal
    return [manifold3d.Manifold.hull_points(six) for six in np.concatenate([corners, lids], axis=1)]


def _union(prisms: list[Any]) -> Any:
    import manifold3d

    return manifold3d.Manifold.batch_boolean(prisms, manifold3d.OpType.Add)


def _other_water(water: Any, mesh: Mesh, patch: IntArray, least: float) -> list[Any]:
    """Return the pieces of water that reach faces other than the patch; the rest lie between its folds."""
    import igl

    is_other = np.ones(len(mesh.faces), dtype=bool)
    is_other[patch] = False
    found = []
    for piece in water.decompose():
        if piece.volume() < least:
            continue
        middles = from_manifold(piece).triangles.mean(axis=1)
        squared, nearest, _ = igl.point_mesh_squared_distance(middles, mesh.vertices, mesh.faces)
        if is_other[nearest[squared < least ** (2.0 / 3.0)]].any():
            found.append(piece)
    return found


def _without_flaps(solid: Any, least: float) -> Any:
    """Return a solid without pieces of no volume, which rounding leaves where prisms meet."""
    import manifold3d

    return manifold3d.Manifold.compose([piece for piece in solid.decompose() if abs(piece.volume()) >= least])
