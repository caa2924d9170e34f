"""What is known of photos that found no place: how they look, whom they match, what of the model they show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.intake.decode import GreyImage, opened, thumbnail
from aquanav_tools.reconstruct.intake.names import name_of
from aquanav_tools.reconstruct.intake.sharpness import sharpness
from aquanav_tools.types import Array

_USUAL_OF = 25
"""Registered photos at most that tell the usual sharpness."""

PointIds = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Evidence:
    """What is known of one photo."""

    brightness: float
    """Mean grey value, of 255."""
    sharpness: float
    """Relative to the median of the registered photos."""
    keypoints: int
    placed: tuple[tuple[str, int], ...] = ()
    """Registered photos with verified matches, and how many; the most first."""
    unplaced: tuple[tuple[str, int], ...] = ()
    """Photos that are in no model, likewise."""
    points: int = 0
    """Of the model, that its matches say it shows."""
    fitting: int = 0
    """Of those, as many as agree on one place of the camera."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Points of a model that the verified matches of a photo say it shows."""

    pixels: Array
    """(K, 2) where, px."""
    positions: Array
    """(K, 3) of the points, frame sfm."""


def gather_evidence(
    photos: PhotoSet, database: Path, models: Sequence[Any], tolerance_px: float
) -> dict[str, Evidence]:
    """Return what is known of every photo that is not in the first of the models (pycolmap.Reconstruction).

    Args:
        photos: Of the database.
        database: With their verified matches.
        models: The largest first; may be none.
        tolerance_px: Reprojection error at which a point agrees with a place of the camera.
    """
    registered = {name_of(models[0].image(i).name) for i in models[0].reg_image_ids()} if models else set()
    missing = [name for name in photos.names if name not in registered]
    if not missing:
        return {}
    usual = _usual_sharpness(photos, sorted(registered) or photos.names)
    elsewhere = {name_of(model.image(i).name) for model in models for i in model.reg_image_ids()}
    found = {}
    with load_pycolmap().Database.open(database) as store:
        names = {image.image_id: name_of(image.name) for image in store.read_all_images()}
        ids = {name: image_id for image_id, name in names.items()}
        neighbours = _neighbours(store)
        for name in missing:
            ranked = sorted(neighbours.get(ids[name], {}).items(), key=lambda one: -one[1])
            ranked_names = [(names[image_id], count) for image_id, count in ranked]
            shown = shown_points(ids[name], models[0], store) if models else NOTHING_SHOWN
            grey = _small(photos.path(name))
            found[name] = Evidence(
                brightness=float(grey.mean()),
                sharpness=sharpness(grey) / usual,
                keypoints=int(store.num_keypoints_for_image(ids[name])),
                placed=tuple(one for one in ranked_names if one[0] in registered),
                unplaced=tuple(one for one in ranked_names if one[0] not in elsewhere),
                points=len(shown.pixels),
                fitting=_num_fitting(shown, _camera(ids[name], models, store), tolerance_px),
            )
    return found


NOTHING_SHOWN = Shown(np.zeros((0, 2)), np.zeros((0, 3)))


def shown_points(image_id: int, model: Any, store: Any) -> Shown:
    """Return the points of a model that the verified matches of one of the other photos say it shows.

    Args:
        image_id: Of that photo.
        model: pycolmap.Reconstruction.
        store: Open pycolmap.Database.
    """
    pairs = []
    for other in sorted(_neighbours(store).get(image_id, {})):
        if not model.exists_image(other) or not model.images[other].has_pose:
            continue
        points = model.images[other].points2D
        ids = np.array([p.point3D_id if p.has_point3D() else -1 for p in points], np.int64)
        matches = np.asarray(store.read_two_view_geometry(image_id, other).inlier_matches)
        pairs.append(np.column_stack((matches[:, 0], ids[matches[:, 1]])))
    rows = np.unique(np.concatenate(pairs), axis=0) if pairs else np.zeros((0, 2), np.int64)
    rows = rows[rows[:, 1] >= 0]
    pixels = np.asarray(store.read_keypoints(image_id))[:, :2].astype(np.float64)
    positions = np.array([model.points3D[int(point)].xyz for point in rows[:, 1]]).reshape(-1, 3)
    return Shown(pixels[rows[:, 0]], positions)


def _neighbours(store: Any) -> dict[int, dict[int, int]]:
    """Return for each image those it has verified matches with, and how many."""
    pycolmap = load_pycolmap()
    neighbours: dict[int, dict[int, int]] = {}
    for pair_id, count in zip(*store.read_two_view_geometry_num_inliers(), strict=True):
        first, second = pycolmap.pair_id_to_image_pair(pair_id)
        if count > 0:
            neighbours.setdefault(first, {})[second] = int(count)
            neighbours.setdefault(second, {})[first] = int(count)
    return neighbours


def _camera(image_id: int, models: Sequence[Any], store: Any) -> Any:
    """Return the camera of a photo: as the first model found it, where one of its photos is by the same camera."""
    camera_id = store.read_image(image_id).camera_id
    if models and camera_id in models[0].cameras:
        return models[0].cameras[camera_id]
    return store.read_camera(camera_id)


def _num_fitting(shown: Shown, camera: Any, tolerance_px: float) -> int:
    """Return how many points agree on one place of the camera."""
    if len(shown.pixels) < 4:
        return 0
    pycolmap = load_pycolmap()
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error, options.ransac.random_seed = tolerance_px, 0
    found = pycolmap.estimate_absolute_pose(shown.pixels, shown.positions, camera, options)
    return 0 if found is None else int(found["num_inliers"])


def _usual_sharpness(photos: PhotoSet, names: Sequence[str]) -> float:
    """Return the median sharpness of some of the photos, spread over all."""
    step = -(-len(names) // _USUAL_OF)
    return float(np.median([sharpness(_small(photos.path(name))) for name in names[::step]]))


def _small(path: Path) -> GreyImage:
    """Return the small grey copy that the first look at the photos judged too."""
    with opened(path) as image:
        return thumbnail(image)
