"""Pictures of speckled rock, made here and known to the pixel."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

GreyImage = npt.NDArray[np.uint8]


def speckle(height: int, width: int, seed: int = 0) -> GreyImage:
    """Return rock: noise on three scales, stretched over all grey values."""
    rng = np.random.default_rng(seed)
    layers = [cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), sigma) * sigma for sigma in (1.2, 3.0, 9.0)]
    return cv2.normalize(sum(layers), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def pan(count: int, step: int, size: tuple[int, int] = (300, 400), seed: int = 0) -> list[GreyImage]:
    """Return pictures (height, width) of one wall, each moved on by a step in px."""
    wall = speckle(size[0], size[1] + step * count, seed)
    return [wall[:, step * i : step * i + size[1]] for i in range(count)]


def write(folder: Path, pictures: dict[str, GreyImage], **saving: object) -> None:
    """Write pictures as files of the given names."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, pixels in pictures.items():
        Image.fromarray(pixels).save(folder / name, **saving)


def write_pan(folder: Path, count: int, step: int = 40, seed: int = 0) -> list[GreyImage]:
    """Write a pan as p0.png, p1.png, ... and return it."""
    pictures = pan(count, step, seed=seed)
    write(folder, {f"p{index}.png": pixels for index, pixels in enumerate(pictures)})
    return pictures
