"""The cavity of a made-up cave: its water is closed from the start, so that nothing has to be guessed."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, Portal, prove_watertight
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.decimation import simplify
from aquanav_tools.types import Array, IntArray, Mesh

END_TOLERANCE = 1e-4
"""Marching cubes put the lids within a millionth of a cell of the grid's border, m."""


def made_up_cavity(truth: Mesh, tolerance: float) -> Cavity:
    """Return the proven cavity of a cave with two flat ends, its portals the lowest and the highest x.

    Args:
        truth: closed, wall and lids, normals out of the water, m.
        tolerance: triangles are merged where that moves the wall by no more than about this, m.

    Raises:
        MeshError: the surface is no proven solid, or an end is not flat.
    """
    ends = np.array([truth.vertices[:, 0].min(), truth.vertices[:, 0].max()]).round(3)
    vertices = truth.vertices.copy()
    for end in ends:
        vertices[np.abs(vertices[:, 0] - end) < END_TOLERANCE, 0] = end
    flat = Mesh(vertices, truth.faces)
    mesh = simplify(flat, tolerance, _labels(flat, ends))
    prove_watertight(mesh)
    labels = _labels(mesh, ends)
    for label, end in enumerate(ends, start=1):
        if not (labels == label).any():
            raise MeshError(f"The water does not end in a plane at x = {end:.3f} m. Choose another seed.")
    portals = tuple(_portal(mesh, labels, label, side) for label, side in ((1, -1.0), (2, 1.0)))
    return Cavity(mesh, labels, labels == WALL, portals)


def _labels(mesh: Mesh, ends: Array) -> IntArray:
    """Return the (F,) labels: 1 for faces in the plane of the lower end, 2 in that of the upper, else wall."""
    labels = np.full(len(mesh.faces), WALL, dtype=np.int64)
    for label, end in enumerate(ends, start=1):
        labels[np.all(np.abs(mesh.triangles[..., 0] - end) < END_TOLERANCE, axis=1)] = label
    return labels


def _portal(mesh: Mesh, labels: IntArray, label: int, side: float) -> Portal:
    areas = mesh.areas[labels == label]
    middles = mesh.triangles[labels == label].mean(axis=1)
    return Portal(label, np.average(middles, axis=0, weights=areas), np.array([side, 0.0, 0.0]), float(areas.sum()))
