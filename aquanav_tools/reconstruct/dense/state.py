"""What the search is given and what it changes: plain tuples of arrays, as numba's functions take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float32]
MAX_CHOSEN = 3
"""Sources that a pixel can be compared with in a search; all are tried when they are chosen."""
WORST_COST = 2.0
"""1 - NCC of a window and its negative; also that of a window that cannot be compared."""


class Photo(NamedTuple):
    """The photo whose depth is wanted."""

    image: FloatArray
    """(H, W) grey in [0, 255]."""
    usable: npt.NDArray[np.uint8]
    """(H, W) 1 where depth is wanted, 0 where a mask or the lens leaves nothing."""
    focal_x: np.float32
    focal_y: np.float32
    """px."""


class Sources(NamedTuple):
    """The photos it is compared with."""

    images: npt.NDArray[np.uint32]
    """(S, H, W) grey of a pixel, its right, lower and lower right neighbours, 8 bits each from the lowest: what one
    sample between pixels needs comes with one read, which is half of the time."""
    sizes: npt.NDArray[np.int64]
    """(S, 2) height and width of each."""
    turns: FloatArray
    """(S, 9) rows of K_source * R * K^-1."""
    shifts: FloatArray
    """(S, 3) K_source * t, with x_source = R * x + t."""
    maps: FloatArray
    """(S, H, W) inverse depth that was found in each, 1/m, 0 where none was; (S, 1, 1) before anything was found."""


class Planes(NamedTuple):
    """The state of the search, changed in place."""

    inverse: FloatArray
    """(H, W) inverse depth w, 1/m."""
    slopes: FloatArray
    """(H, W, 2) change of w per pixel along x and y."""
    cost: FloatArray
    """(H, W) in [0, 2]; small is sure."""
    chosen: npt.NDArray[np.uint8]
    """(H, W, MAX_CHOSEN) the sources that a pixel is compared with, the best first."""


class Search(NamedTuple):
    """What is tried."""

    radius: int
    """Half the window's width, px."""
    chosen: int
    """Sources that a pixel is compared with."""
    attempts: int
    """Random variations tried: 3 end with any plane at all."""
    spread: np.float32
    """Size of the variations in the first round; every further one halves it."""
    agreement: np.float32
    """What disagreeing with a source's own depth costs; 0 leaves it out."""
    lowest: np.float32
    highest: np.float32
    """Range of inverse depth, 1/m."""
    seed: int
    distinction: np.float32 = np.float32(0.0)
    """How much worse than the plane that was found any other depth must fit; 0 leaves it out."""
