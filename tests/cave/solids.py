"""Closed caves whose sections, areas and volumes have closed forms."""

from __future__ import annotations

import manifold3d
import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, from_manifold
from aquanav_tools.types import Mesh

SIDES = 64
SHARE_OF_CIRCLE = 0.5 * SIDES * np.sin(2 * np.pi / SIDES) / np.pi
"""Area of a regular polygon over that of its circle: 0.9984."""
APOTHEM = np.cos(np.pi / SIDES)
"""Distance to a side over the circle's radius: 0.9988."""


def closed(mesh: Mesh) -> Cavity:
    return Cavity(mesh, np.full(len(mesh.faces), WALL), np.full(len(mesh.faces), True), ())


def box_with(*pillars: tuple[float, float, float]) -> Cavity:
    """A passage along y, 30 m long, x from -2 to 3, z from -1 to 3, with round pillars at (x, y) of a radius."""
    solid = manifold3d.Manifold.cube((5.0, 30.0, 4.0)).translate((-2.0, 0.0, -1.0))
    for x, y, radius in pillars:
        solid -= manifold3d.Manifold.cylinder(10.0, radius, circular_segments=SIDES).translate((x, y, -5.0))
    return closed(from_manifold(solid))


def helix(radius: float, rise: float, turns: float = 1.0) -> np.ndarray:
    """(C, 3) curve that climbs `rise` metres per turn."""
    turn = np.linspace(0.0, 2.0 * np.pi * turns, 801)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), rise * turn / (2.0 * np.pi)], axis=1)
