"""A passage as a tunnel through a closed block of rock, as mesh editors and CSG programs write it."""

from __future__ import annotations

import dataclasses

import numpy as np

from aquanav_tools.cave.cavity import from_manifold, to_manifold
from aquanav_tools.synthetic.damage import DamagedScan

MOUTH_GAP = 1e-3
"""The block is shorter than the passage by this at each end, m: of two faces in one plane either may stay."""


def embed_in_rock(scan: DamagedScan, margin: float) -> DamagedScan:
    """Return the box around a passage with the passage cut out, closed and in one piece.

    Args:
        scan: an undamaged passage along x with open ends at its two extremes in x.
        margin: least thickness of the rock on the other four sides, m.

    Raises:
        ValueError: nobody knows the scan's water.
    """
    import manifold3d

    water = scan.truth.solid
    if water is None:
        raise ValueError("Only a passage whose water is known can be cut out of a block of rock.")
    low, high = water.vertices.min(axis=0), water.vertices.max(axis=0)
    room = np.array([-MOUTH_GAP, margin, margin])
    box = manifold3d.Manifold.cube(high - low + 2.0 * room).translate(low - room)
    return dataclasses.replace(scan, surface=from_manifold(box - to_manifold(water)))
