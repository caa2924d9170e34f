"""Masks in the geometry of the undistorted photos: what their owner left out, and what the lens never showed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.reconstruct.dense.pictures import MASKS_DIR
from aquanav_tools.types import BoolArray

Maps = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]


def write_masks(distorted: Any, undistorted: Any, masks_dir: Path | None, folder: Path) -> None:
    """Write a mask for every undistorted photo that is not wanted whole.

    Args:
        distorted: pycolmap.Reconstruction with the cameras of the photos as taken.
        undistorted: pycolmap.Reconstruction with the pinhole cameras of the undistorted photos.
        masks_dir: Masks of the photos as taken, `<photo>.png` of their size, black where left out; None for none.
        folder: The undistorted workspace.
    """
    import cv2

    maps: dict[tuple[int, int], Maps] = {}
    for image_id in sorted(undistorted.reg_image_ids()):
        image = undistorted.images[image_id]
        cameras = distorted.images[image_id].camera_id, image.camera_id
        if cameras not in maps:
            maps[cameras] = pixel_maps(distorted.cameras[cameras[0]], undistorted.cameras[cameras[1]])
        drawn = None if masks_dir is None else masks_dir / f"{image.name}.png"
        usable = _usable(maps[cameras], distorted.cameras[cameras[0]], drawn)
        if not usable.all():
            path = folder / MASKS_DIR / f"{image.name}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), np.where(usable, 255, 0).astype(np.uint8))


def pixel_maps(distorted: Any, undistorted: Any) -> Maps:
    """Return two (H, W) maps: x and y in the photo as taken of every pixel of the undistorted one, px, NaN for none.

    Pixel centres lie at 0.5, as in COLMAP.
    """
    matrix = undistorted.calibration_matrix()
    x = (np.arange(undistorted.width) + 0.5 - matrix[0, 2]) / matrix[0, 0]
    y = (np.arange(undistorted.height) + 0.5 - matrix[1, 2]) / matrix[1, 1]
    rays = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1).reshape(-1, 3)
    at = distorted.img_from_cam(rays).reshape(len(y), len(x), 2).astype(np.float32)
    return at[..., 0], at[..., 1]


def _usable(maps: Maps, camera: Any, mask_path: Path | None) -> BoolArray:
    """Return (H, W) flags of the pixels that the photo as taken has, and its mask leaves in."""
    import cv2

    x, y = maps
    usable: BoolArray = (x >= 0.0) & (y >= 0.0) & (x < camera.width) & (y < camera.height)
    if mask_path is not None and mask_path.is_file():
        mask: Any = cv2.imread(str(mask_path), cv2.IMREAD_GRAYSCALE)
        columns, rows = x[usable].astype(np.int64), y[usable].astype(np.int64)
        usable[usable] = mask[rows * mask.shape[0] // camera.height, columns * mask.shape[1] // camera.width] > 127
    return usable
