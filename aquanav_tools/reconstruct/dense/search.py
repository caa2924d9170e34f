"""How a pixel's plane gets better: by its neighbours' planes, by varying it, by what other photos' depths say."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.reconstruct.dense.planes import MAX_SLANT, plane_cost, read_window, scrambled, uniform


@numba.njit(cache=True, fastmath=True, forceinline=True)
def is_possible(w, slope_x, slope_y, photo, search):  # type: ignore[no-untyped-def]
    """Whether a plane lies in the range of depth and is not seen from its edge."""
    if not (w >= search.lowest and w <= search.highest):
        return False
    across = (slope_x * photo.focal_x) ** 2 + (slope_y * photo.focal_y) ** 2
    return across <= np.float32(MAX_SLANT * MAX_SLANT) * w * w


@numba.njit(cache=True, fastmath=True, forceinline=True)
def improve(x, y, iteration, photo, sources, planes, search, patch):  # type: ignore[no-untyped-def]
    """Give a pixel the best of its own plane, those of eight neighbours, and random variations of the best so far."""
    if photo.usable[y, x] == 0 or not read_window(photo, x, y, search, patch):
        return
    height, width = photo.image.shape
    low, w = planes.cost[y, x], planes.inverse[y, x]
    slope_x, slope_y = planes.slopes[y, x, 0], planes.slopes[y, x, 1]
    for step in range(8):
        # One and five pixels away along x and y: all of the other colour of a checkerboard.
        offset = (1 - 2 * (step & 1)) * (1 if step < 4 else 5)
        i, j = (x + offset, y) if step & 2 else (x, y + offset)
        if i < 0 or j < 0 or i >= width or j >= height or planes.cost[j, i] > low + np.float32(0.3):
            continue
        along_x, along_y = planes.slopes[j, i, 0], planes.slopes[j, i, 1]
        trial = planes.inverse[j, i] + along_x * np.float32(x - i) + along_y * np.float32(y - j)
        is_same = abs(trial - w) < np.float32(3e-4) * w and abs(along_x - slope_x) + abs(along_y - slope_y) < (
            np.float32(3e-4) * w
        )
        if is_same or not is_possible(trial, along_x, along_y, photo, search):
            continue
        cost = plane_cost(trial, along_x, along_y, x, y, patch, sources, planes, search, low)
        if cost < low:
            low, w, slope_x, slope_y = cost, trial, along_x, along_y
    state = scrambled(search.seed ^ scrambled((y * width + x) * 16 + iteration))
    for attempt in range(search.attempts):
        state, trial, along_x, along_y = varied(state, attempt, iteration, w, slope_x, slope_y, photo, search)
        if not is_possible(trial, along_x, along_y, photo, search):
            continue
        cost = plane_cost(trial, along_x, along_y, x, y, patch, sources, planes, search, low)
        if cost < low:
            low, w, slope_x, slope_y = cost, trial, along_x, along_y
    planes.cost[y, x], planes.inverse[y, x] = low, w
    planes.slopes[y, x, 0], planes.slopes[y, x, 1] = slope_x, slope_y


@numba.njit(cache=True, fastmath=True, forceinline=True)
def varied(state, attempt, iteration, w, slope_x, slope_y, photo, search):  # type: ignore[no-untyped-def]
    """Return a variation of a plane: all of it, its depth alone and a little, then any plane at all."""
    state, a = uniform(state)
    state, b = uniform(state)
    state, c = uniform(state)
    per_pixel_x, per_pixel_y = w / photo.focal_x, w / photo.focal_y
    spread = np.float32(search.spread) / np.float32(1 << iteration)
    if attempt == 2:
        middle = np.float32(0.5) * (search.lowest + search.highest)
        w = middle + c * (search.highest - middle)
        per_pixel_x, per_pixel_y = w / photo.focal_x, w / photo.focal_y
        return state, w, a * np.float32(1.5) * per_pixel_x, b * np.float32(1.5) * per_pixel_y
    if attempt == 1:
        return state, w * (np.float32(1.0) + np.float32(0.1) * spread * c), slope_x, slope_y
    w *= np.float32(1.0) + np.float32(0.4) * spread * c
    turn = np.float32(2.0) * spread
    return state, w, slope_x + turn * a * per_pixel_x, slope_y + turn * b * per_pixel_y
