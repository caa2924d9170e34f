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
CRUMB = 1.0
"""Water of fewer cubic voxels belongs to the ragged rim of an end; more is another passage."""
SINK_VOXELS = 0.25
"""What is carved begins this far inside the water, voxels."""
SIMPLE_SHARE = 0.02
"""The outline of what is carved is simplified by no more than this share of that."""
EVEN_VOXELS = 3.0
"""What is carved has no edges and teeth narrower than twice this: the rim of a scan ends in steps of a voxel."""
BEYOND_VOXELS = 1.0
"""Water reaches this far beyond the plane before the cut, voxels: no sliver is left where both meet."""


def carve_dents(
    solid: Any, mesh: Mesh, patch: IntArray, point: Array, normal: Array, voxel: float, *, spread: float = 0.0
) -> Any:
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
        spread: if not 0, edges and teeth that a ragged rim gives to what is carved are taken off: it is shrunk by
            EVEN_VOXELS, seen along the normal, and grown by this many times that.
    """
    heights = (mesh.triangles[patch] - point) @ normal
    is_inside = heights.min(axis=1) < -FLAT_SHARE * voxel
    if not is_inside.any():
        return solid
    chosen = np.flatnonzero(is_inside & (mesh.normals[patch] @ normal > 0.0))
    corners, heights = mesh.triangles[patch[chosen]], heights[chosen]
    prisms = _prisms(corners, heights, normal, voxel)
    limit = -normal, -float((point + BEYOND_VOXELS * voxel * normal) @ normal)
    least = NO_WATER * voxel**3
    is_kept = np.ones(len(chosen), dtype=bool)
    for water in _other_water(solid ^ _union(prisms).trim_by_plane(*limit), mesh, patch, voxel):
        is_kept &= [(prism ^ water).volume() < least for prism in prisms]
    if spread > 0.0:
        # From within the water on: two surfaces in the same place would cross each other in the last digits.
        sunk = SINK_VOXELS * voxel
        prisms = _prisms(corners[is_kept] - sunk * normal, heights[is_kept] - sunk, normal, voxel)
        carved = _evened(_union(prisms).trim_by_plane(*limit), normal, EVEN_VOXELS * voxel, spread)
    else:
        carved = _union([prism for prism, kept in zip(prisms, is_kept, strict=True) if kept]).trim_by_plane(*limit)
    return _without_flaps(solid + carved, least)


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


def _evened(carved: Any, normal: Array, radius: float, spread: float) -> Any:
    """Return a solid of columns along a normal without what is narrower than a disc of some radius, seen along it.

    Parts that are narrower everywhere stay as they are.
    """
    import manifold3d

    if carved.is_empty():
        return carved
    right = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(normal, right), normal])
    flat = carved.transform(np.column_stack([axes, np.zeros(3)]))
    low, high = flat.bounding_box()[2], flat.bounding_box()[5]
    outline = manifold3d.CrossSection()
    for part in flat.project().decompose():
        opened = part.offset(-radius, manifold3d.JoinType.Round).offset(spread * radius, manifold3d.JoinType.Round)
        outline += part if opened.is_empty() else opened
    column = outline.simplify(SIMPLE_SHARE * radius).extrude(high - low + 2.0 * radius).translate((0, 0, low - radius))
    return carved ^ column.transform(np.column_stack([axes.T, np.zeros(3)]))


def _other_water(water: Any, mesh: Mesh, patch: IntArray, voxel: float) -> list[Any]:
    """Return the pieces of water that reach faces other than the patch; the rest lie between its folds."""
    import igl

    is_other = np.ones(len(mesh.faces), dtype=bool)
    is_other[patch] = False
    found = []
    for piece in water.decompose():
        if piece.volume() < CRUMB * voxel**3:
            continue
        middles = from_manifold(piece).triangles.mean(axis=1)
        squared, nearest, _ = igl.point_mesh_squared_distance(middles, mesh.vertices, mesh.faces)
        if is_other[nearest[squared < (FLAT_SHARE * voxel) ** 2]].any():
            found.append(piece)
    return found


def _without_flaps(solid: Any, least: float) -> Any:
    """Return a solid without pieces of no volume, which rounding leaves where prisms meet."""
    import manifold3d

    return manifold3d.Manifold.compose([piece for piece in solid.decompose() if abs(piece.volume()) >= least])
