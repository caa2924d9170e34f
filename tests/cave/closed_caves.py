"""Closed caves with known widths, lengths and branches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquanav_tools.cave import synthetic
from aquanav_tools.cave.cavity import WALL, Cavity, to_manifold
from aquanav_tools.cave.closing import from_manifold
from aquanav_tools.types import Mesh

SECTIONS = 64
POLYGON = float(np.cos(np.pi / SECTIONS))
"""Inner radius of the polygon that stands for a unit circle."""


def closed(mesh: Mesh, is_lid: np.ndarray | None = None) -> Cavity:
    """The cavity of a closed surface; faces that `is_lid` marks are portal 1."""
    labels = np.full(len(mesh.faces), WALL) if is_lid is None else np.where(is_lid, 1, WALL)
    return Cavity(mesh, labels.astype(np.int64), labels == WALL, ())


def lathe(
    length: float,
    radius: Callable[[np.ndarray], np.ndarray],
    aside: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    rings: int = 201,
) -> Cavity:
    """A passage along +x from the origin with circular sections of radius(x) around y = aside(x), lids at the ends."""
    mesh = synthetic.tube(1.0, length, SECTIONS, rings).truth
    x = mesh.vertices[:, 0]
    shape = radius(x)[:, None] * mesh.vertices[:, 1:] + np.stack([aside(x), np.zeros_like(x)], axis=1)
    corners = x[mesh.faces]
    is_lid = (corners == 0.0).all(axis=1) | (corners == length).all(axis=1)
    return closed(Mesh(np.column_stack([x, shape]), mesh.faces), is_lid)


def swept(centreline: np.ndarray, radius: float) -> Cavity:
    """A tube around a curve that is nowhere vertical."""
    return closed(synthetic.sweep(centreline, radius, SECTIONS).truth)


def joined(*caves: Cavity) -> Cavity:
    """The union of several passages."""
    solid = to_manifold(caves[0].mesh)
    for cave in caves[1:]:
        solid += to_manifold(cave.mesh)
    return closed(from_manifold(solid))
