"""Where open ends are cut, and that cameras which were in the water stay in it."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np
import pytest

from aquanav_tools.cave.cavity import Cavity, from_manifold, prove_watertight
from aquanav_tools.cave.closing.ends import CAMERA_VOXELS, End, find_ends, without_passed
from aquanav_tools.cave.closing.free_space import FreeSpace
from aquanav_tools.cave.closing.openings import find_openings
from aquanav_tools.cave.closing.portals import cut_portals
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_scan
from aquanav_tools.cave.closing.solid import ClosedSurface
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.geometry.mesh.handles import genus
from aquanav_tools.types import Array, Mesh
from tests.cave.open_caves import RADIUS, straight, tube_volume
from tests.cave.sights import sight_of

VOXEL = 0.1
MIN_PORTAL = 0.8
SECTIONS = 48
LENGTH = 8.0
BALL = 1.25
"""Radius of a ball around a point 0.75 m from LENGTH: it meets the tube's wall there."""


def solid_tube(y: float = 0.0) -> Any:
    """A solid along x, its end at LENGTH bulging out of that."""
    tube = manifold3d.Manifold.cylinder(LENGTH + 1.0, RADIUS, circular_segments=SECTIONS).rotate((0, 90, 0))
    ball = manifold3d.Manifold.sphere(BALL, SECTIONS).translate((LENGTH - 0.75, 0, 0))
    return (tube ^ (ball + manifold3d.Manifold.cube((LENGTH, 4, 4)).translate((0, -2, -2)))).translate((0, y, 0))


def closed_solid(solid: Any, *bulges_at: float) -> ClosedSurface:
    """A closed surface of which nobody scanned what bulges out of LENGTH at some y, and x = 0."""
    mesh = from_manifold(solid)
    x, y = mesh.triangles[..., 0], mesh.triangles[..., 1]
    beyond = x.min(axis=1) > LENGTH - 1e-3
    bulges = [beyond & (np.abs(y - at).max(axis=1) < RADIUS + 1e-3) for at in bulges_at]
    return ClosedSurface(mesh, ~np.any([x.max(axis=1) < 1e-9, *bulges], axis=0), "winding")


def cut(closed: ClosedSurface) -> Cavity:
    ends = find_ends(find_openings(closed, MIN_PORTAL), closed.mesh, VOXEL)
    assert all(end.column is None for end in ends)
    scan = Mesh(closed.mesh.vertices, closed.mesh.faces[closed.is_scan])
    return cut_portals(closed, scan, ends, VOXEL)


def check_lid(cavity: Cavity, y: float) -> None:
    (lid,) = (lid for lid in cavity.portals if np.linalg.norm(lid.centre - [LENGTH, y, 0.0]) < 0.05)
    assert lid.area == pytest.approx(tube_volume(1.0), rel=3e-3)


def test_two_ends_beside_each_other_keep_their_lids() -> None:
    rear = manifold3d.Manifold.cube((1.0, 4.6, 2.0)).translate((0.0, -1.0, -1.0))
    y = 2.0 * RADIUS + 0.6
    cavity = cut(closed_solid(solid_tube() + solid_tube(y) + rear, 0.0, y))
    prove_watertight(cavity.mesh)
    check_lid(cavity, 0.0)
    check_lid(cavity, y)


def test_a_passage_that_goes_on_beside_an_end_stays_whole() -> None:
    # The first tube ends at LENGTH, the second runs on 0.1 m beside it, through the box that the first's cut takes.
    y = 2.0 * RADIUS + 0.1
    rear = manifold3d.Manifold.cube((1.0, 4.1, 2.0)).translate((0.0, -1.0, -1.0))
    beside = manifold3d.Manifold.cylinder(LENGTH + 4.0, RADIUS, circular_segments=SECTIONS).rotate((0, 90, 0))
    beside = beside.translate((0, y, 0))
    cavity = cut(closed_solid(solid_tube() + rear + beside, 0.0))
    prove_watertight(cavity.mesh)
    check_lid(cavity, 0.0)
    kept = solid_tube().trim_by_plane((-1.0, 0.0, 0.0), -LENGTH) + rear + beside
    assert cavity.volume == pytest.approx(kept.volume(), rel=1e-3)


def test_a_rock_that_ends_freely_beyond_a_cut_becomes_no_pillar() -> None:
    def box(low: Array, high: Array) -> Any:
        return manifold3d.Manifold.cube(tuple(high - low)).translate(tuple(low))

    # A finger along the passage, 0.15 m from its wall, from a foot 0.04 m before the cut to a tip 0.06 m beyond.
    foot = box(np.array([LENGTH - 0.04, -0.05, 0.8]), np.array([LENGTH - 0.02, 0.05, 1.1]))
    finger = box(np.array([LENGTH - 0.04, -0.05, 0.8]), np.array([LENGTH + 0.06, 0.05, 0.84]))
    closed = closed_solid(solid_tube() - foot - finger, 0.0)
    assert genus(closed.mesh) == genus(cut(closed).mesh) == 0
    whole = solid_tube().trim_by_plane((-1.0, 0.0, 0.0), -LENGTH)
    assert cut(closed).volume == pytest.approx(whole.volume(), rel=0.05 * VOXEL)


def end_of(closed: ClosedSurface, cameras: Array) -> End:
    ends = find_ends(find_openings(closed, MIN_PORTAL), closed.mesh, VOXEL, cameras)
    return max(ends, key=lambda end: float(end.point[0]))


def test_a_camera_behind_observed_rock_moves_no_end() -> None:
    dent = manifold3d.Manifold.sphere(BALL, SECTIONS).translate((LENGTH + 0.75, 0, 0))
    dent = dent + manifold3d.Manifold.cube((3.0, 2.5, 3.0)).translate((LENGTH + 0.5, -1.25, -1.5))
    pillar = manifold3d.Manifold.cylinder(4.0, 0.2, circular_segments=8).rotate((0, 90, 0)).translate((6.0, 0.0, 0.0))
    mesh = from_manifold(solid_tube() - dent - pillar)
    distance = np.linalg.norm(mesh.triangles - [LENGTH + 0.75, 0.0, 0.0], axis=2)
    is_dent = (distance.max(axis=1) < BALL + 1e-6) & (distance.min(axis=1) > BALL - 0.02)
    closed = ClosedSurface(mesh, ~(is_dent | (mesh.triangles[..., 0].max(axis=1) < 1e-9)), "winding")
    far, behind, ahead = (np.array([place]) for place in ([4.0, 0, 0], [LENGTH + 0.2, 0, 0], [LENGTH + 0.2, 0, 0.4]))
    rim = end_of(closed, far).point[0]
    assert rim == pytest.approx(LENGTH, abs=1e-6)
    assert end_of(closed, behind).point[0] == rim
    assert end_of(closed, ahead).point[0] == pytest.approx(LENGTH + 0.2 + CAMERA_VOXELS * VOXEL)


def slanted_scan() -> Mesh:
    """A tube whose end leans by 45 degrees: its floor reaches to x = 9, its roof to x = 7."""
    mesh = straight()
    middles = mesh.triangles.mean(axis=1)
    return Mesh(mesh.vertices, mesh.faces[middles[:, 0] + middles[:, 2] < LENGTH])


def closed_with(scan: Mesh, cameras: Array) -> Cavity:
    free_space = FreeSpace(sight=sight_of(scan, cameras, 0.0))
    surface = surface_from_mesh(scan, VOXEL)
    return close_scan(surface, ReconstructionOptions(VOXEL, MIN_PORTAL, keep_triangles=False), free_space).cavity


def test_a_slanted_end_is_drawn_out_along_the_way_that_cameras_took_and_past_them() -> None:
    cameras = np.array([[x, 0.0, 0.0] for x in (2.0, 4.0, 6.0, 7.0, 8.0, 8.5)])
    cavity = closed_with(slanted_scan(), cameras)
    prove_watertight(cavity.mesh)
    assert cavity.mesh.to_trimesh().euler_number == 2
    assert cavity.mesh.to_trimesh().contains(cameras).all()
    end = max(cavity.portals, key=lambda lid: lid.centre[0])
    assert np.degrees(np.arccos(end.normal[0])) < 2.0
    assert end.centre[0] == pytest.approx(8.5 + CAMERA_VOXELS * VOXEL, abs=VOXEL)
    # The wall that is drawn out lies within half a voxel of the tube's.
    assert end.area == pytest.approx(tube_volume(1.0), rel=VOXEL / RADIUS)
    start = min(lid.centre[0] for lid in cavity.portals)
    assert cavity.volume == pytest.approx(tube_volume(end.centre[0] - start), rel=0.02)


def test_cameras_that_went_to_and_fro_do_not_turn_a_cut() -> None:
    around = [[7.8, 0.6 * np.cos(a), 0.6 * np.sin(a)] for a in np.linspace(0.0, 2 * np.pi, 6, endpoint=False)]
    cavity = closed_with(slanted_scan(), np.array(around))
    end = max(cavity.portals, key=lambda lid: lid.centre[0])
    assert np.degrees(np.arccos(end.normal @ [np.sqrt(0.5), 0.0, np.sqrt(0.5)])) < 5.0
    assert cavity.mesh.to_trimesh().contains(np.array(around)).all()


def test_an_end_that_runs_into_a_missing_floor_keeps_its_cameras() -> None:
    mesh = straight()
    middles = mesh.triangles.mean(axis=1)
    is_floor = (middles[:, 0] > 5.0) & (middles[:, 2] < -0.7 * RADIUS)
    is_roof = (middles[:, 0] > 8.5) & (middles[:, 2] > 0.5 * RADIUS)
    cameras = np.array([[x, 0.0, 0.0] for x in (2.0, 4.0, 6.0, 8.0, 9.0, 9.5)])
    cavity = closed_with(Mesh(mesh.vertices, mesh.faces[~(is_floor | is_roof)]), cameras)
    prove_watertight(cavity.mesh)
    assert cavity.mesh.to_trimesh().contains(cameras).all()
    assert cavity.mesh.to_trimesh().euler_number == 2
    end = max(cavity.portals, key=lambda lid: lid.centre[0])
    assert np.degrees(np.arccos(end.normal[0])) < 10.0


def test_a_ragged_end_is_cut_at_the_middle_of_its_rim_or_outside_of_its_cameras() -> None:
    mesh = straight()
    middles = mesh.triangles.mean(axis=1)
    teeth = 0.4 * np.cos(2.0 * np.arctan2(middles[:, 2], middles[:, 1]))
    ragged = Mesh(mesh.vertices, mesh.faces[middles[:, 0] + teeth < LENGTH])  # its rim from 7.6 to 8.4 m

    def end_of(*xs: float) -> float:
        cavity = closed_with(ragged, np.array([[x, 0.0, 0.0] for x in xs]))
        prove_watertight(cavity.mesh)
        start, end = sorted(cavity.portals, key=lambda lid: lid.centre[0])
        assert cavity.volume == pytest.approx(tube_volume(end.centre[0] - start.centre[0]), rel=0.02)
        return float(end.centre[0])

    assert end_of(2.0, 4.0, 6.0) == pytest.approx(LENGTH, abs=VOXEL)
    assert end_of(2.0, 4.0, LENGTH + 0.3) == pytest.approx(LENGTH + 0.3 + CAMERA_VOXELS * VOXEL, abs=VOXEL)


@pytest.mark.filterwarnings("error")
def test_an_end_of_a_single_triangle_is_an_end() -> None:
    mesh = from_manifold(manifold3d.Manifold.cylinder(LENGTH, RADIUS, circular_segments=3).rotate((0, 90, 0)))
    x = mesh.triangles[..., 0]
    is_scan = ~((x.max(axis=1) < 1e-9) | (x.min(axis=1) > LENGTH - 1e-9))
    assert (~is_scan).sum() == 2
    openings = find_openings(ClosedSurface(mesh, is_scan, "winding"), MIN_PORTAL)
    assert [opening.is_portal for opening in openings] == [True, True]


@pytest.mark.parametrize(
    ("xs", "is_end"),
    [
        ((2.0, 4.0, 6.0), True),  # the walk ended before it
        ((2.0, 4.0, 6.0, LENGTH + 0.5), True),  # and a little beyond it: it is drawn out
        ((2.0, 4.0, 6.0, 8.5, 10.5, 12.5), False),
        ((12.5, 10.5, 8.5, 6.0, 4.0, 2.0), False),
        ((2.0, 4.0, 6.0, 14.0), True),  # taken elsewhere: that step was not walked
    ],
)
def test_an_opening_that_was_walked_through_is_no_end(xs: tuple[float, ...], is_end: bool) -> None:
    openings = find_openings(closed_solid(solid_tube(), 0.0), MIN_PORTAL)
    assert sum(opening.is_portal for opening in openings) == 2
    walk = np.array([[x, 0.1, 0.0] for x in xs])
    ends = [one for one in without_passed(openings, walk) if one.is_portal]
    assert len(ends) == (2 if is_end else 1)
    radius = max(opening.radius for opening in openings)
    beside, elsewhere = (
        [one for one in without_passed(openings, walk + [0.0, radii * radius, 0.0]) if one.is_portal]
        for radii in (1.5, 5.0)
    )
    assert len(beside) == len(ends)  # the cut is narrower than the passage that goes on there
    assert len(elsewhere) == 2
