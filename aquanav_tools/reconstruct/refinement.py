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

TOLERANCE = 1e-6
"""Adjustment ends with a step that lowers the sum of squares by less than this share of it. COLMAP goes on until
nothing moves: for 120 photos 29 steps instead of 2, which move the optical centre by 0.001 px (measured)."""


def refined_optical_centres(model: Any) -> Any | None:
    """Return a model with the optical centres moved that its photos tell well, and all else with them; None for none.

    Args:
        model: pycolmap.Reconstruction; stays as it is.
    """
    pycolmap = load_pycolmap()
    used = sorted({model.images[image_id].camera_id for image_id in model.reg_image_ids()})
    trial = pycolmap.Reconstruction(model)
    errors = _errors(trial, used, _adjust(trial, used))
    moved = [
        camera_id for camera_id, error in errors.items() if _is_sure(model.cameras[camera_id], trial, camera_id, error)
    ]
    if not moved:
        return None
    if moved != used:
        trial = pycolmap.Reconstruction(model)
        _adjust(trial, moved)
    return trial


def _is_sure(before: Any, trial: Any, camera_id: int, error: Array) -> bool:
    """Return whether a centre's new place is known well, and is another one."""
    after = trial.cameras[camera_id]
    shift = np.subtract(
        (after.principal_point_x, after.principal_point_y), (before.principal_point_x, before.principal_point_y)
    )
    typical = _TYPICAL_SHARE * max(before.width, before.height)
    is_known = bool(np.all(_SURE * error < typical)) and bool(np.all(np.abs(shift) < 5.0 * typical))
    return is_known and bool(np.any(np.abs(shift) > _SURE * error))


def _adjust(model: Any, free: list[int]) -> Any:
    """Adjust everything in place, some cameras' optical centres too; return the adjuster."""
    pycolmap = load_pycolmap()
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    options.ceres.solver_options.function_tolerance = TOLERANCE
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
    return adjuster


def _errors(model: Any, cameras: list[int], adjuster: Any) -> dict[int, Array]:
    """Return the (2,) standard deviations, px, of the centres of cameras; infinite where the photos do not tell."""
    pycolmap = load_pycolmap()
    question = pycolmap.BACovarianceOptions()
    question.params = pycolmap.BACovarianceOptionsParams.ALL
    answer = pycolmap.estimate_ba_covariance(question, model, adjuster)
    # The covariance is that of residuals of 1 px; their mean length is 1.25 standard deviations: on the safe side.
    residual = model.compute_mean_reprojection_error()
    errors = {}
    for camera_id in cameras:
        camera = model.cameras[camera_id]
        found = None if answer is None else answer.get_other_params_cov(camera.params)
        centre = list(camera.principal_point_idxs())
        errors[camera_id] = np.full(2, np.inf) if found is None else residual * np.sqrt(np.diag(found)[centre])
    return errors
