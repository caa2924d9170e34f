from __future__ import annotations

import manifold3d
import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import WALL, from_manifold, prove_watertight
from aquanav_tools.cave.closing.ends import find_ends
from aquanav_tools.cave.closing.openings import find_openings
from aquanav_tools.cave.closing.portals import cut_portals
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_surface
from aquanav_tools.cave.closing.solid import ClosedSurface
from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.cave.scan.resolution import choose_resolution
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.errors import InputError, MeshError, ResourceError
from aquanav_tools.types import Mesh, PointCloud
from tests.cave.open_caves import RADIUS, bend, straight, tube_volume, wavy_sheet, without_faces_near

VOXEL = 0.1
MIN_PORTAL = 0.8


def close(mesh: Mesh):
    surface = surface_from_mesh(mesh, VOXEL).mesh
    closed = close_surface(surface, ReconstructionOptions(VOXEL, MIN_PORTAL))
    return closed, cut_portals(closed, surface, find_ends(find_openings(closed, MIN_PORTAL), closed.mesh, VOXEL), VOXEL)


def test_an_open_tube_becomes_a_proven_solid_of_known_volume_with_two_portals() -> None:
    closed, cavity = close(straight())
    prove_watertight(cavity.mesh)
    assert closed.method == "caps"
    assert cavity.volume == pytest.approx(tube_volume(10.0), rel=1e-5)  # float32
    assert len(cavity.portals) == 2
    for portal, x in zip(sorted(cavity.portals, key=lambda lid: lid.centre[0]), (0.0, 10.0), strict=True):
        assert np.allclose(portal.centre, [x, 0, 0], atol=1e-4)
        assert np.allclose(portal.normal, [np.sign(x - 5), 0, 0], atol=1e-4)
        assert portal.area == pytest.approx(tube_volume(1.0), rel=1e-4)


def test_faces_of_portals_are_labelled_and_not_observed() -> None:
    _, cavity = close(straight())
    x = cavity.mesh.triangles[..., 0]
    on_ends = (x.max(axis=1) < 1e-4) | (x.min(axis=1) > 10 - 1e-4)
    assert np.array_equal(cavity.labels != WALL, on_ends)
    assert not cavity.observed[on_ends].any()
    assert cavity.observed_share == pytest.approx(1.0)


def test_inverted_normals_make_no_difference() -> None:
    mesh = straight()
    _, cavity = close(Mesh(mesh.vertices, mesh.faces[:, ::-1]))
    assert cavity.volume == pytest.approx(tube_volume(10.0), rel=1e-5)


def test_a_hole_in_the_wall_is_filled_and_no_portal() -> None:
    _, cavity = close(without_faces_near(straight(), np.array([5.0, RADIUS, 0.0]), 0.5))
    assert len(cavity.portals) == 2
    assert cavity.volume == pytest.approx(tube_volume(10.0), rel=0.02)  # the cap of the hole is flat


def test_the_ends_of_a_low_passage_that_turns_aside_right_behind_them_are_portals() -> None:
    box = trimesh.creation.box([8.0, 4.0, 1.0])
    vertices, faces = trimesh.remesh.subdivide_to_size(box.vertices, box.faces, 0.5)
    is_end = np.abs(vertices[faces][..., 0]).min(axis=1) > 4.0 - 1e-9
    leaning = np.column_stack([vertices[:, 0], vertices[:, 1] + 2.0 * vertices[:, 0], vertices[:, 2]])
    used, kept = np.unique(faces[~is_end], return_inverse=True)
    _, cavity = close(Mesh(leaning[used], kept.reshape(-1, 3)))
    assert sorted(round(float(lid.centre[0]), 3) for lid in cavity.portals) == [-4.0, 4.0]
    assert cavity.volume == pytest.approx(8.0 * 4.0 * 1.0, rel=1e-5)


def test_a_large_hole_in_the_roof_is_no_open_end() -> None:
    _, cavity = close(without_faces_near(straight(), np.array([5.0, 0.0, RADIUS]), 0.9))
    assert len(cavity.portals) == 2
    assert cavity.observed_share < 1.0


def test_an_open_end_that_runs_into_a_hole_in_the_floor_is_cut_straight_across() -> None:
    mesh = straight()
    middles = mesh.triangles.mean(axis=1)
    is_floor = (middles[:, 0] > 5.0) & (middles[:, 2] < -0.7 * RADIUS)
    surface = surface_from_mesh(Mesh(mesh.vertices, mesh.faces[~is_floor]), VOXEL).mesh
    closed = close_surface(surface, ReconstructionOptions(VOXEL, MIN_PORTAL, keep_triangles=False))
    cavity = cut_portals(closed, surface, find_ends(find_openings(closed, MIN_PORTAL), closed.mesh, VOXEL), VOXEL)
    assert len(cavity.portals) == 2
    end = max(cavity.portals, key=lambda portal: portal.centre[0])
    assert end.normal[0] > 0.95
    # The floor is closed by a flat sheet over 5 of 10 m: a circular segment of half angle acos(0.7) less.
    half = np.arccos(0.7)
    segment = RADIUS**2 * (half - np.sin(half) * np.cos(half))
    assert cavity.volume == pytest.approx(tube_volume(10.0) - 5.0 * segment, rel=0.1)


def test_a_soup_with_crossing_sheets_and_scraps_is_resampled_to_the_same_tube() -> None:
    tube = straight().to_trimesh()
    scraps = trimesh.creation.icosphere(1, 0.05).apply_translation([0, 0, 3])
    flap = trimesh.creation.box([0.5, 0.02, 0.02]).apply_translation([5, RADIUS, 0])
    soup = trimesh.util.concatenate([tube, scraps, flap])
    shuffled = Mesh(soup.triangles.reshape(-1, 3), np.arange(3 * len(soup.faces)).reshape(-1, 3))
    # Two faces twice and one inverted: non-manifold edges.
    faces = np.concatenate([shuffled.faces, shuffled.faces[:1], shuffled.faces[1:2, ::-1]])
    _, cavity = close(Mesh(shuffled.vertices, faces))
    prove_watertight(cavity.mesh)
    assert len(cavity.portals) == 2
    assert cavity.volume == pytest.approx(tube_volume(10.0), rel=0.02)


@pytest.mark.parametrize("has_normals", [True, False])
def test_a_noisy_cloud_becomes_the_tube(has_normals: bool, rng: np.random.Generator) -> None:
    tube = straight().to_trimesh()
    points, faces = trimesh.sample.sample_surface(tube, 15_000, seed=0)
    noisy = np.asarray(points) + rng.normal(0.0, 0.005, (len(points), 3))
    cloud = PointCloud(noisy, -tube.face_normals[faces] if has_normals else None)
    voxel = choose_resolution(cloud, 0.2, 4.0).voxel
    surface = surface_from_cloud(cloud, voxel).mesh
    closed = close_surface(surface, ReconstructionOptions(voxel, MIN_PORTAL, keep_triangles=False))
    cavity = cut_portals(closed, surface, find_ends(find_openings(closed, MIN_PORTAL), closed.mesh, voxel), voxel)
    prove_watertight(cavity.mesh)
    assert len(cavity.portals) == 2
    # The cloud ends where the tube ends; trimming and the flat cut may each cost or add a few voxels of length.
    assert cavity.volume == pytest.approx(tube_volume(10.0), abs=8 * voxel * np.pi * RADIUS**2)
    wall = cavity.mesh.vertices[np.unique(cavity.mesh.faces[cavity.labels == WALL])]
    middle = wall[np.abs(wall[:, 0] - 5) < 3.5]
    assert np.abs(np.linalg.norm(middle[:, 1:], axis=1) - RADIUS).max() < voxel


def test_a_bend_keeps_its_volume() -> None:
    _, cavity = close(bend(4.0))
    # Pappus: cross-section times the path of its centroid; the sweep's chords cost 1e-4.
    assert cavity.volume == pytest.approx(tube_volume(np.pi / 2 * 4.0), rel=1e-3)


def test_a_single_wall_encloses_no_space() -> None:
    with pytest.raises(MeshError, match=r"722 triangles encloses no space at 0\.1 m"):
        close(wavy_sheet())


@pytest.mark.parametrize("wave", [0.1, 0.3, 0.5, 0.8])
def test_hollows_under_a_wavy_sheet_are_no_caves(wave: float) -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 8, 80), np.linspace(0, 8, 80), indexing="ij"))
    corner = (80 * np.arange(79)[:, None] + np.arange(79)).ravel()
    faces = [np.stack([corner, corner + 80, corner + 1], 1), np.stack([corner + 1, corner + 80, corner + 81], 1)]
    with pytest.raises(MeshError, match=r"no cave|encloses no space"):
        close(Mesh(np.stack([x, y, wave * np.sin(3 * x)], axis=1), np.concatenate(faces)))


def test_a_voxel_that_does_not_fit_into_memory_is_refused_with_one_that_does() -> None:
    far = Mesh(1000.0 * straight().vertices, straight().faces)
    with pytest.raises(ResourceError, match=r"takes about .* GB, more than the 4\.0 GB allowed\. Give --voxel \d"):
        choose_resolution(far, 0.2, 4.0, wanted=VOXEL)


def test_the_voxel_grows_until_closing_fits_into_memory() -> None:
    far = Mesh(150.0 * straight().vertices, straight().faces)
    resolution = choose_resolution(far, 0.2, 4.0)
    assert resolution.voxel > VOXEL
    assert resolution.memory_gb == pytest.approx(4.0, rel=0.01)
    assert "memory" in resolution.reason


def test_points_in_one_place_are_refused() -> None:
    with pytest.raises(InputError, match="lie in one place"):
        choose_resolution(PointCloud(np.ones((100, 3))), 0.2, 4.0)


@pytest.mark.parametrize("distance", [0.6, 0.9, 1.2])
def test_a_hole_as_wide_as_the_passage_is_no_open_end(distance: float) -> None:
    closed, cavity = close(without_faces_near(straight(), np.array([5.0, 0.0, RADIUS]), distance))
    assert len(cavity.portals) == 2
    assert any(not opening.is_portal for opening in find_openings(closed, MIN_PORTAL))


def test_an_end_cut_slantwise_is_still_an_end() -> None:
    mesh = straight()
    middles = mesh.triangles.mean(axis=1)
    slanted = Mesh(mesh.vertices, mesh.faces[middles[:, 0] + 0.7 * middles[:, 2] < 8.0])
    assert len(close(slanted)[1].portals) == 2


def portals_of_passage(length: float, width: float, height: float, swing: float, has_floor: bool) -> np.ndarray:
    """The normals of the portals of a level passage along x, winding left and right, with two open ends."""
    x = np.linspace(0.0, length, 121)
    y = swing * np.sin(2 * np.pi * x / 10.0)
    outline = np.concatenate([np.column_stack([x, y - width / 2]), np.column_stack([x, y + width / 2])[::-1]])
    mesh = from_manifold(manifold3d.CrossSection([outline]).extrude(height).refine_to_length(0.4))
    along, up = mesh.triangles[..., 0], mesh.triangles[..., 2]
    is_unseen = (along.max(axis=1) < 1e-6) | (along.min(axis=1) > length - 1e-6)
    if not has_floor:
        is_unseen |= up.max(axis=1) < 1e-6
    openings = find_openings(ClosedSurface(mesh, ~is_unseen, "winding"), MIN_PORTAL)
    return np.array([opening.normal for opening in openings if opening.is_portal])


@pytest.mark.parametrize("length", [9.0, 12.0, 20.0])
def test_the_floor_of_a_passage_that_nobody_saw_is_none_of_its_ends(length: float) -> None:
    normals = portals_of_passage(length, 2.0, 2.0, swing=1.0, has_floor=False)
    assert len(normals) == 2
    assert np.allclose(sorted(normals[:, 0]), [-1.0, 1.0])


@pytest.mark.parametrize("height", [0.9, 2.0])
def test_a_low_wide_end_is_an_end(height: float) -> None:
    normals = portals_of_passage(12.0, 12.0, height, swing=0.0, has_floor=True)
    assert np.allclose(sorted(normals[:, 0]), [-1.0, 1.0])
