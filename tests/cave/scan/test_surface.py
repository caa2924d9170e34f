from __future__ import annotations

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.cave.scan.resolution import choose_resolution
from aquanav_tools.cave.scan.surface import surface_from_mesh, without_gaps
from aquanav_tools.errors import InputError, UnseenWallsError
from aquanav_tools.types import Mesh, PointCloud
from tests.cave.open_caves import RADIUS, straight

VOXEL = 0.1


def dense_tube(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points on the tube's wall, evenly."""
    angle, x = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.0, 10.0, count)
    return np.stack([x, RADIUS * np.cos(angle), RADIUS * np.sin(angle)], axis=1)


def radii(mesh: Mesh) -> np.ndarray:
    return np.linalg.norm(mesh.vertices[:, 1:], axis=1)


def test_spikes_are_taken_off() -> None:
    tube = straight()
    vertices = tube.vertices.copy()
    inner = np.flatnonzero(np.abs(vertices[:, 0] - 5.0) < 4.0)[::300]
    vertices[inner] *= [1.0, 2.5, 2.5]
    surface = surface_from_mesh(Mesh(vertices, tube.faces), VOXEL)
    assert radii(surface.mesh).max() < 1.01 * RADIUS
    assert surface.dropped_share > 0.0


def test_the_middle_of_a_fan_is_no_spike() -> None:
    """Modelled and decimated walls have long narrow triangles around one vertex, here in the end of a tube."""
    tube = straight()
    rim = np.flatnonzero(np.isclose(tube.vertices[:, 0], tube.vertices[:, 0].max()))
    rim = rim[np.argsort(np.arctan2(*tube.vertices[rim, 1:].T))]
    middle = tube.vertices[rim].mean(axis=0)
    fan = np.stack([rim, np.roll(rim, -1), np.full(len(rim), len(tube.vertices))], axis=1)
    surface = surface_from_mesh(Mesh(np.vstack([tube.vertices, middle]), np.vstack([tube.faces, fan])), VOXEL)
    assert surface.dropped_share == 0.0


def test_stray_objects_are_left_out_but_fragments_of_a_soup_are_not() -> None:
    tube = straight()
    ball = trimesh.creation.icosphere(1, 0.1).apply_translation([5.0, 4.0, 0.0])
    both = trimesh.util.concatenate([tube.to_trimesh(), ball])
    surface = surface_from_mesh(Mesh(np.array(both.vertices), np.array(both.faces)), VOXEL)
    assert len(surface.mesh.faces) == len(tube.faces)
    soup = Mesh(
        tube.triangles.reshape(-1, 3) * (1.0 + 1e-6 * np.arange(3 * len(tube.faces))[:, None] % 1e-3), soup_faces(tube)
    )
    assert len(surface_from_mesh(soup, VOXEL).mesh.faces) > 0.99 * len(tube.faces)


def soup_faces(mesh: Mesh) -> np.ndarray:
    return np.arange(3 * len(mesh.faces)).reshape(-1, 3)


def test_a_second_layer_behind_the_closed_wall_does_not_count() -> None:
    tube = straight()
    blister = trimesh.creation.box([1.0, 0.05, 0.5]).subdivide().subdivide().subdivide()
    blister.apply_translation([5.0, RADIUS + 0.3, 0.0])
    both = trimesh.util.concatenate([tube.to_trimesh(), blister])
    surface = surface_from_mesh(Mesh(np.array(both.vertices), np.array(both.faces)), 0.01)
    closed = straight()
    kept = without_gaps(surface, closed, VOXEL)
    assert radii(kept.mesh).max() < 1.01 * RADIUS
    assert kept.dropped_share > surface.dropped_share


def test_faces_without_area_are_refused() -> None:
    with pytest.raises(InputError, match="None of the scan's 1 triangles has an area"):
        surface_from_mesh(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])), VOXEL)


def test_outliers_of_a_cloud_leave_no_trace(rng: np.random.Generator) -> None:
    wall = dense_tube(20_000, rng)
    strays = rng.uniform([-2.0, -4.0, -4.0], [12.0, 4.0, 4.0], (200, 3))
    surface = surface_from_cloud(PointCloud(np.vstack([wall, strays])), VOXEL)
    assert np.abs(radii(surface.mesh) - RADIUS).max() < VOXEL
    assert 0.0 < surface.dropped_share < 0.05


def test_normals_of_a_cloud_are_not_believed(rng: np.random.Generator) -> None:
    wall = dense_tube(20_000, rng)
    outward = wall * [0.0, 1.0, 1.0] / RADIUS
    mixed = np.where(rng.random((len(wall), 1)) < 0.5, outward, -outward)
    surface = surface_from_cloud(PointCloud(wall, mixed), VOXEL)
    assert np.abs(radii(surface.mesh) - RADIUS).max() < VOXEL


def test_a_cloud_that_thins_out_keeps_its_thin_end(rng: np.random.Generator) -> None:
    wall = dense_tube(40_000, rng)
    kept = rng.random(len(wall)) < np.exp(-wall[:, 0] / 3.5)  # a seventeenth at the far end
    surface = surface_from_cloud(PointCloud(wall[kept]), VOXEL)
    assert surface.mesh.vertices[:, 0].max() > 9.0
    # At the thin end the points are two voxels apart, and the surface bulges over the last of them.
    assert np.percentile(np.abs(radii(surface.mesh) - RADIUS), 95) < VOXEL


def test_the_voxel_of_a_noisy_cloud_grows_with_its_noise(rng: np.random.Generator) -> None:
    wall = dense_tube(40_000, rng)
    noisy = wall + rng.normal(0.0, 0.04, wall.shape)
    resolution = choose_resolution(PointCloud(noisy), 0.2, 4.0)
    assert resolution.reason == "the noise of the surface"
    # Half of all normal errors are below 0.67 sigma; planes through neighbours take up a little of it.
    assert resolution.voxel == pytest.approx(4.0 * 0.67 * 0.04, rel=0.15)


def test_relief_of_a_decimated_mesh_is_no_noise() -> None:
    tube = straight()
    assert choose_resolution(tube, 0.2, 4.0).reason != "the noise of the surface"


def test_points_that_fill_a_volume_are_no_wall(rng: np.random.Generator) -> None:
    points = rng.uniform(0.0, 5.0, (5000, 3))
    with pytest.raises(UnseenWallsError, match=r"points lie on no surface: .* 0\.8. times as thick as wide") as caught:
        surface_from_cloud(PointCloud(points), 0.3)
    error = caught.value
    assert error.code == "scattered-points"
    assert "at most 0.76 is taken for wall" in error.facts  # and on what that was measured
    assert "--accept-open" in str(error)
    assert "photos" not in str(error)  # nobody took any
    assert 2 <= len(error.places) <= 9
    assert all(0.0 <= value <= 5.0 for place, _ in error.places for value in place)


def test_scattered_points_of_photos_are_not_called_a_wrong_file(rng: np.random.Generator) -> None:
    points, normals = rng.uniform(0.0, 5.0, (20_000, 3)), np.tile([0.0, 0.0, 1.0], (20_000, 1))
    cloud = PointCloud(points, normals, num_photos=np.full(20_000, 3), spread=np.zeros(20_000))
    with pytest.raises(UnseenWallsError, match="The photos do not agree on how far the wall is"):
        surface_from_cloud(cloud, 0.3)


def photographed(points: np.ndarray, num_photos: np.ndarray) -> PointCloud:
    """Points that so many photos agree on, taken from the tube's axis."""
    towards = points * [0.0, -1.0, -1.0]
    normals = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    return PointCloud(points, normals, num_photos=num_photos, spread=np.zeros(len(points)))


def test_strays_that_fill_more_cells_than_the_wall_do_not_outvote_it(rng: np.random.Generator) -> None:
    """Thinned to one point per cell, three in four are strays; of what photos confirm, one in ten is."""
    wall, inside = dense_tube(100_000, rng), dense_tube(60_000, rng)
    strays = inside * np.column_stack([np.ones(60_000), *[rng.uniform(0.4, 1.0, 60_000)] * 2])
    points, is_wall = np.vstack([wall, strays]), np.arange(160_000) < 100_000
    judging = surface_from_cloud(photographed(points, np.where(is_wall, 10, 2)), VOXEL).points
    is_on_wall = np.abs(np.linalg.norm(judging[:, 1:], axis=1) - RADIUS) < 0.5 * VOXEL
    assert is_on_wall.mean() > 0.85  # 100,000 * 10 of 100,000 * 10 + 60,000 * 2 are 89 %
    alike = photographed(np.vstack([wall[::10], strays]), np.full(70_000, 2))
    with pytest.raises(UnseenWallsError, match="points asked, each as often as photos confirm it, of"):
        surface_from_cloud(alike, VOXEL)


def test_a_volume_is_no_wall_however_unevenly_photos_confirm_it(rng: np.random.Generator) -> None:
    points, normals = rng.uniform(0.0, 5.0, (20_000, 3)), np.tile([0.0, 0.0, 1.0], (20_000, 1))
    votes = np.ceil(rng.lognormal(1.0, 2.0, 20_000)).astype(np.int64) + 1  # as unevenly as of a real kitchen's cells
    with pytest.raises(UnseenWallsError, match=r"0\.8. times as thick as wide"):
        surface_from_cloud(PointCloud(points, normals, num_photos=votes, spread=np.zeros(20_000)), 0.3)


def test_scattered_points_can_be_accepted(rng: np.random.Generator) -> None:
    surface = surface_from_cloud(PointCloud(rng.uniform(0.0, 5.0, (5000, 3))), 0.3, accept_thick=True)
    assert len(surface.mesh.faces) > 100
