"""From coarse to fine: small copies of the photos find depth fast, larger ones make it exact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.reconstruct.dense.engine import Solve
from aquanav_tools.reconstruct.dense.guess import guess_planes
from aquanav_tools.reconstruct.dense.pictures import Picture
from aquanav_tools.reconstruct.dense.state import MAX_CHOSEN, WORST_COST, FloatArray, Photo, Planes, Search, Sources
from aquanav_tools.types import Array


@dataclass(frozen=True)
class Level:
    """The search at one size of the photos."""

    halvings: int
    """Of width and height."""
    iterations: int
    """Rounds over all pixels."""
    attempts: int
    """Random variations per pixel and round: 3 end with any plane at all, 2 only vary."""
    spread: float
    """Size of the variations in the first round, relative."""
    radius: int
    """Half the width of the window that is compared, px."""
    agreement: float = 0.0
    """What disagreeing with another photo's depth costs."""
    distinction: float = 0.0
    """How much worse than the depth that was found any other must fit, or the pixel is given up."""


@dataclass(frozen=True, eq=False)
class Task:
    """One photo, the photos it is compared with, and the range of depth to search, m."""

    picture: Picture
    others: Sequence[Picture]
    nearest: float
    farthest: float
    seed: int


def find_planes(task: Task, points: Array, levels: Sequence[Level], solve: Solve) -> Planes:
    """Return the planes of a photo's pixels, starting with (P, 3) sparse points in its camera's frame.

    Args:
        task: The photo.
        points: Before the camera, m.
        levels: The coarsest first.
        solve: Of the processor or the card.
    """
    inverse = slopes = None
    for number, level in enumerate(levels):
        small = task.picture.halved(level.halvings)
        if inverse is None or slopes is None:
            inverse, slopes = guess_planes(points, small.matrix, small.grey.shape)
        else:
            inverse, slopes = enlarged(inverse, slopes, small.grey.shape)
        others = [other.halved(level.halvings) for other in task.others]
        sources = gather(small, others)
        planes = _solve(task, small, sources, (inverse, slopes), level, task.seed + number, solve)
        inverse, slopes = planes.inverse, planes.slopes
    return planes


def make_agree(
    task: Task, start: tuple[FloatArray, FloatArray], maps: Sequence[FloatArray], level: Level, solve: Solve
) -> Planes:
    """Return the planes of a photo's pixels, improved by what was found in the photos it is compared with.

    Args:
        task: The photo.
        start: (H, W) inverse depth, 1/m, and (H, W, 2) its change per pixel.
        maps: Of every other photo, its inverse depth, 0 where none was found.
        level: Of no halvings.
        solve: Of the processor or the card.
    """
    sources = gather(task.picture, task.others, maps)
    return _solve(task, task.picture, sources, start, level, task.seed + 64, solve)


def _solve(
    task: Task,
    picture: Picture,
    sources: Sources,
    start: tuple[FloatArray, FloatArray],
    level: Level,
    seed: int,
    solve: Solve,
) -> Planes:
    size = picture.grey.shape
    focal_x, focal_y = np.float32(picture.matrix[0, 0]), np.float32(picture.matrix[1, 1])
    photo = Photo(picture.grey.astype(np.float32), picture.usable, focal_x, focal_y)
    lowest, highest = np.float32(1.0 / task.farthest), np.float32(1.0 / task.nearest)
    chosen = np.zeros((*size, MAX_CHOSEN), np.uint8)
    # Arrays of one layout: numba compiles the search for each layout that it is given.
    inverse = np.ascontiguousarray(np.clip(start[0], lowest, highest))
    planes = Planes(inverse, np.array(start[1], order="C"), np.full(size, WORST_COST, np.float32), chosen)
    num_chosen = min(MAX_CHOSEN, len(sources.images))
    agreement = np.float32(level.agreement)
    search = Search(
        level.radius,
        num_chosen,
        level.attempts,
        np.float32(level.spread),
        agreement,
        lowest,
        highest,
        seed,
        np.float32(level.distinction),
    )
    solve(photo, sources, planes, search, level.iterations)
    return planes


def enlarged(inverse: FloatArray, slopes: FloatArray, size: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return inverse depth and its change per pixel at a finer level: those of the planes the pixels came from."""
    height, width = inverse.shape
    across, down = width / size[1], height / size[0]
    x, y = (np.arange(size[1]) + 0.5) * across, (np.arange(size[0]) + 0.5) * down
    column, row = x.astype(np.int64), y.astype(np.int64)
    finer = slopes[row][:, column]
    off_x, off_y = (x - column - 0.5).astype(np.float32), (y - row - 0.5).astype(np.float32)
    moved = inverse[row][:, column] + finer[..., 0] * off_x + finer[..., 1] * off_y[:, None]
    return moved, finer * np.array([across, down], np.float32)


def gather(picture: Picture, others: Sequence[Picture], maps: Sequence[FloatArray] | None = None) -> Sources:
    """Return the photos that one is compared with, and what was found in them, in the form that the search reads."""
    sizes = np.array([other.grey.shape for other in others], np.int64)
    images = np.zeros((len(others), *sizes.max(axis=0)), np.uint32)
    for image, other, (height, width) in zip(images, others, sizes, strict=True):
        image[:height, :width] = other.packed
    found = np.zeros((len(others), 1, 1) if maps is None else images.shape, np.float32)
    for there, here in zip(found, maps or [], strict=False):
        there[: here.shape[0], : here.shape[1]] = here
    inverse = np.linalg.inv(picture.matrix)
    turns, shifts = [], []
    for other in others:
        turn = other.rotation @ picture.rotation.T
        turns.append((other.matrix @ turn @ inverse).ravel())
        shifts.append(other.matrix @ (other.translation - turn @ picture.translation))
    return Sources(images, sizes, np.array(turns, np.float32), np.array(shifts, np.float32), found)
