"""The optical centre of each camera, found once all its photos are placed.

Mapping holds it in the middle of the photo, as with few photos it would drift. A real lens is off by about 1 % of the
width, and the cameras' places take that up: on fountain-P11 they are 6.0 mm off the surveyed ones on average before,
2.5 mm after.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.types import Array

_TYPICAL_SHARE = 0.01
"""How far the optical centres of cameras lie from the middle, of the longer side; one known no better is left there."""
_SURE = 3.0
"""A centre is moved when that is known this many times better than guessed, and found this many times its error off."""


def refine_optical_centres(model: Any) -> bool:
    """Move the optical centres of a model's cameras where its photos tell them well, and all else with them, in place.

    Args:
        model: pycolmap.Reconstruction.

    Returns:
        Whether any was moved.
    """
    trial = load_pycolmap().Reconstruction(model)
    used = sorted({model.images[image_id].camera_id for image_id in model.reg_image_ids()})
    errors = _adjust(trial, used)
    moved = [
        camera_id for camera_id, error in errors.items() if _is_sure(model.cameras[camera_id], trial, camera_id, error)
    ]
    if not moved:
        return False
    _adjust(model, moved)
    return True


def _is_sure(before: Any, trial: Any, camera_id: int, error: Array) -> bool:
    """Return whether a centre's new place is known well, and is another one."""
    after = trial.cameras[camera_id]
    shift = np.subtract(
        (after.principal_point_x, after.principal_point_y), (before.principal_point_x, before.principal_point_y)
    )
    typical = _TYPICAL_SHARE * max(before.width, before.height)
    is_known = bool(np.all(_SURE * error < typical)) and bool(np.all(np.abs(shift) < 5.0 * typical))
    return is_known and bool(np.any(np.abs(shift) > _SURE * error))


def _adjust(model: Any, free: list[int]) -> dict[int, Array]:
    """Adjust everything in place, some cameras' optical centres too.

    Returns:
        Of those, the (2,) standard deviations of the centre, px; infinite where the photos do not tell.
    """
    pycolmap = load_pycolmap()
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    options.ceres.solver_options.num_threads = 1  # with more the sums, and so the last digits, vary
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in sorted(model.reg_image_ids()):
        config.add_image(image_id)
    for camera_id in set(model.cameras) - set(free):
        config.set_constant_cam_intrinsics(camera_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    adjuster.solve()
    model.update_point_3d_errors()
    question = pycolmap.BACovarianceOptions()
    question.params = pycolmap.BACovarianceOptionsParams.ALL
    answer = pycolmap.estimate_ba_covariance(question, model, adjuster)
    # The covariance is that of residuals of 1 px; their mean length is 1.25 standard deviations: on the safe side.
    residual = model.compute_mean_reprojection_error()
    errors = {}
    for camera_id in free:
        camera = model.cameras[camera_id]
        found = None if answer is None else answer.get_other_params_cov(camera.params)
        centre = list(camera.principal_point_idxs())
        errors[camera_id] = np.full(2, np.inf) if found is None else residual * np.sqrt(np.diag(found)[centre])
    return errors
