"""Fusion of exact depth maps of a sphere seen from within: where every point lies, who sees it and how is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import pytest

from aquanav_tools.cave.scan.sight import NO_WALL
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.reconstruct.depth_maps import DepthMaps
from aquanav_tools.reconstruct.fusion import FusedDepth, FusionOptions, fuse_maps
from aquanav_tools.reconstruct.views import View
from aquanav_tools.types import Array

RADIUS, WIDTH, HEIGHT, FOCAL_PX = 2.0, 160, 120, 110.0
PIXEL = RADIUS / FOCAL_PX
"""Width of a pixel on the wall, m."""
OPTIONS = FusionOptions(step=1)


@dataclass(frozen=True, eq=False)
class Photos:
    """Photos of the sphere's inside, each with one colour."""

    folder: Path
    views: list[View]

    def maps(self) -> DepthMaps:
        return DepthMaps(self.folder, self.views, OPTIONS.max_cost)

    def frames_with(self, points: Array, margin: float) -> Array:
        """Return in how many photos (P, 3) points lie at least `margin` px inside the frame."""
        count = np.zeros(len(points), int)
        for view in self.views:
            seen = points @ view.rotation.T + view.translation
            pixels = seen[:, :2] / seen[:, 2:] * FOCAL_PX + [WIDTH / 2, HEIGHT / 2]
            inside = (pixels >= margin) & (pixels <= np.array([WIDTH, HEIGHT]) - margin)
            count += inside.all(axis=1) & (seen[:, 2] > 0.0)
        return count


def exact_depth(view: View) -> tuple[Array, Array]:
    """Return the (H, W) depth of the sphere and its (H, W, 3) normals towards the camera, camera frame."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = np.stack([u / FOCAL_PX, v / FOCAL_PX, np.ones_like(u)], axis=-1)
    middle = view.rotation @ -view.centre  # of the sphere, in the camera's frame
    a, b, c = (rays * rays).sum(-1), rays @ middle, middle @ middle - RADIUS**2
    depth = (b + np.sqrt(b * b - a * c)) / a
    return depth, (middle - rays * depth[..., None]) / RADIUS


def write(photos: Photos, index: int, depth: Array, normals: Array, cost: float = 0.0) -> None:
    path = photos.folder / "depth" / f"{photos.views[index].name}.npz"
    path.parent.mkdir(exist_ok=True)
    kept = {"depth": depth.astype(np.float32), "normals": normals.astype(np.float16)}
    np.savez(path, **kept, cost=np.full(depth.shape, cost, np.float16))


def take_photos(folder: Path) -> Photos:
    """Return six photos from near the middle, all of the same side of the sphere."""
    import cv2

    views = []
    for index, (y, z) in enumerate([(-0.2, 0.0), (-0.1, 0.1), (0.0, -0.1), (0.1, 0.1), (0.2, 0.0), (0.0, 0.2)]):
        rotation = look(0.12 * (index - 2), 0.05 * (index - 3))
        matrix = np.array([[FOCAL_PX, 0, WIDTH / 2], [0, FOCAL_PX, HEIGHT / 2], [0, 0, 1.0]])
        none = np.zeros((0, 3))
        name = f"p{index}.png"
        views.append(
            View(index, name, matrix, rotation, -rotation @ [0.0, y, z], WIDTH, HEIGHT, np.zeros(0, int), none)
        )
    photos = Photos(folder, views)
    (folder / "images").mkdir(parents=True)
    for index, view in enumerate(views):
        write(photos, index, *exact_depth(view))
        colour = np.full((HEIGHT, WIDTH, 3), (200, 100 + index, 50), np.uint8)  # blue, green, red
        cv2.imwrite(str(folder / "images" / view.name), colour)
    return photos


@pytest.fixture
def photos(tmp_path: Path) -> Photos:
    return take_photos(tmp_path)


@pytest.fixture(scope="module")
def fused(tmp_path_factory: pytest.TempPathFactory) -> tuple[Photos, FusedDepth]:
    photos = take_photos(tmp_path_factory.mktemp("sphere"))
    return photos, fuse_maps(photos.maps(), OPTIONS)


def test_points_lie_on_the_sphere_with_normals_to_its_middle(fused: tuple[Photos, FusedDepth]) -> None:
    cloud = fused[1].cloud
    assert len(cloud.points) > WIDTH * HEIGHT
    assert cloud.normals is not None and cloud.spread is not None
    # A plane through another photo's pixel leaves the sphere by the square of half a diagonal over the diameter.
    sagitta = (0.71 * PIXEL) ** 2 / (2.0 * RADIUS)
    distance = np.abs(np.linalg.norm(cloud.points, axis=1) - RADIUS)
    assert distance.max() < 2.0 * sagitta + 1e-6  # seen at 25 degrees at most
    assert cloud.spread.max() < 2.0 * sagitta + 1e-6
    cosine = -np.einsum("ij,ij->i", cloud.normals, cloud.points) / RADIUS
    # Half a pixel's diagonal turns the normal by that over the radius; normals are kept in half precision.
    assert np.degrees(np.arccos(cosine.min())) < np.degrees(0.71 * PIXEL / RADIUS) + 0.1


def test_a_point_is_confirmed_by_as_many_photos_as_have_it_in_their_frame(fused: tuple[Photos, FusedDepth]) -> None:
    photos, cloud = fused[0], fused[1].cloud
    surely, perhaps = photos.frames_with(cloud.points, 1.0), photos.frames_with(cloud.points, 0.0)
    assert cloud.num_photos is not None
    assert ((surely <= cloud.num_photos) & (cloud.num_photos <= perhaps)).all()
    assert cloud.num_photos.max() == len(photos.views)
    # Every pixel that another photo shows too is covered: where two photos see the wall, there are points.
    assert cloud.num_photos.min() == 2


def test_colours_are_the_mean_of_the_photos_that_agree(fused: tuple[Photos, FusedDepth]) -> None:
    photos, cloud = fused[0], fused[1].cloud
    assert cloud.colours is not None and cloud.num_photos is not None
    assert (cloud.colours[:, [0, 2]] == [50, 200]).all()  # red and blue, as RGB
    seen_by_all = cloud.colours[cloud.num_photos == len(photos.views)]
    assert np.abs(seen_by_all[:, 1].astype(float) - 102.5).max() <= 1.0


def test_pixels_without_depth_or_with_a_large_cost_neither_make_nor_confirm_points(photos: Photos) -> None:
    depth, normals = exact_depth(photos.views[0])
    depth[:, WIDTH // 2 :] = 0.0  # a mask
    write(photos, 0, depth, normals)
    write(photos, 1, *exact_depth(photos.views[1]), cost=OPTIONS.max_cost + 0.1)
    fused = fuse_maps(photos.maps(), OPTIONS)
    masked = Photos(photos.folder, photos.views[2:])
    assert fused.cloud.num_photos is not None
    assert (fused.cloud.num_photos <= masked.frames_with(fused.cloud.points, 0.0) + 1).all()
    assert fused.cloud.num_photos.max() == len(photos.views) - 1
    assert (fused.sight.depth[0, :, WIDTH // 2 :] == NO_WALL).all()
    assert (fused.sight.depth[1] == NO_WALL).all()


def test_a_map_that_no_other_confirms_adds_nothing(photos: Photos) -> None:
    before = fuse_maps(Photos(photos.folder, photos.views[1:]).maps(), OPTIONS).cloud
    depth, normals = exact_depth(photos.views[0])
    write(photos, 0, 0.8 * depth, normals)
    fused = fuse_maps(photos.maps(), OPTIONS)
    np.testing.assert_array_equal(fused.cloud.points, before.points)
    assert (fused.sight.depth[0] == NO_WALL).all()


def test_a_thing_that_two_photos_show_but_three_look_through_is_no_wall(photos: Photos) -> None:
    for index in (0, 4):
        view = photos.views[index]
        depth, normals = exact_depth(view)
        ball = view.rotation @ (np.array([1.0, 0.0, 0.0]) - view.centre)
        u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
        rays = np.stack([u / FOCAL_PX, v / FOCAL_PX, np.ones_like(u)], axis=-1)
        a, b, c = (rays * rays).sum(-1), rays @ ball, ball @ ball - 0.2**2
        hits = b * b > a * c
        near = np.where(hits, (b - np.sqrt(np.maximum(b * b - a * c, 0.0))) / a, depth)
        write(photos, index, near, np.where(hits[..., None], (rays * near[..., None] - ball) / 0.2, normals))
    points = fuse_maps(photos.maps(), OPTIONS).cloud.points
    assert (np.linalg.norm(points, axis=1) > 0.99 * RADIUS).all()


def test_the_result_is_the_same_for_any_number_of_threads(fused: tuple[Photos, FusedDepth]) -> None:
    photos, first = fused
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        again = fuse_maps(photos.maps(), OPTIONS)
    finally:
        numba.set_num_threads(threads)
    for field in ("points", "normals", "colours", "num_photos", "spread"):
        np.testing.assert_array_equal(getattr(again.cloud, field), getattr(first.cloud, field))
    np.testing.assert_array_equal(again.sight.depth, first.sight.depth)


def test_a_second_map_pixel_of_the_same_wall_makes_no_second_point(fused: tuple[Photos, FusedDepth]) -> None:
    """About one point per pixel of wall: six photos of the same wall do not give six times as many points."""
    photos, cloud = fused[0], fused[1].cloud
    area = 4.0 * np.pi * RADIUS**2 * np.mean(photos.frames_with(RADIUS * sphere_directions(20_000), 0.0) >= 2)
    assert len(cloud.points) < 3.0 * area / PIXEL**2


def sphere_directions(count: int) -> Array:
    index = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * index / count, np.pi * (1.0 + np.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)
