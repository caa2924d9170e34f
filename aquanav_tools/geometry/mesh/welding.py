"""Welding: a triangle soup as a mesh whose faces share vertices, without faces that are no surface."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.types import Array, IntArray, Mesh

TOLERANCE = 1e-8
"""Vertices whose coordinates round to the same multiple of this are one, m; flatter faces are none."""
_FACTORS = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F), np.uint64(0x165667B19E3779F9))
_SHIFT = np.uint64(29)


def weld(mesh: Mesh) -> Mesh:
    """Return the mesh with equal vertices merged, and degenerate, repeated faces and unused vertices left out."""
    ids = row_ids(np.rint(mesh.vertices / TOLERANCE).astype(np.int64))
    faces = ids[mesh.faces]
    a, b, c = (mesh.vertices[faces[:, corner]] for corner in range(3))
    longest = np.sqrt(np.maximum(np.maximum(_squared(b - a), _squared(c - b)), _squared(a - c)))
    doubled = np.sqrt(_squared(np.cross(b - a, c - a)))
    faces = faces[doubled > TOLERANCE * longest]
    faces = faces[row_ids(np.sort(faces, axis=1)) == np.arange(len(faces))]
    is_used = np.zeros(len(mesh.vertices), dtype=np.bool_)
    is_used[faces] = True
    places = np.cumsum(is_used) - 1
    return Mesh(mesh.vertices[is_used], places[faces])


def row_ids(rows: IntArray) -> IntArray:
    """Return for each of (N, 3) rows the first one that is the same."""
    ids = np.empty(len(rows), dtype=np.int64)
    size = 1 << int(2 * len(rows) + 1).bit_length()
    _find_first(np.ascontiguousarray(rows), np.full(size, -1, dtype=np.int64), ids)
    return ids


def _squared(vectors: Array) -> Array:
    squares: Array = np.einsum("nk,nk->n", vectors, vectors)
    return squares


@numba.njit(cache=True)
def _find_first(rows, table, ids):  # type: ignore[no-untyped-def]
    """Fill the first equal row of each, by way of a table of hashes, a power of two long."""
    mask = np.uint64(len(table) - 1)
    for n in range(len(rows)):
        key = np.uint64(0)
        for k in range(3):
            key = (key ^ np.uint64(rows[n, k])) * _FACTORS[k]
            key ^= key >> _SHIFT
        place = key & mask
        while True:
            other = table[place]
            if other < 0:
                table[place] = ids[n] = n
                break
            if rows[other, 0] == rows[n, 0] and rows[other, 1] == rows[n, 1] and rows[other, 2] == rows[n, 2]:
                ids[n] = other
                break
            place = (place + np.uint64(1)) & mask
