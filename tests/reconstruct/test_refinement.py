"""The optical centre is found where the photos tell it, and left alone where they do not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.refinement import refined_optical_centres

WIDTH, HEIGHT = 1000, 800
FOCAL = 900.0


def made_model(centre: tuple[float, float], num_photos: int = 12, noise_px: float = 0.3) -> Any:
    """Photos around a ball of points by a lens with its optical centre at `centre`; the model believes in the middle.

    Poses and points are the true ones, off by a little: bundle adjustment has to find what the photos say.
    """
    pycolmap = load_pycolmap()
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, num_photos, 300
    options.camera_width, options.camera_height = WIDTH, HEIGHT
    options.camera_params = [FOCAL, *centre, 0.0]
    model = pycolmap.synthesize_dataset(options)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = noise_px
    pycolmap.synthesize_noise(noise, model)
    (camera,) = model.cameras.values()
    camera.params = [FOCAL, 0.5 * WIDTH, 0.5 * HEIGHT, 0.0]
    return model


@pytest.mark.parametrize("centre", [(512.0, 391.0), (489.0, 402.0)])
def test_a_centre_off_the_middle_is_found(centre: tuple[float, float]) -> None:
    model = made_model(centre)
    model = refined_optical_centres(model)
    (camera,) = model.cameras.values()
    # 3,600 points seen with 0.3 px of noise tell the centre to a tenth of that and some; poses share the error.
    np.testing.assert_allclose([camera.principal_point_x, camera.principal_point_y], centre, atol=1.0)
    assert model.compute_mean_reprojection_error() < 0.3 * 1.3  # a two-dimensional normal error is 1.25 sigma long


def test_a_centre_in_the_middle_stays_there() -> None:
    model = made_model((0.5 * WIDTH, 0.5 * HEIGHT))
    before = {image_id: image.cam_from_world().matrix().copy() for image_id, image in model.images.items()}
    assert refined_optical_centres(model) is None
    for image_id, pose in before.items():
        np.testing.assert_array_equal(model.images[image_id].cam_from_world().matrix(), pose)


def test_two_noisy_photos_do_not_move_it() -> None:
    model = made_model((515.0, 400.0), num_photos=2, noise_px=1.5)
    assert refined_optical_centres(model) is None
    (camera,) = model.cameras.values()
    assert (camera.principal_point_x, camera.principal_point_y) == (0.5 * WIDTH, 0.5 * HEIGHT)
