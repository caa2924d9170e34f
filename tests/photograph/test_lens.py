from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.photograph.lens import Lens, make_lens
from aquanav_tools.photograph.options import CameraOptions, LensName


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_the_rays_of_a_photo_project_onto_its_pixel_centres(lens: LensName) -> None:
    camera = make_lens(CameraOptions(lens, 64, 68))
    u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(68) + 0.5)
    rays = camera.rays()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    np.testing.assert_allclose(camera.project(7.0 * rays), np.stack([u.ravel(), v.ravel()], axis=1), atol=1e-9)


def test_a_pinhole_divides_by_depth() -> None:
    pixels = Lens(100, 80, 50.0).project(np.array([[0.2, -0.1, 2.0], [0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(pixels[0], [55.0, 37.5])
    assert np.isnan(pixels[1]).all()


def test_a_fisheye_agrees_with_opencv(rng: np.random.Generator) -> None:
    import cv2

    lens = make_lens(CameraOptions("fisheye", 640, 480))
    points = rng.uniform(-1.0, 1.0, (50, 3)) + [0.0, 0.0, 1.2]
    matrix = np.array([[lens.focal_px, 0, 320], [0, lens.focal_px, 240], [0, 0, 1.0]])
    peer, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(lens.distortion))
    np.testing.assert_allclose(lens.project(points), peer[:, 0], atol=1e-6)


def test_colmap_projects_like_the_model_and_parameters_that_the_truth_names(rng: np.random.Generator) -> None:
    from aquanav_tools.reconstruct.colmap import load_pycolmap

    for name in ("pinhole", "fisheye"):
        lens = make_lens(CameraOptions(name, 640, 480))
        camera = load_pycolmap().Camera(model=lens.model, width=640, height=480, params=list(lens.parameters))
        points = rng.uniform(-1.0, 1.0, (50, 3)) + [0.0, 0.0, 1.5]
        np.testing.assert_allclose(lens.project(points), camera.img_from_cam(points), atol=1e-6)


def test_an_action_camera_sees_what_its_makers_claim() -> None:
    lens = make_lens(CameraOptions("fisheye", 1280, 960))
    rays = lens.rays().reshape(960, 1280, 3)
    across = np.degrees(np.arccos(rays[480, 0] @ rays[480, -1]))
    assert 118 < across < 130  # claimed: 122.6
    assert rays[..., 2].min() > 0.0
