"""Closing with what cameras saw: a passage that was looked through stays open, and an end is told from a hole."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import WALL, prove_watertight
from aquanav_tools.cave.closing.ends import find_ends
from aquanav_tools.cave.closing.free_space import FreeSpace
from aquanav_tools.cave.closing.openings import MAX_REACH, MAX_REACH_IN_VAIN, find_openings
from aquanav_tools.cave.closing.portals import cut_portals
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_scan, close_surface
from aquanav_tools.cave.scan.surface import Surface, surface_from_mesh
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Mesh
from tests.cave.open_caves import LENGTH, RADIUS, disc, joined, straight, tube_volume, without_faces_near
from tests.cave.sights import sight_of

VOXEL = 0.1
MIN_PORTAL = 0.8


def places(*xs: float) -> np.ndarray:
    return np.array([[x, 0.0, 0.0] for x in xs])


def test_false_rock_that_three_cameras_looked_through_is_water() -> None:
    # Two discs 0.4 m apart: to the scan alone, a plug of rock between two caves.
    plugged = joined(straight(), disc(5.0, 0.01, 1.0), disc(5.4, 0.01, -1.0))
    with pytest.raises(MeshError, match="two separate caves"):
        close_surface(plugged, ReconstructionOptions(VOXEL, MIN_PORTAL, keep_triangles=False))
    free_space = FreeSpace(sight=sight_of(straight(), places(1.0, 2.0, 3.0, 4.0), 0.0))
    closed = close_surface(plugged, ReconstructionOptions(VOXEL, MIN_PORTAL, keep_triangles=False), free_space)
    cavity = cut_portals(
        closed, straight(), find_ends(find_openings(closed, MIN_PORTAL, free_space.sight), closed.mesh, VOXEL), VOXEL
    )
    prove_watertight(cavity.mesh)
    assert cavity.mesh.to_trimesh().euler_number == 2
    assert len(cavity.portals) == 2
    # Within two voxels of the wall behind it nothing is carved: a collar of at most the plug's length may stay there.
    collar = tube_volume(0.4 + 2 * VOXEL) * (1.0 - (1.0 - 2.0 * VOXEL) ** 2)
    assert tube_volume(LENGTH) - collar - 4 * VOXEL * tube_volume(1.0) < cavity.volume < 1.01 * tube_volume(LENGTH)


def test_rock_that_one_camera_looked_through_stays_rock() -> None:
    plugged = joined(straight(), disc(5.0, 0.01, 1.0), disc(5.4, 0.01, -1.0))
    free_space = FreeSpace(places(2.0), sight=sight_of(straight(), places(2.0), 0.0))
    closed = close_surface(plugged, ReconstructionOptions(VOXEL, MIN_PORTAL, keep_triangles=False), free_space)
    assert closed.mesh.vertices[:, 0].max() < 5.0 + VOXEL


@pytest.mark.parametrize(("looks_out", "num_portals"), [(True, 2), (False, 1)])
def test_an_end_with_a_swollen_rim_is_one_where_cameras_looked_into_the_dark(looks_out: bool, num_portals: int) -> None:
    inner = RADIUS / 1.5
    assert MAX_REACH < RADIUS / inner < MAX_REACH_IN_VAIN
    scan = surface_from_mesh(joined(straight(), disc(LENGTH, inner, 1.0)), VOXEL).mesh
    closed = close_surface(scan, ReconstructionOptions(VOXEL, MIN_PORTAL))
    sight = sight_of(straight(), places(6.0, 7.0, 8.0), 0.0 if looks_out else 180.0)
    assert (
        len(
            cut_portals(
                closed, scan, find_ends(find_openings(closed, MIN_PORTAL, sight), closed.mesh, VOXEL), VOXEL
            ).portals
        )
        == num_portals
    )
    assert sum(opening.is_portal for opening in find_openings(closed, MIN_PORTAL)) == 1


@pytest.mark.parametrize("pitch_deg", [-60.0, 0.0])
def test_a_hole_in_the_wall_is_filled_and_unobserved_whether_anyone_looked_or_not(pitch_deg: float) -> None:
    scan = surface_from_mesh(without_faces_near(straight(), np.array([5.0, 0.0, RADIUS]), 0.6), VOXEL).mesh
    closed = close_surface(scan, ReconstructionOptions(VOXEL, MIN_PORTAL))
    sight = sight_of(scan, places(2.0, 2.5, 3.0, 3.5), 0.0, pitch_deg)
    cavity = cut_portals(closed, scan, find_ends(find_openings(closed, MIN_PORTAL, sight), closed.mesh, VOXEL), VOXEL)
    assert len(cavity.portals) == 2
    unseen = (cavity.labels == WALL) & ~cavity.observed
    middles = cavity.mesh.triangles[unseen].mean(axis=1)
    assert np.linalg.norm(middles - [5.0, 0.0, RADIUS], axis=1).max() < 0.6 + VOXEL
    assert 0.0 < cavity.mesh.areas[unseen].sum() < np.pi * 0.7**2


def test_wall_that_photos_show_where_the_scan_has_none_opens_no_tunnel() -> None:
    # The tube ends at 7 m; the photos' depths go on to 9.8 m, as where they show nothing but one plain colour.
    middles = straight().triangles.mean(axis=1)
    blind = joined(Mesh(straight().vertices, straight().faces[middles[:, 0] < 7.0]), disc(7.0, 0.01, 1.0))
    sight = sight_of(joined(straight(), disc(9.8, 0.01, 1.0)), places(3.0, 4.0, 5.0, 6.0), 0.0)
    assert (sight.votes(places(7.5, 8.5), 2.0 * VOXEL)[:, 0] >= 3).all()
    closed = close_surface(
        blind, ReconstructionOptions(VOXEL, MIN_PORTAL, keep_triangles=False), FreeSpace(sight=sight)
    )
    assert closed.mesh.vertices[:, 0].max() < 7.0 + VOXEL


def test_cameras_above_walls_without_a_ceiling_get_room_around_them() -> None:
    # A trench 1 m deep and 5 m long, photographed from 0.4 m above its walls: all that closes it lies below the photos.
    box = trimesh.creation.box((5.0, 1.2, 1.0)).subdivide_to_size(0.1)
    is_open = (box.triangles[:, :, 2] > 0.5 - 1e-9).all(axis=1)
    trench = Mesh(np.array(box.vertices), np.array(box.faces[~is_open], dtype=np.int64))
    centres = np.array([[x, 0.0, 0.9] for x in np.arange(-1.5, 1.6, 0.5)])
    down = np.stack([centres, centres - [0.0, 0.0, 0.9]], axis=1)
    legs = np.concatenate([np.stack([centres[:-1], centres[1:]], axis=1), down])
    free_space = FreeSpace(centres, legs, sight_of(trench, centres, 0.0, -60.0))
    surface = Surface(trench, trench.vertices)
    options = ReconstructionOptions(0.06, 0.8, keep_triangles=False, accept_open=True)
    scan = close_scan(surface, options, free_space)
    prove_watertight(scan.cavity.mesh)
    assert "known-water-in-rock" not in dict(scan.closed.cautions)
    mesh = scan.cavity.mesh
    assert mesh.to_trimesh().contains(centres).all()
    squared = igl.point_mesh_squared_distance(centres, mesh.vertices, mesh.faces)[0]
    assert np.sqrt(squared.min()) > 0.2 - 0.06  # a quarter of the narrowest portal, less a voxel
    assert 5.0 * 1.2 * 1.0 * 0.9 < scan.cavity.volume < 5.0 * 1.2 * 1.6
