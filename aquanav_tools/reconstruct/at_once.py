"""Cameras placed all at once, from the matches of all pairs: where placing one after the other does not get far.

Growing a model needs photos that show some thirty of its points. Where each pair shares enough, but few points are seen
in three photos, it stops early; averaging all pairs' turns and directions goes on. Of 57 photos at steps of 1.5 m with
every third left out, growing places 6, all at once 49 (18 mm off on average). But it also places photos that nothing
holds firmly: metres off, without an error to be seen in any pair. Only the part that is rigid is kept.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.misplaced import misplaced_photos
from aquanav_tools.reconstruct.rigid import rigid_part

_TYING = 6
"""Points that tie a photo to others. With 3, photos were up to 0.5 m off; with 5 none more than 5 cm; with 8 a quarter
fewer were kept (rendered sets, thinned)."""
_MIN_PHOTOS = 3


def map_at_once(database: Path, photos_dir: Path, scratch: Path, tolerance_px: float, seed: int) -> Any | None:
    """Return the largest firm model that all verified matches together give, or None.

    Args:
        database: With keypoints and verified matches.
        photos_dir: Where the photos lie.
        scratch: Folder to work in; removed.
        tolerance_px: Distance from the epipolar line at which a match fits.
        seed: Of random choices.

    Returns:
        pycolmap.Reconstruction, whose photos contradict neither their matches nor hang on fewer than 6 points.

    Source: Pan et al., Global structure-from-motion revisited (ECCV 2024), as in pycolmap.
    """
    scratch.mkdir()
    found = load_pycolmap().global_mapping(database, photos_dir, scratch, options=_options(seed))
    shutil.rmtree(scratch)
    firm = [model for model in found.values() if _keep_firm(model, database, tolerance_px)]
    return max(firm, key=lambda model: model.num_reg_images(), default=None)


def _keep_firm(model: Any, database: Path, tolerance_px: float) -> bool:
    """Take out, in place, what contradicts its matches or is tied by too few points; return whether some is left."""
    _take_out(model, set(misplaced_photos(model, database, tolerance_px)))
    if model.num_reg_images() < _MIN_PHOTOS:
        return False
    _take_out(model, set(model.reg_image_ids()) - set(rigid_part(model, _TYING)))
    is_sharp = model.compute_mean_reprojection_error() < 0.5 * tolerance_px
    return bool(model.num_reg_images() >= _MIN_PHOTOS and is_sharp)


def _take_out(model: Any, image_ids: set[int]) -> None:
    for image_id in sorted(image_ids):
        model.deregister_frame(model.images[image_id].frame_id)


def _options(seed: int) -> Any:
    """Return options that give the same cameras every time."""
    options = load_pycolmap().GlobalPipelineOptions()
    mapper = options.mapper
    for part in (options, mapper, mapper.rotation_averaging, mapper.global_positioning, mapper.retriangulation):
        part.random_seed = seed
    for part in (options, mapper, mapper.bundle_adjustment.ceres.solver_options):
        part.num_threads = 1  # with more, sums are added in another order every time
    mapper.bundle_adjustment.ceres.use_gpu = mapper.global_positioning.use_gpu = False
    return options
