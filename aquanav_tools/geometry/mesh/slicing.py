"""Where a plane cuts a closed mesh."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh


def slice_mesh(mesh: Mesh, centre: Array, axes: Array) -> list[Array]:
    """Return the rings along which a plane cuts a closed mesh, in plane coordinates.

    What lies in the plane counts as above it, so that every vertex is on one side and every ring closes.

    Args:
        mesh: closed.
        centre: (3,) origin of the plane coordinates, m.
        axes: (3, 3) rows: the two axes of the plane and its normal, unit vectors.

    Returns:
        (K, 2) each, not closed, m.
    """
    heights = (mesh.vertices - centre) @ axes[2]
    faces = mesh.faces[_is_cut(heights >= 0.0, mesh.faces)]
    if not len(faces):
        return []
    is_above = (heights >= 0.0)[faces]
    entries = _crossing_edges(faces, ~is_above & np.roll(is_above, -1, axis=1))
    exits = _crossing_edges(faces, is_above & ~np.roll(is_above, -1, axis=1))
    share = heights[entries[:, 0]] / (heights[entries[:, 0]] - heights[entries[:, 1]])
    ends = (mesh.vertices[entries] - centre) @ axes[:2].T
    points = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
    return [points[ring] for ring in _rings(_names(entries, len(heights)), _names(exits, len(heights)))]


def polygons_in_plane(mesh: Mesh, centre: Array, normal: Array) -> list[Any]:
    """Return the shapely polygons of what a closed mesh holds in a plane, in its coordinates (`plane_axes`).

    Args:
        mesh: closed.
        centre: (3,) origin of the plane coordinates, m.
        normal: (3,) unit vector.
    """
    import manifold3d
    import shapely

    cuts = slice_mesh(mesh, centre, np.vstack([plane_axes(normal), normal]))
    polygons = []
    for piece in manifold3d.CrossSection(cuts, manifold3d.FillRule.EvenOdd).decompose():
        rings = sorted((shapely.Polygon(ring) for ring in piece.to_polygons()), key=lambda ring: -ring.area)
        polygon = shapely.Polygon(rings[0].exterior.coords, [ring.exterior.coords for ring in rings[1:]])
        polygons.append(shapely.geometry.polygon.orient(polygon))
    return polygons


@numba.njit(cache=True)
def _is_cut(is_above, faces):  # type: ignore[no-untyped-def]
    """Return the (F,) flags of faces with corners on both sides."""
    is_cut = np.empty(len(faces), dtype=np.bool_)
    for f in range(len(faces)):
        first = is_above[faces[f, 0]]
        is_cut[f] = is_above[faces[f, 1]] != first or is_above[faces[f, 2]] != first
    return is_cut


def _crossing_edges(faces: IntArray, is_crossing: BoolArray) -> IntArray:
    """Return the (F, 2) vertices, smaller first, of each face's one marked edge; edge k leads from corner k on."""
    corner, rows = is_crossing.argmax(axis=1), np.arange(len(faces))
    return np.sort(np.stack([faces[rows, corner], faces[rows, (corner + 1) % 3]], axis=1), axis=1)


def _names(edges: IntArray, num_vertices: int) -> IntArray:
    """Return one (F,) number for each (F, 2) edge."""
    return edges[:, 0] * num_vertices + edges[:, 1]


def _rings(entries: IntArray, exits: IntArray) -> list[list[int]]:
    """Return the runs of faces that are entered over the edge that the one before is left over."""
    order = np.argsort(entries)
    following = order[np.searchsorted(entries[order], exits)].tolist()
    is_new = [True] * len(following)
    rings = []
    for first in range(len(following)):
        ring, face = [], first
        while is_new[face]:
            is_new[face] = False
            ring.append(face)
            face = following[face]
        if ring:
            rings.append(ring)
    return rings
