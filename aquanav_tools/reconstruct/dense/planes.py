"""What one pixel of PatchMatch does, written once for processors and graphics cards.

A pixel holds a small plane as inverse depth w there and its slopes along x and y: planes of space are linear in inverse
depth over the photo (1/z = a x + b y + c), so that a neighbour's plane is taken over by two multiplications, and where
the plane lies in another photo is linear too. Its cost is 1 - NCC between the window around the pixel and where the
plane puts that window in the source photos, with bilateral weights.

Functions here are compiled by numba, for the processor or, called from a CUDA kernel, for the card. They allocate
nothing: `patch` is room that the caller brings.

Sources: Bleyer, Rhemann, Rother, PatchMatch Stereo (2011); Schoenberger et al., Pixelwise View Selection (2016).
"""

from __future__ import annotations

import math

import numba
import numpy as np

from aquanav_tools.reconstruct.dense.state import WORST_COST

LONE_COST = 0.5
"""What a second source can add to the cost of the best one: rock that only one of them shows is not given up."""
MIN_VARIANCE = 0.06
"""Variance of grey values in [0, 255] below which a window shows nothing: that of rounding."""
_UNLIKE = 0.5 / 38.0**2
"""Of the bilateral weight: 38 of 255 grey values, and one radius, are its standard deviations."""
MAX_SAMPLES = 64
"""Of a window: those of radius 7."""
ROWS = 5
"""Of `patch`, each with one number per sample of a window: weight, grey value, x, y, and costs of sources."""
COSTS = 4
"""The row for these."""
STRIDE = 2
"""Every how many-th pixel of a window is compared."""
_BYTE = np.uint32(255)
TOLERANCE = 0.02
"""Of depths that agree, relative: about two pixels."""
MOVED = 0.03
"""How much nearer and farther a plane is tried and must fit worse, relative: more than maps may differ by."""
MAX_SLANT = 6.0
"""Tangent of the largest angle between a plane and the photo's own: 80 degrees."""


@numba.njit(cache=True, fastmath=True, forceinline=True)
def scrambled(number):  # type: ignore[no-untyped-def]
    """Return a hash of 32 bits (Wellons' lowbias32): random numbers that depend on place and round only."""
    number &= 0xFFFFFFFF
    number = ((number >> 16) ^ number) * 0x7FEB352D & 0xFFFFFFFF
    number = ((number >> 15) ^ number) * 0x846CA68B & 0xFFFFFFFF
    return (number >> 16) ^ number


@numba.njit(cache=True, fastmath=True, forceinline=True)
def uniform(state):  # type: ignore[no-untyped-def]
    """Return the next state and a number in [-1, 1)."""
    state = scrambled(state + 0x9E3779B9)
    return state, np.float32(state) * np.float32(2.0 / 4294967296.0) - np.float32(1.0)


# Python's min and max are not called: numba takes those of the processor for them, which no kernel can call.


@numba.njit(cache=True, fastmath=True, forceinline=True)
def least(first, second):  # type: ignore[no-untyped-def]
    """Return the smaller one of two numbers."""
    return first if first < second else second


@numba.njit(cache=True, fastmath=True, forceinline=True)
def within(index, size):  # type: ignore[no-untyped-def]
    """Return the nearest index of an axis."""
    if index < 0:
        return 0
    return index if index < size else size - 1


@numba.njit(cache=True, fastmath=True, forceinline=True)
def num_samples(search):  # type: ignore[no-untyped-def]
    """Return how many pixels of a window are compared."""
    return (2 * search.radius // STRIDE + 1) ** 2


@numba.njit(cache=True, fastmath=True, forceinline=True)
def lay_out(search, patch):  # type: ignore[no-untyped-def]
    """Write where the samples of a window lie, for all windows to come."""
    side = 2 * search.radius // STRIDE + 1
    for k in range(patch.shape[1]):
        patch[2, k] = np.float32(k % side * STRIDE - search.radius)
        patch[3, k] = np.float32(k // side * STRIDE - search.radius)


@numba.njit(cache=True, fastmath=True, forceinline=True)
def read_window(photo, x, y, search, patch):  # type: ignore[no-untyped-def]
    """Fill patch: weights that add up to 1, and weighted grey values of mean 0 and variance 1; False where flat."""
    image = photo.image
    height, width = image.shape
    middle = image[y, x]
    weight, mean, square = np.float32(0), np.float32(0), np.float32(0)
    nearness = np.float32(-0.5) / np.float32(search.radius * search.radius)
    for k in range(patch.shape[1]):
        dx, dy = patch[2, k], patch[3, k]
        grey = image[within(y + int(dy), height), within(x + int(dx), width)]
        unlike = grey - middle
        w = math.exp((dx * dx + dy * dy) * nearness - unlike * unlike * np.float32(_UNLIKE))
        patch[0, k], patch[1, k] = w, grey
        weight += w
        mean += w * grey
        square += w * grey * grey
    share = np.float32(1.0) / weight
    mean *= share
    variance = square * share - mean * mean
    if variance < np.float32(MIN_VARIANCE):
        return False
    scale = np.float32(1.0) / math.sqrt(variance)
    for k in range(patch.shape[1]):
        patch[0, k] *= share
        patch[1, k] = (patch[1, k] - mean) * patch[0, k] * scale
    return True


@numba.njit(cache=True, fastmath=True, forceinline=True)
def source_cost(w, slope_x, slope_y, x, y, patch, sources, s, search):  # type: ignore[no-untyped-def]
    """Return 1 - NCC of the window in one source, or the worst cost where it does not lie in the photo."""
    turns, shifts = sources.turns, sources.shifts
    last_i, last_j = np.float32(sources.sizes[s, 1] - 1), np.float32(sources.sizes[s, 0] - 1)
    u, v = np.float32(x) + np.float32(0.5), np.float32(y) + np.float32(0.5)
    ahead = turns[s, 6] * u + turns[s, 7] * v + turns[s, 8] + shifts[s, 2] * w
    if ahead <= np.float32(1e-4):
        return np.float32(WORST_COST)
    scale = np.float32(1.0) / ahead
    i = (turns[s, 0] * u + turns[s, 1] * v + turns[s, 2] + shifts[s, 0] * w) * scale
    j = (turns[s, 3] * u + turns[s, 4] * v + turns[s, 5] + shifts[s, 1] * w) * scale
    # The plane's homography, taken as affine over the window: its derivatives.
    ahead_x, ahead_y = turns[s, 6] + shifts[s, 2] * slope_x, turns[s, 7] + shifts[s, 2] * slope_y
    i_x = (turns[s, 0] + shifts[s, 0] * slope_x - i * ahead_x) * scale
    i_y = (turns[s, 1] + shifts[s, 0] * slope_y - i * ahead_y) * scale
    j_x = (turns[s, 3] + shifts[s, 1] * slope_x - j * ahead_x) * scale
    j_y = (turns[s, 4] + shifts[s, 1] * slope_y - j * ahead_y) * scale
    i, j = i - np.float32(0.5), j - np.float32(0.5)
    reach = np.float32(search.radius)
    reach_i, reach_j = reach * (abs(i_x) + abs(i_y)), reach * (abs(j_x) + abs(j_y))
    if not (i >= reach_i and j >= reach_j and i + reach_i < last_i and j + reach_j < last_j):
        return np.float32(WORST_COST)
    mean, square, cross = np.float32(0), np.float32(0), np.float32(0)
    for k in range(patch.shape[1]):
        at_i = i + i_x * patch[2, k] + i_y * patch[3, k]
        at_j = j + j_x * patch[2, k] + j_y * patch[3, k]
        left, top = np.int32(at_i), np.int32(at_j)
        right, down = at_i - np.float32(left), at_j - np.float32(top)
        four = sources.images[s, np.uint32(top), np.uint32(left)]
        upper, lower = np.float32(four & _BYTE), np.float32((four >> np.uint32(16)) & _BYTE)
        upper += right * (np.float32((four >> np.uint32(8)) & _BYTE) - upper)
        lower += right * (np.float32(four >> np.uint32(24)) - lower)
        grey = upper + down * (lower - upper)
        weighted = patch[0, k] * grey
        mean += weighted
        square += weighted * grey
        cross += patch[1, k] * grey
    variance = square - mean * mean
    if variance < np.float32(MIN_VARIANCE):
        return np.float32(WORST_COST)
    return np.float32(1.0) - cross / math.sqrt(variance)


@numba.njit(cache=True, fastmath=True, forceinline=True)
def disagreement(w, x, y, sources, s):  # type: ignore[no-untyped-def]
    """Return how far a depth is from what a source found there, over TOLERANCE, 1 at most and where it found none."""
    turns, shifts = sources.turns, sources.shifts
    u, v = np.float32(x) + np.float32(0.5), np.float32(y) + np.float32(0.5)
    ahead = turns[s, 6] * u + turns[s, 7] * v + turns[s, 8] + shifts[s, 2] * w
    if ahead <= np.float32(1e-4):
        return np.float32(1.0)
    i = (turns[s, 0] * u + turns[s, 1] * v + turns[s, 2] + shifts[s, 0] * w) / ahead
    j = (turns[s, 3] * u + turns[s, 4] * v + turns[s, 5] + shifts[s, 1] * w) / ahead
    width, height = np.float32(sources.sizes[s, 1]), np.float32(sources.sizes[s, 0])
    if not (i >= np.float32(0.0) and j >= np.float32(0.0) and i < width and j < height):
        return np.float32(1.0)
    there = sources.maps[s, np.uint32(j), np.uint32(i)]  # in a source depth is `ahead` times as large
    return least(abs(there * ahead / w - np.float32(1.0)) * np.float32(1.0 / TOLERANCE), np.float32(1.0))


@numba.njit(cache=True, fastmath=True, forceinline=True)
def cost_in(w, slope_x, slope_y, x, y, patch, sources, s, search):  # type: ignore[no-untyped-def]
    """Return what a plane costs with one source: unlikeness, and disagreement where it counts."""
    cost = source_cost(w, slope_x, slope_y, x, y, patch, sources, s, search)
    if search.agreement > np.float32(0.0):
        cost += search.agreement * disagreement(w, x, y, sources, s)
    return cost


@numba.njit(cache=True, fastmath=True, forceinline=True)
def joined(first, second):  # type: ignore[no-untyped-def]
    """Return the cost in the best two sources: their mean, the second one limited, in [0, WORST_COST]."""
    cost = np.float32(0.5) * (first + least(second, first + np.float32(LONE_COST)))
    return least(cost, np.float32(WORST_COST))


@numba.njit(cache=True, fastmath=True, forceinline=True)
def plane_cost(w, slope_x, slope_y, x, y, patch, sources, planes, search, limit):  # type: ignore[no-untyped-def]
    """Return the cost of a plane over the pixel's chosen sources: the mean of the best two, the second limited.

    Or the worst cost, once the last source cannot bring it below a limit: a perfect one would not.
    """
    first, second = np.float32(WORST_COST), np.float32(WORST_COST)
    for k in range(search.chosen):
        if k == search.chosen - 1 and joined(np.float32(0), first) >= limit:
            return np.float32(WORST_COST)
        cost = cost_in(w, slope_x, slope_y, x, y, patch, sources, planes.chosen[y, x, k], search)
        if cost < first:
            first, second = cost, first
        elif cost < second:
            second = cost
    return joined(first, second)


@numba.njit(cache=True, fastmath=True, forceinline=True)
def choose_sources(x, y, photo, sources, planes, search, patch):  # type: ignore[no-untyped-def]
    """Compare a pixel's plane with all sources; keep the best, and its cost with them."""
    planes.cost[y, x] = np.float32(WORST_COST)
    if photo.usable[y, x] == 0 or not read_window(photo, x, y, search, patch):
        return
    w, slope_x, slope_y = planes.inverse[y, x], planes.slopes[y, x, 0], planes.slopes[y, x, 1]
    last = search.chosen - 1
    for k in range(search.chosen):
        patch[COSTS, k] = np.float32(9.0)
    for s in range(sources.images.shape[0]):
        cost = cost_in(w, slope_x, slope_y, x, y, patch, sources, s, search)
        if cost >= patch[COSTS, last]:
            continue
        k = last
        while k > 0 and cost < patch[COSTS, k - 1]:
            patch[COSTS, k] = patch[COSTS, k - 1]
            planes.chosen[y, x, k] = planes.chosen[y, x, k - 1]
            k -= 1
        patch[COSTS, k] = cost
        planes.chosen[y, x, k] = s
    planes.cost[y, x] = joined(patch[COSTS, 0], patch[COSTS, 1])


@numba.njit(cache=True, fastmath=True, forceinline=True)
def reject_vague(x, y, photo, sources, planes, search, patch):  # type: ignore[no-untyped-def]
    """Give up a pixel whose plane would fit nearly as well a little nearer or farther: nothing there tells its depth.

    Smooth shading and photos from nearly one place look alike at any depth, and so in all photos: that they agree
    proves nothing.
    """
    if planes.cost[y, x] >= np.float32(WORST_COST) or not read_window(photo, x, y, search, patch):
        return
    w, slope_x, slope_y = planes.inverse[y, x], planes.slopes[y, x, 0], planes.slopes[y, x, 1]
    least_other, own = np.float32(WORST_COST), np.float32(0)
    for step in range(3):
        scale = np.float32(1.0) + np.float32(MOVED) * np.float32(step - 1)
        cost = plane_cost(
            w * scale,
            slope_x * scale,
            slope_y * scale,
            x,
            y,
            patch,
            sources,
            planes,
            search,
            np.float32(2 * WORST_COST),
        )
        if step == 1:
            own = cost
        else:
            least_other = least(least_other, cost)
    if least_other - own < search.distinction:
        planes.cost[y, x] = np.float32(WORST_COST)
