"""Keypoints found in smaller copies lie where they lie in the photos themselves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from aquanav_tools.reconstruct.features import FeatureOptions, _search
from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.nearest import best_matches
from tests.reconstruct.pictures import pan, write

STEP = 40


def test_keypoints_of_photos_searched_at_half_size_move_as_the_photos_do_and_stay_out_of_masks(tmp_path: Path) -> None:
    pictures = pan(3, STEP, size=(480, 640))
    write(tmp_path / "in", {f"p{n}.png": picture for n, picture in enumerate(pictures)})
    masks = tmp_path / "masks"
    masks.mkdir()
    mask = np.full((480, 640), 255, np.uint8)
    mask[:, :200] = 0
    for n in range(3):
        cv2.imwrite(str(masks / f"p{n}.png.png"), mask)
    photos = replace(read_photos(tmp_path / "in"), masks_dir=masks)
    options = FeatureOptions(max_features=450)  # of which 170 px each make a quarter of the photo
    found = _search(photos, ["p0.png", "p1.png"], options, tmp_path, is_affine=True)
    (here, descriptors), (there, others) = ((np.asarray(k), np.asarray(d.data)) for k, d in found.values())
    assert here[:, 0].min() >= 200.0 and here[:, 0].max() > 600.0
    matches = best_matches(descriptors, others)
    moved = there[matches[:, 1], :2] - here[matches[:, 0], :2]
    assert len(matches) > 50
    np.testing.assert_allclose(np.median(moved, axis=0), [-STEP, 0.0], atol=0.1)  # SIFT places to a tenth of a pixel
