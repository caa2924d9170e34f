"""Masks and sources of the dense step; the planes it starts with."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import cv2
import numpy as np
import pytest

from aquanav_tools.photograph.lens import Lens
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.dense.guess import guess_planes
from aquanav_tools.reconstruct.dense.masks import pixel_maps, write_masks
from aquanav_tools.reconstruct.dense.pictures import MASKS_DIR, album, read_picture
from aquanav_tools.reconstruct.depth import DepthOptions
from aquanav_tools.reconstruct.views import View, rank_sources

FISHEYE = Lens(400, 300, 150.0, (0.04, 0.01, -0.006, 0.001))


def cameras(focal_px: float = 120.0) -> tuple[object, object]:
    """The fisheye, and a pinhole camera of 320 x 240 px."""
    pycolmap = load_pycolmap()
    fisheye = pycolmap.Camera(model=FISHEYE.model, width=400, height=300, params=FISHEYE.parameters, camera_id=1)
    pinhole = pycolmap.Camera(
        model="PINHOLE", width=320, height=240, params=[focal_px, focal_px, 160.0, 120.0], camera_id=1
    )
    return fisheye, pinhole


def model_of(camera: object) -> object:
    """A model with one photo, called a.png."""
    pycolmap = load_pycolmap()
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    model.add_image_with_trivial_frame(pycolmap.Image(name="a.png", camera_id=1, image_id=1), pycolmap.Rigid3d())
    return model


def rays(focal_px: float) -> np.ndarray:
    u, v = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    return np.stack([(u - 160.0) / focal_px, (v - 120.0) / focal_px, np.ones_like(u)], axis=-1)


def test_undistorted_pixels_are_found_where_the_lens_puts_their_rays() -> None:
    x, y = pixel_maps(*cameras())
    expected = FISHEYE.project(rays(120.0).reshape(-1, 3)).reshape(240, 320, 2)
    np.testing.assert_allclose(x, expected[..., 0], atol=1e-2)
    np.testing.assert_allclose(y, expected[..., 1], atol=1e-2)


def test_a_mask_is_undistorted_with_its_photo(tmp_path: Path) -> None:
    fisheye, pinhole = cameras()
    masks = tmp_path / "drawn"
    masks.mkdir()
    drawn = np.full((300, 400), 255, np.uint8)
    drawn[:, 240:] = 0
    cv2.imwrite(str(masks / "a.png.png"), drawn)
    write_masks(model_of(fisheye), model_of(pinhole), masks, tmp_path)
    mask = cv2.imread(str(tmp_path / MASKS_DIR / "a.png.png"), cv2.IMREAD_GRAYSCALE)
    at = FISHEYE.project(rays(120.0).reshape(-1, 3)).reshape(240, 320, 2)
    away = np.abs(at[..., 0] - 240.0) > 0.05  # of the mask's edge, where rounding decides
    np.testing.assert_array_equal((mask > 127)[away], (at[..., 0] < 240.0)[away])


def test_what_the_lens_never_showed_is_masked(tmp_path: Path) -> None:
    fisheye, pinhole = cameras(focal_px=40.0)  # 152 degrees across, wider than the fisheye's 130
    write_masks(model_of(fisheye), model_of(pinhole), None, tmp_path)
    mask = cv2.imread(str(tmp_path / MASKS_DIR / "a.png.png"), cv2.IMREAD_GRAYSCALE)
    at = FISHEYE.project(rays(40.0).reshape(-1, 3)).reshape(240, 320, 2)
    inside = np.all((at > 0.0) & (at < (400.0, 300.0)), axis=-1)
    assert 0.2 < inside.mean() < 0.9
    np.testing.assert_array_equal(mask > 127, inside)


def test_no_mask_is_written_for_a_photo_that_is_wanted_whole(tmp_path: Path) -> None:
    fisheye, pinhole = cameras()
    write_masks(model_of(fisheye), model_of(pinhole), None, tmp_path)
    assert not (tmp_path / MASKS_DIR).exists()


def test_an_album_holds_no_more_pictures_than_it_may(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    views = [view_at(float(k), np.arange(5)) for k in range(6)]
    for view in views:
        cv2.imwrite(str(tmp_path / "images" / view.name), np.full((40, 60), 90, np.uint8))
    picture = album(tmp_path, 2)
    held = [weakref.ref(picture(view)) for view in views]
    gc.collect()
    assert sum(reference() is not None for reference in held) == 2
    assert picture(views[-1]) is held[-1]()


def test_an_undistorted_photo_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(Exception, match=r"v1\.png cannot be read.*Remove its folder"):
        read_picture(tmp_path, view_at(1.0, np.arange(5)))


def view_at(x: float, ids: np.ndarray) -> View:
    """A camera moved along x, m, before points 4 m away."""
    rng = np.random.default_rng(0)
    world = np.column_stack([rng.uniform(-1.0, 1.0, (50, 2)), np.full(50, 4.0)])
    matrix = np.array([[60.0, 0.0, 30.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]])
    shift = np.array([-x, 0.0, 0.0])
    return View(round(10 * x), f"v{x:g}.png", matrix, np.eye(3), shift, 60, 40, ids, world[ids] + shift)


def test_sources_are_ranked_by_the_angle_between_their_rays() -> None:
    """At 4 m, 0.7 m are 10 degrees, the best angle; 0.1 m give hardly any parallax, 9 m too other a view."""
    views = [view_at(x, np.arange(50)) for x in (0.0, 0.1, 0.7, 1.4, 9.0)]
    assert rank_sources(views, 4)[0][:2] == [2, 3]
    assert 4 not in rank_sources(views, 4)[0]


def test_views_that_share_no_point_are_no_sources() -> None:
    views = [view_at(0.0, np.arange(20)), view_at(0.7, np.arange(20, 50)), view_at(0.8, np.arange(50))]
    assert rank_sources(views, 4)[0] == [2]


def test_planes_to_start_with_pass_through_the_points(rng: np.random.Generator) -> None:
    matrix = np.array([[60.0, 0.0, 30.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]])
    slope = np.array([0.002, -0.001])  # of inverse depth per pixel, all over the photo
    pixels = np.vstack([[[0.0, 0.0], [60.0, 0.0], [0.0, 40.0], [60.0, 40.0]], rng.uniform(0.0, 40.0, (9, 2))])
    z = 1.0 / (0.4 + pixels @ slope)
    points = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(matrix).T * z[:, None]
    inverse, slopes = guess_planes(points, matrix, (40, 60))
    u, v = np.meshgrid(np.arange(60) + 0.5, np.arange(40) + 0.5)
    np.testing.assert_allclose(inverse, 0.4 + slope[0] * u + slope[1] * v, rtol=1e-4)
    np.testing.assert_allclose(np.median(slopes, axis=(0, 1)), slope, rtol=1e-3)


def test_planes_to_start_with_are_those_of_scipy_between_any_points(rng: np.random.Generator) -> None:
    from scipy.interpolate import LinearNDInterpolator

    matrix = np.array([[60.0, 0.0, 30.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]])
    z = rng.uniform(1.0, 5.0, 40)
    points = np.column_stack([rng.uniform(-0.4, 0.4, (40, 2)), np.ones(40)]) * z[:, None]
    inverse, _ = guess_planes(points, matrix, (40, 60))
    projected = (points / z[:, None]) @ matrix.T
    u, v = np.meshgrid(np.arange(60) + 0.5, np.arange(40) + 0.5)
    expected = LinearNDInterpolator(projected[:, :2], 1.0 / z)(u, v)
    is_inside = np.isfinite(expected)
    assert 0.5 < is_inside.mean() < 1.0
    np.testing.assert_allclose(inverse[is_inside], expected[is_inside], rtol=1e-5)
    assert np.isin(np.unique(inverse[~is_inside]), (1.0 / z).astype(np.float32)).all()


def test_points_in_a_line_still_give_a_depth_to_start_with() -> None:
    matrix = np.array([[60.0, 0.0, 30.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]])
    inverse, slopes = guess_planes(
        np.array([[0.0, 0.0, 2.0], [0.1, 0.0, 2.0], [0.2, 0.0, 2.0], [0.3, 0.0, 2.0]]), matrix, (40, 60)
    )
    np.testing.assert_allclose(inverse, 0.5)
    assert not slopes.any()


@pytest.mark.parametrize("quality", ["draft", "standard", "high"])
def test_qualities_rise_in_width(quality: str) -> None:
    draft, standard, high = (DepthOptions.at(name) for name in ("draft", "standard", "high"))  # type: ignore[arg-type]
    assert draft.width < standard.width < high.width
    assert standard == DepthOptions()
    assert [level.halvings for level in DepthOptions.at(quality).levels] == [2, 1, 0]  # type: ignore[arg-type]
