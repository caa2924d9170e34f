from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.closing.free_space import FreeSpace, contradictions
from aquanav_tools.cave.closing.reconstruct import ClosedScan, ReconstructionOptions, close_scan, close_surface
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Mesh
from tests.cave.open_caves import LENGTH, disc, joined, straight, tube_volume
from tests.cave.sights import sight_of

VOXEL = 0.1


def two_tubes(gap: float) -> Mesh:
    tube = straight()
    length = np.ptp(tube.vertices[:, 0])
    other = tube.vertices + [length + gap, 0.0, 0.0]
    return Mesh(np.vstack([tube.vertices, other]), np.vstack([tube.faces, tube.faces + len(other)]))


def close(mesh: Mesh, free_space: FreeSpace):
    surface = surface_from_mesh(mesh, VOXEL).mesh
    return close_surface(surface, ReconstructionOptions(VOXEL, 0.8), free_space)


def test_points_and_legs_in_rock_are_found() -> None:
    closed = close(straight(), FreeSpace())
    inside = np.array([[5.0, 0.0, 0.0], [5.0, 3.0, 0.0], [5.0, 1.05, 0.0]])
    legs = np.array([[[1.0, 0, 0], [9.0, 0, 0]], [[1.0, 0, 0], [1.0, 4.0, 0]]])
    found = contradictions(closed.mesh, FreeSpace(inside, legs), VOXEL)
    # The third point lies half a voxel behind the wall, where stations are marked.
    assert found.points.tolist() == [1]
    assert found.legs.tolist() == [1]


def test_two_separate_caves_are_refused_unless_a_point_names_one() -> None:
    apart = two_tubes(3.0)
    with pytest.raises(MeshError, match=r"two separate caves: .* choose one with --inside") as refusal:
        close(apart, FreeSpace())
    assert len(refusal.value.places) == 2
    second = close(apart, FreeSpace(np.array([[18.0, 0.0, 0.0]])))
    assert second.mesh.vertices[:, 0].min() > 11.0
    assert second.mesh.to_trimesh().volume == pytest.approx(tube_volume(10.0), rel=0.02)


def test_a_leg_through_a_stretch_that_was_not_scanned_keeps_it_open() -> None:
    legs = np.array([[[5.0, 0.0, 0.0], [16.0, 0.0, 0.0]]])
    free_space = FreeSpace(legs=legs)
    closed = close(two_tubes(1.0), free_space)
    assert contradictions(closed.mesh, free_space, VOXEL).count == 0
    assert np.ptp(closed.mesh.vertices[:, 0]) == pytest.approx(21.0, abs=4 * VOXEL)


def cavity_in(mesh: Mesh, free_space: FreeSpace, *, keep_triangles: bool = True) -> ClosedScan:
    surface = surface_from_mesh(mesh, VOXEL)
    return close_scan(surface, ReconstructionOptions(VOXEL, 0.8, keep_triangles=keep_triangles), free_space)


def test_water_that_the_scan_contradicts_is_an_error() -> None:
    with pytest.raises(MeshError, match="1 places and 0 legs that are known to be water end up in rock"):
        cavity_in(straight(), FreeSpace(np.array([[5.0, 5.0, 0.0]])))


def test_water_that_the_scan_contradicts_is_a_caution_where_that_is_accepted() -> None:
    free_space = FreeSpace(np.array([[5.0, 5.0, 0.0]]))
    surface = surface_from_mesh(straight(), VOXEL)
    scan = close_scan(surface, ReconstructionOptions(VOXEL, 0.8, accept_open=True), free_space)
    assert [code for code, _ in scan.closed.cautions] == ["known-water-in-rock"]
    assert scan.cavity.volume == pytest.approx(tube_volume(LENGTH), rel=0.05)  # resampled, its ends cut a voxel inwards


def half_open() -> Mesh:
    """A tube whose lower half was scanned to 8 m only: what is invented across its end slants inwards."""
    mesh = straight()
    x, _, z = mesh.triangles.mean(axis=1).T
    return Mesh(mesh.vertices, mesh.faces[(x < 8.0) | (z > 0.0)])


def test_an_end_is_drawn_out_to_the_cameras_that_were_shut_out_of_it() -> None:
    cameras = np.array([[3.0, 0.0, 0.0], [6.0, 0.0, 0.0], [9.3, 0.0, -0.2]])
    legs = np.stack([cameras[:-1], cameras[1:]], axis=1)
    free_space = FreeSpace(cameras, legs, sight_of(straight(), cameras, 0.0))
    scan = cavity_in(half_open(), free_space, keep_triangles=False)
    undrawn = close_surface(half_open(), ReconstructionOptions(VOXEL, 0.8, keep_triangles=False), free_space)
    shut_out = contradictions(undrawn.mesh, free_space, VOXEL)
    assert shut_out.points.tolist() == [2]
    assert shut_out.legs.tolist() == [1]
    assert contradictions(scan.cavity.mesh, free_space, VOXEL).count == 0
    assert scan.cavity.mesh.to_trimesh().contains(cameras).all()
    assert len(scan.cavity.portals) == 2
    assert tube_volume(8.0) < scan.cavity.volume < tube_volume(LENGTH)


def test_a_camera_that_nothing_opens_to_is_dug_free_along_a_leg() -> None:
    # Beyond a wall across the passage, scanned from one side: no end that could be drawn out.
    cameras = np.array([[3.0, 0.0, 0.0], [6.0, 0.0, 0.0], [8.0, 0.0, 0.0]])
    legs = np.stack([cameras[:-1], cameras[1:]], axis=1)
    mesh = straight()
    middles = mesh.triangles.mean(axis=1)
    blind = joined(Mesh(mesh.vertices, mesh.faces[middles[:, 0] < 7.0]), disc(7.0, 0.01, 1.0))
    free_space = FreeSpace(cameras, legs)
    assert contradictions(cavity_in(blind, free_space).closed.mesh, free_space, VOXEL).count == 0
