"""Half-edges: a closed surface as corners that know their neighbours, and how to cut it along a loop.

Half-edge 3 f + k runs along face f from its corner k to the next one; its twin runs back along the neighbouring face.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array, IntArray, Mesh


class HalfEdges(NamedTuple):
    """A closed, oriented 2-manifold."""

    tail: IntArray
    """(3 F,) vertex each half-edge starts from."""
    twin: IntArray
    """(3 F,) half-edge that runs the other way along the same edge."""
    first: IntArray
    """(V,) one half-edge that starts from each vertex."""
    length: Array
    """(3 F,) m; infinite for edges that no path may follow."""
    points: Array
    """(V, 3) vertices, m."""


@numba.njit(cache=True)
def following(edge):  # type: ignore[no-untyped-def]
    """Return the next half-edge around the same face."""
    return edge + 1 if edge % 3 < 2 else edge - 2


@numba.njit(cache=True)
def preceding(edge):  # type: ignore[no-untyped-def]
    """Return the half-edge before, around the same face: it ends where this one starts."""
    return edge - 1 if edge % 3 else edge + 2


def half_edges(mesh: Mesh) -> HalfEdges:
    """Return the half-edges of a closed mesh; a vertex where two fans of faces meet becomes two vertices.

    Raises:
        MeshError: an edge has other than two faces, or two that are wound against each other.
    """
    twin = _twins(mesh.faces)
    tail, first = _fans(twin)
    points = np.empty((len(first), 3))
    points[tail] = mesh.vertices[mesh.faces.ravel()]
    length = np.linalg.norm(points[tail] - points[tail[twin]], axis=1)
    return HalfEdges(tail, twin, first, length, points)


def cut_and_cap(surface: HalfEdges, loop: IntArray) -> HalfEdges:
    """Return the surface cut along a simple loop, each side of the cut closed by a cap that no path may cross.

    Cutting a loop that does not divide the surface removes one handle.

    Args:
        surface: closed.
        loop: (K,) half-edges, each starting where the one before ends.
    """
    num, rim = len(loop), surface.tail[loop]
    num_vertices, num_edges = len(surface.first), len(surface.tail)
    copies = num_vertices + np.arange(num)
    tail = surface.tail.copy()
    _move_left_corners(tail, surface.twin, loop, copies)
    left_cap = _cap_tails(np.roll(copies, -1), copies, num_vertices + num)
    right_cap = _cap_tails(rim, np.roll(rim, -1), num_vertices + num + 1)
    left_edges = num_edges + 3 * np.arange(num)
    right_edges = left_edges + 3 * num
    twin = np.concatenate([surface.twin, np.empty(6 * num, dtype=np.int64)])
    _join(twin, right_edges, surface.twin[loop])
    _join(twin, left_edges, loop)
    _join(twin, left_edges + 1, np.roll(left_edges, 1) + 2)
    _join(twin, right_edges + 1, np.roll(right_edges, -1) + 2)
    first = np.concatenate([surface.first, loop, left_edges[:1] + 2, right_edges[:1] + 2])
    first[rim] = right_edges
    cap_lengths = np.column_stack([np.tile(surface.length[loop], 2), np.full((2 * num, 2), np.inf)]).ravel()
    points = surface.points
    centre = points[rim].mean(axis=0)
    return HalfEdges(
        np.concatenate([tail, left_cap, right_cap]),
        twin,
        first,
        np.concatenate([surface.length, cap_lengths]),
        np.concatenate([points, points[rim], [centre, centre]]),
    )


def _cap_tails(start: IntArray, end: IntArray, centre: int) -> IntArray:
    return np.column_stack([start, end, np.full(len(start), centre)]).ravel()


def _join(twin: IntArray, edges: IntArray, others: IntArray) -> None:
    twin[edges], twin[others] = others, edges


def _twins(faces: IntArray) -> IntArray:
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    keys = np.minimum(tail, head) * np.int64(faces.max() + 1) + np.maximum(tail, head)
    order = np.argsort(keys, kind="stable")
    pairs = order.reshape(-1, 2) if len(order) % 2 == 0 else order[:-1].reshape(-1, 2)
    is_pair = (keys[pairs[:, 0]] == keys[pairs[:, 1]]) & (tail[pairs[:, 0]] == head[pairs[:, 1]])
    sorted_keys = keys[order]
    num_repeated = np.count_nonzero(sorted_keys[2:] == sorted_keys[:-2])
    if len(order) % 2 or not is_pair.all() or num_repeated:
        raise MeshError(
            f"{np.count_nonzero(~is_pair) + num_repeated} edges of the {len(faces)} faces do not have two faces wound "
            "alike, so handles cannot be counted. Close the surface first."
        )
    twin = np.empty(len(order), dtype=np.int64)
    _join(twin, pairs[:, 0], pairs[:, 1])
    return twin


@numba.njit(cache=True)
def _fans(twin):  # type: ignore[no-untyped-def]
    """Return the vertex each half-edge starts from, counted as fans of faces, and the first half-edge of each."""
    tail = np.full(len(twin), -1, np.int64)
    first = np.empty(len(twin), np.int64)
    count = 0
    for start in range(len(twin)):
        if tail[start] >= 0:
            continue
        first[count] = start
        edge = start
        while tail[edge] < 0:
            tail[edge] = count
            edge = twin[preceding(edge)]
        count += 1
    return tail, first[:count].copy()


@numba.njit(cache=True)
def _move_left_corners(tail, twin, loop, copies):  # type: ignore[no-untyped-def]
    """Give the faces left of the loop its copied vertices."""
    for i in range(len(loop)):
        edge = loop[i]
        while True:
            tail[edge] = copies[i]
            before = preceding(edge)
            if before == loop[i - 1]:
                break
            edge = twin[before]
