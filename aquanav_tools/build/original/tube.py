"""The middle line of an open tube of triangles, from one of its open ends to the other, without any distance field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array, IntArray, Mesh

NUM_POINTS = 200
MAX_VERTICES = 200_000


@dataclass(frozen=True, eq=False)
class Tube:
    """A passage open at both ends."""

    line: Array
    """(NUM_POINTS, 3) middles of its cross-sections."""
    radii: Array
    """(NUM_POINTS,) mean distance of the wall from them."""


def tube_of(mesh: Mesh) -> Tube | None:
    """Return the middle line of a mesh with two open ends; None for one that is no tube.

    A value that is 0 at one end, 1 at the other and harmonic between changes evenly along the tube, bends included;
    where it is the same, there is a cross-section.
    """
    mesh = _welded(mesh)
    loops = sorted(_boundary_loops(mesh), key=len)[::-1]
    if len(loops) != 2 or len(mesh.vertices) > MAX_VERTICES:
        return None
    values = _harmonic(mesh, loops[0], loops[1])
    if values is None:
        return None
    levels = np.linspace(0.0, 1.0, NUM_POINTS + 2)[1:-1]
    sections = [_section(mesh, values, level) for level in levels]
    return Tube(np.array([middle for middle, _ in sections]), np.array([radius for _, radius in sections]))


def _welded(mesh: Mesh) -> Mesh:
    """Return the mesh with vertices at the same place made one, and without faces that lose their area by it."""
    vertices, inverse = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[mesh.faces]
    is_face = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Mesh(vertices, faces[is_face])


def _boundary_loops(mesh: Mesh) -> list[IntArray]:
    """Return the vertices of each connected rim."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    rim = unique[count == 1]
    size = len(mesh.vertices)
    _, labels = connected_components(coo_array((np.ones(len(rim)), (rim[:, 0], rim[:, 1])), (size, size)), False)
    corners = np.unique(rim)
    return [corners[labels[corners] == label] for label in np.unique(labels[corners])]


def _harmonic(mesh: Mesh, zeros: IntArray, ones: IntArray) -> Array | None:
    """Return the (V,) harmonic values; None when the ends are not joined, or other pieces lie about."""
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.csgraph import connected_components
    from scipy.sparse.linalg import spsolve

    a, b = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).T
    weights = 1.0 / np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
    size = len(mesh.vertices)
    links = coo_array((np.tile(weights, 2), (np.concatenate([a, b]), np.concatenate([b, a]))), (size, size)).tocsr()
    used = np.unique(mesh.faces)
    _, labels = connected_components(links, directed=False)
    if len(np.unique(labels[used])) != 1:
        return None
    values = np.full(size, np.nan)
    values[zeros], values[ones] = 0.0, 1.0
    free = used[np.isnan(values[used])]
    if not len(free):
        return None
    laplacian = (diags_array(links.sum(axis=1)) - links).tocsr()
    known = np.concatenate([zeros, ones])
    pull = -laplacian[free][:, known] @ values[known]
    values[free] = spsolve(laplacian[free][:, free].tocsc(), pull)
    return values


def _section(mesh: Mesh, values: Array, level: float) -> tuple[Array, float]:
    """Return the middle of the line where the values reach a level, and its mean distance from there."""
    heights = values[mesh.faces] - level
    cut = np.flatnonzero((heights.min(axis=1) < 0.0) & (heights.max(axis=1) >= 0.0))
    corners, heights = mesh.triangles[cut], heights[cut]
    ends = []
    for first, second in ((0, 1), (1, 2), (2, 0)):
        is_cut = (heights[:, first] < 0.0) != (heights[:, second] < 0.0)
        share = np.where(is_cut, heights[:, first] / np.where(is_cut, heights[:, first] - heights[:, second], 1.0), 0.0)
        ends.append(
            np.where(
                is_cut[:, None], corners[:, first] + share[:, None] * (corners[:, second] - corners[:, first]), np.nan
            )
        )
    points = np.stack(ends, axis=1)
    points = points[~np.isnan(points[..., 0])].reshape(-1, 2, 3)  # a triangle that is cut is cut at two of its edges
    lengths = np.linalg.norm(points[:, 1] - points[:, 0], axis=1) + 1e-12
    middles = points.mean(axis=1)
    middle = np.average(middles, axis=0, weights=lengths)
    return middle, float(np.average(np.linalg.norm(middles - middle, axis=1), weights=lengths))
