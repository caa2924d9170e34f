"""How far one surface strays from another, measured with exact distances from places all over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.geometry.mesh.contact import Surface
from aquanav_tools.types import Array, IntArray, Mesh


@dataclass(frozen=True, eq=False)
class Deviation:
    """Distances from places on a surface to another surface."""

    mesh: Mesh
    """The surface that was measured."""
    points: Array
    """(N, 3) every used vertex of the surface, and places spread over its faces."""
    vertices: IntArray
    """(V,) the vertex that each of the first places is."""
    faces: IntArray
    """(N - V,) face that each of the other places is on."""
    distance: Array
    """(N,) to the nearest point of the other surface, m."""

    def faces_beyond(self, bound: float) -> IntArray:
        """Return the faces with a place, be it a corner, farther away than `bound`, m."""
        is_beyond = self.distance > bound
        vertices, inner = np.split(is_beyond, [len(self.vertices)])
        is_corner = np.zeros(len(self.mesh.vertices), dtype=np.bool_)
        is_corner[self.vertices[vertices]] = True
        return np.union1d(np.flatnonzero(is_corner[self.mesh.faces].any(axis=1)), self.faces[inner])

    def largest(self) -> float:
        """Return the largest distance, m."""
        return float(self.distance.max())


def measure_deviation(mesh: Mesh, target: Surface, num_places: int) -> Deviation:
    """Return how far a surface is from another.

    A distance changes no faster than the position, so between places it is at most half their spacing larger.

    Args:
        mesh: the surface measured.
        target: the surface it is measured from.
        num_places: about how many places are spread over the area, beside the vertices; faces that are small beside the
            area of a place are known well enough by their corners and get none.
    """
    vertices = np.unique(mesh.faces)
    middles, faces = _middles(mesh, num_places)
    points = np.concatenate([mesh.vertices[vertices], middles])
    return Deviation(mesh, points, vertices, faces, target.distance(points))


def _middles(mesh: Mesh, num_places: int) -> tuple[Array, IntArray]:
    """Return the middles of the pieces that faces are split into until none is large, and the face of each."""
    corners = mesh.triangles
    areas = _areas(corners)
    largest = 2.0 * float(areas.sum()) / num_places  # pieces end between a quarter of this and this
    owners = np.flatnonzero(areas > 0.25 * largest)
    pieces = corners[owners]
    middles, middle_owners = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    while len(pieces):
        is_large = _areas(pieces) > largest
        middles.append(pieces[~is_large].mean(axis=1))
        middle_owners.append(owners[~is_large])
        pieces, owners = _quarters(pieces[is_large]), np.repeat(owners[is_large], 4)
    return np.concatenate(middles), np.concatenate(middle_owners)


def _areas(pieces: Array) -> Array:
    areas: Array = 0.5 * np.linalg.norm(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]), axis=1)
    return areas


def _quarters(pieces: Array) -> Array:
    a, b, c = pieces[:, 0], pieces[:, 1], pieces[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3, 3)
