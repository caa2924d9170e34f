"""Photos that were placed where most of their matches say they cannot be.

A few dozen chance matches suffice to place a photo. Where it has thousands of others, the two stand against each other:
on rendered sets the matches of photos within 0.2 m of their true place fit by 87 % or more, those of one that lay 5.6 m
off by 7 %.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.types import Array

_MIN_FITTING = 0.5
"""Share of a photo's matches with other placed photos that must fit where both were placed."""


def misplaced_photos(model: Any, database: Path, tolerance_px: float) -> list[int]:
    """Return the ids of placed photos most of whose verified matches lie off the epipolar lines of their poses.

    Of two photos that contradict each other, the one with fewer fitting matches is at fault; without it the other is
    looked at again.

    Args:
        model: pycolmap.Reconstruction.
        database: With the verified matches of its photos.
        tolerance_px: Distance from the epipolar line at which a match fits.
    """
    ids = sorted(model.reg_image_ids())
    matches, fitting = _count(model, ids, database, tolerance_px)
    misplaced: list[int] = []
    while True:
        share = fitting.sum(axis=1) / np.maximum(matches.sum(axis=1), 1)
        share[matches.sum(axis=1) == 0] = 1.0
        worst = int(np.argmin(share))
        if share[worst] >= _MIN_FITTING:
            return sorted(misplaced)
        misplaced.append(ids[worst])
        for counts in (matches, fitting):
            counts[worst], counts[:, worst] = 0.0, 0.0


def _count(model: Any, ids: list[int], database: Path, tolerance_px: float) -> tuple[Array, Array]:
    """Return (N, N) verified matches between photos, and those among them that fit where the photos were placed."""
    pycolmap = load_pycolmap()
    rows = {image_id: row for row, image_id in enumerate(ids)}
    matches, fitting = np.zeros((len(ids), len(ids))), np.zeros((len(ids), len(ids)))
    with pycolmap.Database.open(database) as store:
        pixels = {image_id: np.asarray(store.read_keypoints(image_id))[:, :2].astype(np.float64) for image_id in ids}
        pair_ids, _ = store.read_two_view_geometry_num_inliers()
        for first, second in sorted(pycolmap.pair_id_to_image_pair(pair_id) for pair_id in pair_ids):
            if first not in rows or second not in rows:
                continue
            pairs = np.asarray(store.read_two_view_geometry(first, second).inlier_matches)
            distances = _epipolar_distances_px(
                model, first, second, pixels[first][pairs[:, 0]], pixels[second][pairs[:, 1]]
            )
            place = (rows[first], rows[second])
            matches[place] = matches[place[::-1]] = len(pairs)
            fitting[place] = fitting[place[::-1]] = np.count_nonzero(distances < tolerance_px)
    return matches, fitting


def _epipolar_distances_px(model: Any, first: int, second: int, here: Array, there: Array) -> Array:
    """Return how far (M, 2) pixels of the second photo lie from the lines on which those of the first show in it."""
    images = model.images[first], model.images[second]
    cameras = [model.cameras[image.camera_id] for image in images]
    rays = [
        np.column_stack([camera.cam_from_img(pixels), np.ones(len(pixels))])
        for camera, pixels in zip(cameras, (here, there), strict=True)
    ]
    second_from_first = (images[1].cam_from_world() * images[0].cam_from_world().inverse()).matrix()
    shift = second_from_first[:, 3]
    lines = np.cross(shift, rays[0] @ second_from_first[:, :3].T)  # of the plane through both cameras and the ray
    across = np.hypot(lines[:, 0], lines[:, 1])
    off = np.abs(np.einsum("ij,ij->i", lines, rays[1]))
    return np.asarray(cameras[1].mean_focal_length() * off / np.maximum(across, np.finfo(float).tiny))
