"""Ends whose invented surface is dented: spheres taken out of tubes, so that areas and volumes are known."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np
import pytest

from aquanav_tools.cave.cavity import WALL, Cavity, from_manifold, prove_watertight, to_manifold
from aquanav_tools.cave.closing import portals
from aquanav_tools.cave.closing.close import ClosedSurface
from aquanav_tools.cave.closing.dents import carve_dents
from aquanav_tools.cave.closing.openings import find_openings
from aquanav_tools.cave.closing.portals import CAMERA_VOXELS, NO_CAMERAS, cut_portals
from aquanav_tools.types import Array, Mesh

VOXEL = 0.1
MIN_PORTAL = 0.8
RADIUS = 1.0
SECTIONS = 32
TUBE_AREA = 0.5 * SECTIONS * np.sin(2 * np.pi / SECTIONS) * RADIUS**2
"""Of the regular polygon that stands for the circle, m^2."""
LENGTH = 8.0
DENT_RADIUS = 1.25
DEPTH = 0.5
"""Of the dent: 1.25 - sqrt(1.25^2 - 1^2), m; by Archimedes its middle, where the cut passes, lies half as deep."""
FACETS = 3e-3
"""Of lengths: facets of a sphere of 1.25 m with 32 sections lie up to 12 mm inside of it."""


def tube(y: float = 0.0) -> Any:
    """A solid along x from 0 to beyond LENGTH."""
    return (
        manifold3d.Manifold.cylinder(LENGTH + 1.0, RADIUS, circular_segments=SECTIONS)
        .rotate((0, 90, 0))
        .translate((0, y, 0))
    )


def dent(y: float = 0.0) -> Any:
    """A ball whose surface meets the tube's wall at x = LENGTH and reaches in by DEPTH, and all beyond it."""
    ball = manifold3d.Manifold.sphere(DENT_RADIUS, SECTIONS).translate((LENGTH + 0.75, y, 0))
    return ball + manifold3d.Manifold.cube((3.0, 2.5, 3.0)).translate((LENGTH + 0.5, y - 1.25, -1.5))


def on_ball(mesh: Mesh, y: float = 0.0, x: float = LENGTH + 0.75, radius: float = DENT_RADIUS) -> Array:
    """The flags of faces on a ball; the middles of its facets lie up to 12 mm inside of it."""
    distance = np.linalg.norm(mesh.triangles - [x, y, 0.0], axis=2)
    return np.asarray((distance.max(axis=1) < radius + 1e-6) & (distance.min(axis=1) > radius - 0.02))


def cut(solid: Any, dents_at: tuple[float, ...] = (0.0,), cameras: Array = NO_CAMERAS) -> Cavity:
    """The cavity in a solid whose faces on dents, and at x = 0, nobody scanned."""
    mesh = from_manifold(solid)
    x = mesh.triangles[..., 0]
    is_scan = ~np.any([x.max(axis=1) < 1e-9, *(on_ball(mesh, y) for y in dents_at)], axis=0)
    closed = ClosedSurface(mesh, is_scan, "winding")
    scan = Mesh(mesh.vertices, mesh.faces[is_scan])
    return cut_portals(closed, scan, find_openings(closed, MIN_PORTAL), VOXEL, cameras=cameras)


def check_end(cavity: Cavity, x: float, y: float = 0.0) -> None:
    """Check that the portal at a place fills the tube's section, and that no wall stands there."""
    (end,) = (lid for lid in cavity.portals if np.linalg.norm(lid.centre - [x, y, 0.0]) < 0.05)
    assert end.area == pytest.approx(TUBE_AREA, rel=FACETS)
    middles = cavity.mesh.triangles.mean(axis=1)
    is_near = (np.abs(middles[:, 0] - x) < 2 * DEPTH) & (np.linalg.norm(middles[:, 1:] - [y, 0.0], axis=1) < 0.9)
    assert (cavity.labels[is_near] != WALL).all()


def test_a_dented_end_gets_a_lid_across_the_whole_passage() -> None:
    cavity = cut(tube() - dent())
    prove_watertight(cavity.mesh)
    check_end(cavity, LENGTH - 0.5 * DEPTH)
    assert cavity.volume == pytest.approx(TUBE_AREA * (LENGTH - 0.5 * DEPTH), rel=FACETS)


def test_so_it_does_where_a_camera_moves_the_cut_outwards() -> None:
    # Beside the dent: 0.05 m before its middle. Half-way from there to the rim the cut passes.
    camera = np.array([[LENGTH - 0.3, 0.0, 0.85]])
    cavity = cut(tube() - dent(), cameras=camera)
    prove_watertight(cavity.mesh)
    x = LENGTH - 0.15
    check_end(cavity, x)
    assert cavity.volume == pytest.approx(TUBE_AREA * x, rel=FACETS)


def test_a_folded_dent_is_carved_out() -> None:
    # A second ball behind the first, reached through it: the surface turns back on itself, the neck is 0.66 m wide.
    bulb = manifold3d.Manifold.sphere(0.5, SECTIONS).translate((LENGTH - DEPTH - 0.375, 0, 0))
    mesh = from_manifold(tube() - dent() - bulb)
    end = on_ball(mesh) | on_ball(mesh, 0.0, LENGTH - DEPTH - 0.375, 0.5)
    assert (mesh.normals[end, 0] < -0.5).any()
    normal, plane = np.array([1.0, 0.0, 0.0]), np.array([LENGTH - 0.2, 0.0, 0.0])
    solid = carve_dents(to_manifold(mesh), mesh, np.flatnonzero(end), plane, normal, VOXEL)
    kept = solid.trim_by_plane(tuple(-normal), -float(plane[0]))
    assert kept.volume() == pytest.approx(TUBE_AREA * plane[0], rel=FACETS)
    prove_watertight(from_manifold(kept))


def test_two_ends_beside_each_other_keep_their_lids() -> None:
    rear = manifold3d.Manifold.cube((1.0, 4.6, 2.0)).translate((0.0, -1.0, -1.0))
    y = 2.0 * RADIUS + 0.6
    cavity = cut((tube() - dent()) + (tube(y) - dent(y)) + rear, (0.0, y))
    prove_watertight(cavity.mesh)
    check_end(cavity, LENGTH - 0.5 * DEPTH)
    check_end(cavity, LENGTH - 0.5 * DEPTH, y)


def test_observed_rock_and_other_water_before_the_plane_stay() -> None:
    # A gallery crosses outside of the dent, 0.1 m before the plane.
    gallery = manifold3d.Manifold.cube((0.2, 0.4, 0.4)).translate((LENGTH - 0.3, -0.2, -0.2))
    mesh = from_manifold((tube() - dent()) + gallery)
    end = on_ball(mesh)
    normal, plane = np.array([1.0, 0.0, 0.0]), np.array([LENGTH, 0.0, 0.0])
    before = to_manifold(mesh)
    after = carve_dents(before, mesh, np.flatnonzero(end), plane, normal, VOXEL)
    assert len(after.decompose()) == len(before.decompose()) == 2
    assert min(piece.volume() for piece in after.decompose()) == pytest.approx(0.2 * 0.4 * 0.4)
    assert after.volume() > before.volume()


def test_an_end_that_bulges_outwards_is_left_as_it_was() -> None:
    ball = manifold3d.Manifold.sphere(DENT_RADIUS, SECTIONS).translate((LENGTH - 0.75, 0, 0))
    mesh = from_manifold(tube() ^ (ball + manifold3d.Manifold.cube((LENGTH, 4, 4)).translate((0, -2, -2))))
    end = np.flatnonzero(mesh.triangles[..., 0].min(axis=1) > LENGTH - 1e-3)
    solid = to_manifold(mesh)
    rim, normal = np.array([LENGTH - 1e-3, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    assert carve_dents(solid, mesh, end, rim, normal, VOXEL) is solid


def test_a_passage_that_goes_on_beside_an_end_stays_whole() -> None:
    # The first tube ends at LENGTH, the second runs on 0.1 m beside it, through the box that the first's cut takes.
    y = 2.0 * RADIUS + 0.1
    rear = manifold3d.Manifold.cube((1.0, 4.1, 2.0)).translate((0.0, -1.0, -1.0))
    beside = manifold3d.Manifold.cylinder(LENGTH + 4.0, RADIUS, circular_segments=SECTIONS).rotate((0, 90, 0))
    beside = beside.translate((0, y, 0))
    cavity = cut((tube() - dent()) + rear + beside)
    prove_watertight(cavity.mesh)
    check_end(cavity, LENGTH - 0.5 * DEPTH)
    kept = tube().trim_by_plane((-1.0, 0.0, 0.0), -(LENGTH - 0.5 * DEPTH)) + rear + beside
    assert cavity.volume == pytest.approx(kept.volume(), rel=1e-3)


def test_cameras_that_a_dent_shuts_out_are_kept_in_water() -> None:
    cameras = np.array([[LENGTH - 0.3, 0.0, 0.0], [4.0, 0.0, 0.0]])
    x = LENGTH - 0.3 + CAMERA_VOXELS * VOXEL
    cavity = cut(tube() - dent(), cameras=cameras)
    prove_watertight(cavity.mesh)
    check_end(cavity, x)
    assert cavity.volume == pytest.approx(TUBE_AREA * x, rel=FACETS)


def test_folds_in_an_end_that_runs_into_a_missing_floor_are_carved_out() -> None:
    # The patch is the end, a cone in its middle with sides 63 degrees off, and 3 m of the floor: by direction it falls
    # apart.
    cone = manifold3d.Manifold.cylinder(0.3, 0.35, 0.5, SECTIONS).rotate((0, 90, 0)).translate((LENGTH - 0.3, 0, 0))
    mesh = from_manifold(tube().trim_by_plane((-1.0, 0.0, 0.0), -LENGTH).refine_to_length(0.2) - cone)
    x, z = mesh.triangles[..., 0], mesh.triangles[..., 2]
    is_floor = (x.min(axis=1) > LENGTH - 3.0) & (z.max(axis=1) < -0.7)
    is_cone = (mesh.triangles[..., 1:] ** 2).sum(axis=2).max(axis=1) < 0.9**2
    is_scan = ~(is_floor | (is_cone & (x.min(axis=1) > 1.0)) | (x.min(axis=1) > LENGTH - 1e-6) | (x.max(axis=1) < 1e-9))
    closed = ClosedSurface(mesh, is_scan, "winding")
    openings = find_openings(closed, MIN_PORTAL)
    camera = np.array([[LENGTH - 0.2, 0.0, 0.0]])
    cavity = cut_portals(closed, Mesh(mesh.vertices, mesh.faces[is_scan]), openings, VOXEL, cameras=camera)
    prove_watertight(cavity.mesh)
    assert cavity.mesh.to_trimesh().contains(camera).all()
    (end,) = (lid for lid in cavity.portals if lid.centre[0] > 1.0)
    assert end.area == pytest.approx(TUBE_AREA, rel=FACETS)


def test_an_end_that_cannot_be_carved_cleanly_is_cut_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def carve_badly(solid: Any, *_: Any, **__: Any) -> Any:
        return manifold3d.Manifold.compose([solid, solid.scale((0.9, 0.9, 0.9)).rotate((3, 0, 0))])

    monkeypatch.setattr(portals, "carve_dents", carve_badly)
    cameras = np.array([[LENGTH - 0.3, 0.0, 0.0], [4.0, 0.0, 0.0]])
    cavity = cut(tube() - dent(), cameras=cameras)
    prove_watertight(cavity.mesh)
    assert len(cavity.portals) == 2
    assert cavity.mesh.to_trimesh().contains(cameras).tolist() == [False, True]


def test_a_camera_behind_observed_rock_moves_no_end() -> None:
    pillar = manifold3d.Manifold.cylinder(4.0, 0.2, circular_segments=8).rotate((0, 90, 0)).translate((6.0, 0.0, 0.0))
    solid = tube() - dent() - pillar
    inside_rock = np.array([[LENGTH - 0.3, 0.0, 0.0]])
    assert cut(solid, cameras=inside_rock).volume == cut(solid).volume
    before_water = np.array([[LENGTH - 0.3, 0.0, 0.4]])
    assert cut(solid, cameras=before_water).volume > cut(solid).volume
