"""Undistorted photos and their smaller copies, in the form the search reads. Few are held at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.views import View
from aquanav_tools.types import Array

Bytes = npt.NDArray[np.uint8]
MASKS_DIR = "masks"
"""Folder of an undistorted workspace with what to use of photos, `<photo>.png`; a photo without one is used whole."""
_BLACK = 2
"""Grey value, of 255, up to which nothing was lit: outside of a lens' image circle, or rock out of the lamp's reach."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A photo of some size, with its pinhole camera."""

    grey: Bytes
    """(H, W)."""
    usable: Bytes
    """(H, W) 1 where the photo shows something that is wanted, else 0."""
    matrix: Array
    """(3, 3) camera matrix; pixel centres lie at 0.5."""
    rotation: Array
    """(3, 3) `cam_from_world`."""
    translation: Array
    """(3,) `cam_from_world`, m."""

    @cached_property
    def half(self) -> Picture:
        """The picture at half of its size."""
        import cv2

        height, width = self.grey.shape
        size = (max(1, width // 2), max(1, height // 2))
        grey: Any = cv2.resize(self.grey, size, interpolation=cv2.INTER_AREA)
        usable: Any = cv2.resize(self.usable, size, interpolation=cv2.INTER_NEAREST)
        matrix = np.diag([size[0] / width, size[1] / height, 1.0]) @ self.matrix
        return Picture(grey, usable, matrix, self.rotation, self.translation)

    @cached_property
    def packed(self) -> npt.NDArray[np.uint32]:
        """(H, W) grey of a pixel, its right, lower and lower right neighbours, 8 bits each from the lowest."""
        grey = np.pad(self.grey, (0, 1), mode="edge")
        corners = np.stack([grey[:-1, :-1], grey[:-1, 1:], grey[1:, :-1], grey[1:, 1:]], axis=-1)
        return corners.view("<u4")[..., 0].astype(np.uint32)

    def halved(self, times: int) -> Picture:
        """Return the picture at half of its size, so many times."""
        return self if times == 0 else self.half.halved(times - 1)


def read_picture(folder: Path, view: View) -> Picture:
    """Return the photo of a view from an undistorted workspace.

    Raises:
        ReconstructionError: the file cannot be read; the workspace is damaged.
    """
    import cv2

    path = folder / "images" / view.name
    grey: Any = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise ReconstructionError(
            f"The undistorted photo {path} cannot be read. The workspace may have been changed or moved. Remove its "
            "folder and run again."
        )
    usable = (grey > _BLACK).astype(np.uint8)
    mask_path = folder / MASKS_DIR / f"{view.name}.png"
    if mask_path.is_file():
        mask: Any = cv2.imread(str(mask_path), cv2.IMREAD_GRAYSCALE)
        usable &= (mask > 127).astype(np.uint8)
    return Picture(grey, usable, view.matrix, view.rotation, view.translation)


def album(folder: Path, capacity: int) -> Callable[[View], Picture]:
    """Return a function that reads a view's picture and remembers the last `capacity` of them."""
    remembered = lru_cache(capacity)(lambda view: read_picture(folder, view))
    return lambda view: remembered(view)
