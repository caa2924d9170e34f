"""The pieces that a mesh falls into: which faces hang together by their vertices."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.types import Array, BoolArray, IntArray, Mesh


def component_ids(mesh: Mesh) -> tuple[IntArray, int]:
    """Return for each face the number of its piece, from 0, and how many pieces there are."""
    unique, ids = np.unique(_roots(mesh.faces, len(mesh.vertices))[mesh.faces[:, 0]], return_inverse=True)
    return ids.astype(np.int64), len(unique)


def component_volumes(mesh: Mesh, ids: IntArray, count: int) -> Array:
    """Return the (count,) signed volumes of a closed mesh's pieces, m^3."""
    a, b, c = np.moveaxis(mesh.triangles - mesh.vertices.mean(axis=0), 1, 0)
    shares = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return np.bincount(ids, shares, minlength=count).astype(np.float64)


def component(mesh: Mesh, is_part: BoolArray) -> Mesh:
    """Return only some faces of a mesh and the vertices that they use; their order stays."""
    used, faces = np.unique(mesh.faces[is_part], return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int64))


@numba.njit(cache=True)
def _roots(faces, num_vertices):  # type: ignore[no-untyped-def]
    """Return for each vertex one that stands for all that hang together with it."""
    parents = np.arange(num_vertices)
    for face in range(len(faces)):
        one = _root(parents, faces[face, 0])
        for corner in range(1, 3):
            other = _root(parents, faces[face, corner])
            parents[max(one, other)] = min(one, other)
            one = min(one, other)
    for vertex in range(num_vertices):
        parents[vertex] = _root(parents, vertex)
    return parents


@numba.njit(cache=True)
def _root(parents, vertex):  # type: ignore[no-untyped-def]
    while parents[vertex] != vertex:
        parents[vertex] = parents[parents[vertex]]
        vertex = parents[vertex]
    return vertex
