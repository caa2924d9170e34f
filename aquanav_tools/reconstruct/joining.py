"""Models of one passage put together, where rock that both show tells how they lie to each other.

A photo is placed on some thirty matches with one model. Models that hang together by fewer in each photo, but in
several photos, stay apart in mapping; all these matches together, between points that each has placed, do join them.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.types import Array

_MIN_SHARED = 15
"""Points of both models that must come to lie on each other: as many as make a pair of photos (COLMAP)."""
_MIN_SHARE = 0.3
"""Of the points matched between both models that must agree."""
_TOLERANCE = 0.03
"""Distance at which points agree, as a share of the median distance from cameras to points."""
_MAX_TRIALS = 10_000
"""Random triples of points, of which each at the smallest share has a chance of one in 37 to be all right."""
_ROUNDS = 2
"""Of triangulation and adjustment: after the first, tracks through both models fit."""

PointIds = npt.NDArray[np.int64]


def join(kept: Any, other: Any, database: Path, photos_dir: Path, pipeline: Any) -> Any | None:
    """Return both models as one in the frame of the first, or None where too little ties them together.

    Args:
        kept: pycolmap.Reconstruction.
        other: Another one of photos in the same database, perhaps some of the same photos.
        database: With the verified matches of both.
        photos_dir: Where the photos lie.
        pipeline: pycolmap.IncrementalPipelineOptions, for triangulation.
    """
    pairs = _shared_points(kept, other, database)
    if len(pairs) < _MIN_SHARED:
        return None
    here = np.array([kept.points3D[i].xyz for i in pairs[:, 0]])
    there = np.array([other.points3D[i].xyz for i in pairs[:, 1]])
    ransac = load_pycolmap().RANSACOptions()
    ransac.max_error, ransac.random_seed = _TOLERANCE * _typical_distance(kept), pipeline.random_seed
    ransac.min_inlier_ratio, ransac.max_num_trials = _MIN_SHARE, _MAX_TRIALS
    found = load_pycolmap().estimate_sim3d_robust(there, here, ransac)
    if found is None or found["num_inliers"] < max(_MIN_SHARED, _MIN_SHARE * len(pairs)):
        return None
    moved = load_pycolmap().Reconstruction(other)
    moved.transform(found["tgt_from_src"])
    joined = _adjusted(_together(kept, moved), database, photos_dir, pipeline)
    return joined if _num_linking(joined, kept, other) >= _MIN_SHARED else None


def _shared_points(kept: Any, other: Any, database: Path) -> PointIds:
    """Return (P, 2) ids of points in two models that are the same by photos in both, or by verified matches."""
    pycolmap = load_pycolmap()
    ids, other_ids = _ids_by_keypoint(kept), _ids_by_keypoint(other)
    found = [np.column_stack((ids[image], other_ids[image])) for image in sorted(ids.keys() & other_ids.keys())]
    with pycolmap.Database.open(database) as store:
        pair_ids, _ = store.read_two_view_geometry_num_inliers()
        for first, second in sorted(pycolmap.pair_id_to_image_pair(pair_id) for pair_id in pair_ids):
            for a, b, order in ((first, second, (0, 1)), (second, first, (1, 0))):
                if a in ids and b in other_ids:
                    matches = np.asarray(store.read_two_view_geometry(first, second).inlier_matches)[:, order]
                    found.append(np.column_stack((ids[a][matches[:, 0]], other_ids[b][matches[:, 1]])))
    pairs = np.concatenate(found) if found else np.zeros((0, 2), np.int64)
    return np.asarray(np.unique(pairs[(pairs >= 0).all(axis=1)], axis=0), np.int64)


def _ids_by_keypoint(model: Any) -> dict[int, PointIds]:
    """Return for each registered image the point that each of its keypoints shows, -1 for none."""
    ids = {}
    for image_id in model.reg_image_ids():
        points = model.images[image_id].points2D
        ids[image_id] = np.array([p.point3D_id if p.has_point3D() else -1 for p in points], np.int64)
    return ids


def _typical_distance(model: Any) -> float:
    """Return the median distance from a camera to the points it shows."""
    return float(np.median([np.median(_distances(model, image_id)) for image_id in model.reg_image_ids()]))


def _distances(model: Any, image_id: int) -> Array:
    image = model.images[image_id]
    points = np.array([model.points3D[p.point3D_id].xyz for p in image.points2D if p.has_point3D()]).reshape(-1, 3)
    return np.asarray(np.linalg.norm(points - image.projection_center(), axis=1)) if len(points) else np.full(1, np.nan)


def _together(kept: Any, moved: Any) -> Any:
    """Return a model with the cameras of both and no points; a photo in both keeps its pose in the first."""
    pycolmap = load_pycolmap()
    joined = pycolmap.Reconstruction()
    for model in (kept, moved):
        for camera_id in sorted(model.cameras):
            if not joined.exists_camera(camera_id):
                joined.add_camera_with_trivial_rig(model.cameras[camera_id])
        for image_id in sorted(model.reg_image_ids()):
            if not joined.exists_image(image_id):
                image = model.images[image_id]
                bare = pycolmap.Image(image.name, [p.xy for p in image.points2D], image.camera_id, image_id)
                joined.add_image_with_trivial_frame(bare, image.cam_from_world())
    return joined


def _adjusted(joined: Any, database: Path, photos_dir: Path, pipeline: Any) -> Any:
    """Return a model with points triangulated from all its photos, and cameras and points adjusted to each other."""
    pycolmap = load_pycolmap()
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.solver_options.num_threads = 1  # with more the sums, and so the last digits, vary
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    scratch = database.with_name("joined")
    scratch.mkdir(exist_ok=True)
    for _ in range(_ROUNDS):
        joined = pycolmap.triangulate_points(joined, database, photos_dir, scratch, clear_points=True, options=pipeline)
        pycolmap.bundle_adjustment(joined, options)
    shutil.rmtree(scratch)
    return joined


def _num_linking(joined: Any, kept: Any, other: Any) -> int:
    """Return how many points are shown by photos that only the first and by photos that only the second had."""
    first, second = set(kept.reg_image_ids()), set(other.reg_image_ids())
    count = 0
    for point in joined.points3D.values():
        images = {element.image_id for element in point.track.elements}
        count += bool(images & (first - second)) and bool(images & (second - first))
    return count
