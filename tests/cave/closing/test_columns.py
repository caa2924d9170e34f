"""Water that is added at dented ends: balls taken out of tubes, so that every place is known to be water or rock."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np
import pytest

from aquanav_tools.cave.cavity import from_manifold
from aquanav_tools.cave.closing.columns import Column, column_to_plane
from aquanav_tools.types import Array, Mesh

VOXEL = 0.05
SECTIONS = 64
RADIUS = 1.0
LENGTH = 4.0
DENT_RADIUS = 1.25
"""A ball of it around LENGTH + 0.75 meets the tube's wall at LENGTH and reaches in by 0.5 m."""
X = np.array([1.0, 0.0, 0.0])
TOLERANCE = 2 * VOXEL


def tube() -> Any:
    """A solid along x from 0 to beyond LENGTH."""
    return manifold3d.Manifold.cylinder(LENGTH + 1.0, RADIUS, circular_segments=SECTIONS).rotate((0, 90, 0))


def ball(x: float, radius: float) -> Any:
    return manifold3d.Manifold.sphere(radius, SECTIONS).translate((x, 0, 0))


def dent() -> Any:
    """All that is not water at the end: a ball and what lies beyond it."""
    return ball(LENGTH + 0.75, DENT_RADIUS) + manifold3d.Manifold.cube((3.0, 3.0, 3.0)).translate((LENGTH, -1.5, -1.5))


def on_ball(mesh: Mesh, x: float, radius: float) -> Array:
    distance = np.linalg.norm(mesh.triangles - [x, 0.0, 0.0], axis=2)
    return np.asarray((distance.max(axis=1) < radius + 1e-6) & (distance.min(axis=1) > radius - 0.02))


def column(mesh: Mesh, is_end: Array, plane: float) -> Column | None:
    end = np.flatnonzero(is_end)
    return column_to_plane(mesh, end, end, plane * X, X, VOXEL)


def missing(mesh: Mesh, plane: float) -> tuple[Array, Array]:
    """Places in the tube before a plane that the mesh leaves in rock, and places in the rock around the tube."""
    import igl

    rng = np.random.default_rng(0)
    places = rng.uniform([plane - 1.5, -1.5, -1.5], [plane - TOLERANCE, 1.5, 1.5], (40_000, 3))
    is_rock = igl.fast_winding_number(mesh.vertices, mesh.faces, places) < 0.5
    axial = np.linalg.norm(places[:, 1:], axis=1)
    return places[is_rock & (axial < RADIUS - TOLERANCE)], places[is_rock & (axial > RADIUS + TOLERANCE)]


def test_a_dent_is_filled_with_water_to_the_plane_and_not_beside_it() -> None:
    mesh = from_manifold(tube() - dent())
    water = column(mesh, on_ball(mesh, LENGTH + 0.75, DENT_RADIUS), LENGTH)
    lost, rock = missing(mesh, LENGTH)
    assert len(lost) > 1000
    assert water is not None
    assert (water.depth(lost) > 0.0).all()
    assert (water.depth(rock) < 0.0).all()
    low, high = water.box
    assert (low < [LENGTH - 0.5, -RADIUS, -RADIUS]).all()
    assert (high > [LENGTH, RADIUS, RADIUS]).all()


def test_so_is_a_folded_one() -> None:
    # A second ball behind the first, reached through it: the surface turns back on itself, the neck is 0.66 m wide.
    bulb = LENGTH - 0.5 - 0.375
    mesh = from_manifold(tube() - dent() - ball(bulb, 0.5))
    is_end = on_ball(mesh, LENGTH + 0.75, DENT_RADIUS) | on_ball(mesh, bulb, 0.5)
    assert (mesh.normals[is_end, 0] < -0.5).any()
    water = column(mesh, is_end, LENGTH - 0.2)
    lost, rock = missing(mesh, LENGTH - 0.2)
    assert water is not None
    assert (water.depth(lost) > 0.0).all()
    assert (water.depth(rock) < 0.0).all()


def test_observed_rock_and_other_water_before_the_plane_stay() -> None:
    # A gallery crosses outside of the dent, 0.1 m before the plane.
    half = 0.2
    gallery = manifold3d.Manifold.cube((0.2, 2 * half, 2 * half)).translate((LENGTH - 0.3, -half, -half))
    mesh = from_manifold((tube() - dent()) + gallery)
    water = column(mesh, on_ball(mesh, LENGTH + 0.75, DENT_RADIUS), LENGTH)
    lost, _ = missing(mesh, LENGTH)
    across = np.abs(lost[:, 1:]).max(axis=1)
    assert water is not None
    assert (water.depth(lost[across < half - TOLERANCE]) < 0.0).all()
    assert (water.depth(lost[across > half + 2 * TOLERANCE]) > 0.0).all()


@pytest.mark.parametrize("bulge", [0.0, 0.3])
def test_an_end_that_does_not_reach_in_needs_none(bulge: float) -> None:
    solid = tube().trim_by_plane((-1.0, 0.0, 0.0), -LENGTH)
    if bulge:
        radius = (RADIUS**2 + bulge**2) / (2 * bulge)  # of the ball whose cap on the tube's section is so high
        cap = ball(LENGTH + bulge - radius, radius).trim_by_plane((1.0, 0.0, 0.0), LENGTH - 1e-3)
        solid = solid + (cap ^ tube())
    mesh = from_manifold(solid)
    assert column(mesh, mesh.triangles[..., 0].min(axis=1) > LENGTH - 2e-3, LENGTH - 2e-3) is None
