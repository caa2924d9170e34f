"""Self-intersections: the pairs of faces that pass through each other or lie on each other, found without error."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.geometry.mesh.box_tree import boxes_of, build_tree, next_leaf
from aquanav_tools.geometry.mesh.predicates import side_of_line, side_of_plane
from aquanav_tools.types import IntArray, Mesh


def self_intersections(mesh: Mesh) -> IntArray:
    """Return the pairs of faces whose interiors meet.

    That is any two faces that cross along a segment or share an area, be they neighbours or not: neighbours at a vertex
    that cross elsewhere and neighbours at an edge folded flat onto each other count. Faces that merely touch, at
    vertices or along edges, do not, nor do faces without an area. The answer is exact for the coordinates as they are;
    there is no tolerance.

    Returns:
        (K, 2) face indices, the smaller first, in ascending order.
    """
    if not len(mesh.faces):
        return np.zeros((0, 2), dtype=np.int64)
    vertices, faces = np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.faces)
    corners = mesh.triangles
    tree, order = build_tree(*boxes_of(corners))
    sorted_faces = faces[order]
    counts = _count_crossings(tree, vertices, sorted_faces)
    pairs = order[_list_crossings(tree, vertices, sorted_faces, np.concatenate([[0], np.cumsum(counts)]))]
    pairs.sort(axis=1)
    ascending: IntArray = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return ascending


def crossing_share(mesh: Mesh, num_samples: int) -> float:
    """Return the share of faces that meet others, at least: about half as many, out of some that are looked at."""
    if not len(mesh.faces):
        return 0.0
    tree, order = build_tree(*boxes_of(mesh.triangles))
    asked = np.arange(0, len(order), max(1, len(order) // num_samples))
    is_crossing = _are_crossing(tree, np.ascontiguousarray(mesh.vertices), mesh.faces[order], asked)
    return float(is_crossing.mean())


@numba.njit(cache=True, parallel=True)
def _are_crossing(tree, vertices, faces, asked):  # type: ignore[no-untyped-def]
    """Return for each face that is asked whether it crosses a later one."""
    found = np.zeros(len(asked), np.bool_)
    for n in numba.prange(len(asked)):
        i = asked[n]
        j = next_leaf(tree, i, i)
        while j >= 0 and not found[n]:
            found[n] = faces_cross(vertices, faces, i, j)
            j = next_leaf(tree, i, j)
    return found


@numba.njit(cache=True, parallel=True)
def _count_crossings(tree, vertices, faces):  # type: ignore[no-untyped-def]
    """Return for each face with how many later ones it crosses."""
    counts = np.zeros(len(faces), np.int64)
    for i in numba.prange(len(faces)):
        j = next_leaf(tree, i, i)
        while j >= 0:
            if faces_cross(vertices, faces, i, j):
                counts[i] += 1
            j = next_leaf(tree, i, j)
    return counts


@numba.njit(cache=True)
def _list_crossings(tree, vertices, faces, starts):  # type: ignore[no-untyped-def]
    """Return the (K, 2) crossing pairs; those of face i fill the rows from starts[i]."""
    pairs = np.empty((starts[-1], 2), np.int64)
    for i in range(len(faces)):
        row, j = starts[i], i
        while row < starts[i + 1]:
            j = next_leaf(tree, i, j)
            if faces_cross(vertices, faces, i, j):
                pairs[row, 0], pairs[row, 1] = i, j
                row += 1
    return pairs


@numba.njit(cache=True)
def faces_cross(vertices, faces, i, j):  # type: ignore[no-untyped-def]
    """Return whether the interiors of two faces meet.

    Each plane must cut the other face in two; the two cuts, segments of the line where the planes meet, must overlap
    (Guigue and Devillers 2003, "Fast and robust triangle-triangle overlap test using orientation predicates").
    """
    p, q, r = faces[i]
    u, v, w = faces[j]
    sides_p = side_of_plane(vertices, u, v, w, p)
    sides_q = side_of_plane(vertices, u, v, w, q)
    sides_r = side_of_plane(vertices, u, v, w, r)
    if sides_p == 0 and sides_q == 0 and sides_r == 0:
        return _overlap_in_plane(vertices, p, q, r, u, v, w)
    if not _is_cut(sides_p, sides_q, sides_r):
        return False
    sides_u = side_of_plane(vertices, p, q, r, u)
    sides_v = side_of_plane(vertices, p, q, r, v)
    sides_w = side_of_plane(vertices, p, q, r, w)
    if not _is_cut(sides_u, sides_v, sides_w):
        return False
    p, q, r, is_first_above = _single_first(p, q, r, sides_p, sides_q, sides_r)
    u, v, w, is_second_above = _single_first(u, v, w, sides_u, sides_v, sides_w)
    if not is_first_above:  # turn the other plane over
        v, w = w, v
    if not is_second_above:
        q, r = r, q
    return side_of_plane(vertices, q, u, p, v) < 0 and side_of_plane(vertices, p, u, r, w) < 0


@numba.njit(cache=True)
def _is_cut(a, b, c):  # type: ignore[no-untyped-def]
    return min(a, b, c) < 0 < max(a, b, c)


@numba.njit(cache=True)
def _single_first(a, b, c, side_a, side_b, side_c):  # type: ignore[no-untyped-def]
    """Return a cut face turned so that its first corner is alone on its side, and whether that is the side above."""
    if side_a != 0 and side_b != side_a and side_c != side_a:
        return a, b, c, side_a > 0
    if side_b != 0 and side_c != side_b and side_a != side_b:
        return b, c, a, side_b > 0
    return c, a, b, side_c > 0


@numba.njit(cache=True)
def _overlap_in_plane(vertices, p, q, r, u, v, w):  # type: ignore[no-untyped-def]
    """Return whether two faces in one plane share an area: no edge of either has the other face beyond it."""
    x, y = _widest_axes(vertices, p, q, r)
    turn, other_turn = side_of_line(vertices, p, q, r, x, y), side_of_line(vertices, u, v, w, x, y)
    if turn == 0 or other_turn == 0:
        return False
    return not (
        _is_apart(vertices, p, q, r, turn, u, v, w, x, y) or _is_apart(vertices, u, v, w, other_turn, p, q, r, x, y)
    )


@numba.njit(cache=True)
def _is_apart(vertices, p, q, r, turn, u, v, w, x, y):  # type: ignore[no-untyped-def]
    for start, end in ((p, q), (q, r), (r, p)):
        inside = False
        for corner in (u, v, w):
            inside = inside or turn * side_of_line(vertices, start, end, corner, x, y) > 0
        if not inside:
            return True
    return False


@numba.njit(cache=True)
def _widest_axes(vertices, p, q, r):  # type: ignore[no-untyped-def]
    """Return the two coordinates of the axis plane in which a face looks largest."""
    best, axes = -1.0, (0, 1)
    for x, y in ((0, 1), (1, 2), (2, 0)):
        area = abs(
            (vertices[q, x] - vertices[p, x]) * (vertices[r, y] - vertices[p, y])
            - (vertices[q, y] - vertices[p, y]) * (vertices[r, x] - vertices[p, x])
        )
        if area > best:
            best, axes = area, (x, y)
    return axes
