"""How far one surface strays from another, measured with exact distances from places all over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array, IntArray, Mesh


@dataclass(frozen=True, eq=False)
class Deviation:
    """Distances from places on a surface to another surface."""

    points: Array
    """(N, 3) every vertex of the surface, and places spread over its faces."""
    faces: IntArray
    """(N,) face that each place is on."""
    distance: Array
    """(N,) to the nearest point of the other surface, m."""

    def faces_beyond(self, bound: float) -> IntArray:
        """Return the faces with a place farther away than `bound`, m."""
        return np.unique(self.faces[self.distance > bound])

    def largest(self) -> float:
        """Return the largest distance, m."""
        return float(self.distance.max())


def measure_deviation(mesh: Mesh, target: Mesh, num_places: int) -> Deviation:
    """Return how far a surface is from another.

    A distance changes no faster than the position, so between places it is at most half their spacing larger.

    Args:
        mesh: the surface measured.
        target: the surface it is measured from.
        num_places: about how many places are spread over the area, beside the vertices; each face gets at least one.
    """
    import igl

    points, faces = _places(mesh, num_places)
    squared = igl.point_mesh_squared_distance(points, target.vertices, target.faces)[0]
    return Deviation(points, faces, np.sqrt(np.asarray(squared)))


def _places(mesh: Mesh, num_places: int) -> tuple[Array, IntArray]:
    """Return the vertices and the middles of the pieces that faces are split into until none is large."""
    pieces, owners = mesh.triangles, np.arange(len(mesh.faces))
    largest = 2.0 * float(_areas(pieces).sum()) / num_places  # pieces end between a quarter of this and this
    middles, middle_owners = [], []
    while len(pieces):
        is_large = _areas(pieces) > largest
        middles.append(pieces[~is_large].mean(axis=1))
        middle_owners.append(owners[~is_large])
        pieces, owners = _quarters(pieces[is_large]), np.repeat(owners[is_large], 4)
    used, corners = np.unique(mesh.faces, return_index=True)
    return np.concatenate([mesh.vertices[used], *middles]), np.concatenate([corners // 3, *middle_owners])


def _areas(pieces: Array) -> Array:
    areas: Array = 0.5 * np.linalg.norm(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]), axis=1)
    return areas


def _quarters(pieces: Array) -> Array:
    a, b, c = pieces[:, 0], pieces[:, 1], pieces[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3, 3)
