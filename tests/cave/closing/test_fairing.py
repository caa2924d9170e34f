"""Holes in the wall bulge as the wall around them does, into nothing that is known."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np
import pytest

from aquanav_tools.cave.cavity import from_manifold, prove_watertight
from aquanav_tools.cave.closing.fairing import fair_holes
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_scan, close_surface
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.geometry.mesh.handles import genus
from aquanav_tools.types import BoolArray, Mesh
from tests.cave.open_caves import LENGTH, RADIUS, straight, tube_volume

VOXEL = 0.05
CHORD = 0.6
"""Height at which a ball of radius 1 is cut flat: the sphere of 128 segments above it is what nobody saw."""


def ball() -> Any:
    return manifold3d.Manifold.sphere(1.0, 128)


def cut_ball() -> Any:
    return ball().trim_by_plane((0.0, 0.0, -1.0), -CHORD)


def faired(solid: Any, voxel: float = VOXEL) -> Mesh:
    """Return the surface of a solid after what lies flat at CHORD, on the ball, was faired."""
    mesh = from_manifold(solid.refine_to_length(voxel))
    is_flat = np.abs(mesh.triangles[..., 2] - CHORD) < 1e-9
    is_hole: BoolArray = (is_flat & (np.linalg.norm(mesh.triangles[..., :2], axis=-1) < 0.82)).all(axis=1)
    result = fair_holes(mesh, is_hole, voxel)
    prove_watertight(result)
    return result


def test_a_ball_cut_flat_is_rounder_again() -> None:
    mesh = faired(cut_ball())
    lost = ball().volume() - cut_ball().volume()
    # The wall beside the rim gives way as the noise of a scan does, and holds the rest back.
    assert 0.5 * lost < mesh.volume - cut_ball().volume() < lost
    assert np.linalg.norm(mesh.vertices, axis=1).max() < 1.0 + VOXEL
    assert mesh.vertices[:, 2].max() > 0.85


def test_a_hole_does_not_bulge_into_the_passage_behind_it() -> None:
    # A slab of water 0.1 m beyond the flat part, where the ball reaches to 0.87 m; both are joined far from there.
    solid = cut_ball()
    ways = [
        ((0.3, -0.2, 0.7), (1.6, 0.2, 1.0)),
        ((1.3, -0.2, -0.3), (1.6, 0.2, 1.0)),
        ((0.5, -0.2, -0.3), (1.6, 0.2, 0.0)),
    ]
    for low, high in ways:
        solid += manifold3d.Manifold.cube(np.subtract(high, low)).translate(low)
    mesh = faired(solid)
    assert mesh.volume > solid.volume() + 1e-3  # beside the slab
    assert genus(mesh) == solid.genus() == 0


def test_no_water_is_taken_where_the_wall_bulges_inwards() -> None:
    room = manifold3d.Manifold.cube((2.2, 2.2, 1.2)).translate((-1.1, -1.1, -0.2)) - cut_ball()
    assert faired(room, 2.0 * VOXEL).volume >= room.volume() - 1e-6


def test_a_tube_is_round_where_a_third_of_its_wall_is_missing() -> None:
    whole = straight()
    x, y, z = whole.triangles.mean(axis=1).T
    is_missing = (np.abs(np.arctan2(y, z)) < np.deg2rad(60.0)) & (np.abs(x - LENGTH / 2) < 2.0)
    surface = surface_from_mesh(Mesh(whole.vertices, whole.faces[~is_missing]), VOXEL)
    straight_across = close_surface(surface.mesh, ReconstructionOptions(VOXEL, 0.5, keep_triangles=False)).mesh
    cavity = close_scan(surface, ReconstructionOptions(VOXEL, 0.5, keep_triangles=False)).cavity
    prove_watertight(cavity.mesh)
    assert len(cavity.portals) == 2
    top = [
        m.to_trimesh().ray.intersects_location([[LENGTH / 2, 0, 0]], [[0, 0, 1]])[0][0, 2]
        for m in (straight_across, cavity.mesh)
    ]
    assert top[0] < 0.6 * RADIUS  # half of the radius, were it not for the ends of the hole
    assert top[1] == pytest.approx(RADIUS, rel=0.2)
    assert tube_volume(LENGTH) * 0.95 < cavity.volume < tube_volume(LENGTH)


def test_a_missing_ceiling_that_runs_into_an_end_is_vaulted_up_to_near_the_end() -> None:
    whole = straight()
    x, y, z = whole.triangles.mean(axis=1).T
    is_missing = (np.abs(np.arctan2(y, z)) < np.deg2rad(60.0)) & (x > 3.0)
    surface = surface_from_mesh(Mesh(whole.vertices, whole.faces[~is_missing]), VOXEL)
    cavity = close_scan(surface, ReconstructionOptions(VOXEL, 0.5, keep_triangles=False, accept_open=True)).cavity
    prove_watertight(cavity.mesh)
    assert len(cavity.portals) == 2
    top = cavity.mesh.to_trimesh().ray.intersects_location([[5.5, 0, 0]], [[0, 0, 1]])[0][:, 2].min()
    assert top > 0.75 * RADIUS  # straight across, half of it


def test_a_hole_with_faces_without_area_stays_straight_from_rim_to_rim() -> None:
    mesh = from_manifold(cut_ball().refine_to_length(VOXEL))
    is_hole: BoolArray = (np.abs(mesh.triangles[..., 2] - CHORD) < 1e-9).all(axis=1)
    inner = np.flatnonzero(np.linalg.norm(mesh.vertices - [0.0, 0.0, CHORD], axis=1) < 0.5)
    vertices = mesh.vertices.copy()
    vertices[inner] = [0.0, 0.0, CHORD]  # nothing weighs their neighbours: there is no shape that bends least
    collapsed = Mesh(vertices, mesh.faces)
    assert (collapsed.areas == 0.0).sum() > 100
    assert np.array_equal(fair_holes(collapsed, is_hole, VOXEL).vertices, vertices)
