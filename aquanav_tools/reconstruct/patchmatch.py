"""PatchMatch multi-view stereo in numba: a depth and a normal for every pixel of one photo.

Every pixel holds a small plane (depth and normal in the camera's frame). Its cost is 1 - NCC between the window around
the pixel and where the plane puts that window in the source photos, with bilateral weights, averaged over the best
sources. Planes spread from neighbour to neighbour in a checkerboard, each compared with random variations of itself.

Sources: Bleyer, Rhemann, Rother, PatchMatch Stereo (2011); Schoenberger et al., Pixelwise View Selection (2016);
Galliani, Lasinger, Schindler, Massively Parallel Multiview Stereopsis (2015) for the checkerboard.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

FloatImage = npt.NDArray[np.float32]
WORST_COST = np.float32(2.0)
_FLAT = 1e-6
"""Variance of grey values in [0, 1] below which a window shows nothing."""
_GRAZING = -0.05
"""Largest cosine between a plane's normal and the ray: about 87 degrees."""
_ODD_STEPS = np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [5, 0], [-5, 0], [0, 5], [0, -5]], np.int64)
"""(dx, dy) of the neighbours asked for their plane: all of the other colour, so that rows can run in parallel."""


class Reference(NamedTuple):
    """The photo whose depth is wanted."""

    image: FloatImage
    """(H, W) grey in [0, 1]."""
    inverse: npt.NDArray[np.float32]
    """(4,) a, b, c, d with ray x = a * u + c, ray y = b * v + d at depth 1; pixel centres lie at 0.5."""


class Sources(NamedTuple):
    """The photos it is compared with."""

    images: FloatImage
    """(S, H, W) grey in [0, 1], padded to the size of the largest."""
    sizes: npt.NDArray[np.int64]
    """(S, 2) height and width of each."""
    turns: npt.NDArray[np.float32]
    """(S, 9) rows of K_source * R * K_reference^-1."""
    shifts: npt.NDArray[np.float32]
    """(S, 3) K_source * t, with x_source = R * x_reference + t."""


class Search(NamedTuple):
    """What is tried."""

    radius: int
    """Half the window's width, px."""
    stride: int
    """Every how many-th pixel of the window is compared."""
    best: int
    """Sources whose cost counts: the best so many, since the others may be occluded."""
    nearest: float
    farthest: float
    """Range of depth."""
    seed: int


def match_patches(
    reference: Reference, sources: Sources, depth: FloatImage, normals: FloatImage, search: Search, iterations: int
) -> FloatImage:
    """Improve (H, W) depth and (H, W, 3) normals in place and return the (H, W) cost, in [0, 2].

    The result depends on the inputs only, not on the number of threads.
    """
    cost = np.empty_like(depth)
    _rate(reference, sources, depth, normals, cost, search)
    for iteration in range(iterations):
        for colour in (0, 1):
            _sweep(colour, iteration, reference, sources, depth, normals, cost, search)
    return cost


@numba.njit(cache=True, parallel=True, fastmath=True)
def _rate(reference, sources, depth, normals, cost, search):  # type: ignore[no-untyped-def]
    """Write the cost of the planes as they are."""
    height, width = reference.image.shape
    for y in numba.prange(height):
        window, scratch = _scratch(search, len(sources.images))
        for x in range(width):
            stats = _window(reference.image, x, y, search, window)
            n = normals[y, x]
            cost[y, x] = _plane_cost(
                depth[y, x], n[0], n[1], n[2], x, y, window, stats, reference, sources, search, scratch
            )


@numba.njit(cache=True, parallel=True, fastmath=True)
def _sweep(colour, iteration, reference, sources, depth, normals, cost, search):  # type: ignore[no-untyped-def]
    """Improve the pixels of one colour by their neighbours' planes and by random variations."""
    height, width = reference.image.shape
    a, b, c, d = reference.inverse
    for y in numba.prange(height):
        window, scratch = _scratch(search, len(sources.images))
        state = np.uint64(search.seed * 1000003 + y * 7919 + colour * 13 + iteration * 104729 + 1)
        for x in range((y + colour) & 1, width, 2):
            stats = _window(reference.image, x, y, search, window)
            if stats[2] < _FLAT:
                continue
            ray_x, ray_y = a * (x + 0.5) + c, b * (y + 0.5) + d
            low, z = cost[y, x], depth[y, x]
            n0, n1, n2 = normals[y, x, 0], normals[y, x, 1], normals[y, x, 2]
            for step in range(len(_ODD_STEPS)):
                i, j = x + _ODD_STEPS[step, 0], y + _ODD_STEPS[step, 1]
                if i < 0 or j < 0 or i >= width or j >= height or cost[j, i] > low + 0.3:
                    continue
                m0, m1, m2 = normals[j, i, 0], normals[j, i, 1], normals[j, i, 2]
                facing = m0 * ray_x + m1 * ray_y + m2
                if facing > -1e-3:
                    continue
                # Where this pixel's ray meets the neighbour's plane.
                there = m0 * (a * (i + 0.5) + c) + m1 * (b * (j + 0.5) + d) + m2
                trial = depth[j, i] * there / facing
                is_same = abs(trial - z) < 1e-5 * z and abs(m0 - n0) + abs(m1 - n1) + abs(m2 - n2) < 1e-3
                if is_same or trial < search.nearest or trial > search.farthest:
                    continue
                price = _plane_cost(trial, m0, m1, m2, x, y, window, stats, reference, sources, search, scratch)
                if price < low:
                    low, z, n0, n1, n2 = price, trial, m0, m1, m2
            for attempt in range(3):
                state, trial, m0, m1, m2 = _vary(state, attempt, iteration, z, n0, n1, n2, search)
                if trial < search.nearest or trial > search.farthest:
                    continue
                price = _plane_cost(trial, m0, m1, m2, x, y, window, stats, reference, sources, search, scratch)
                if price < low:
                    low, z, n0, n1, n2 = price, trial, m0, m1, m2
            cost[y, x], depth[y, x] = low, z
            normals[y, x, 0], normals[y, x, 1], normals[y, x, 2] = n0, n1, n2


@numba.njit(cache=True, inline="always")
def _scratch(search, num_sources):  # type: ignore[no-untyped-def]
    """Return room for a window's grey values and weights, and for the sources' costs."""
    side = 2 * search.radius // search.stride + 1
    return np.empty((2, side * side), np.float32), np.empty(num_sources, np.float32)


@numba.njit(cache=True, inline="always", fastmath=True)
def _uniform(state):  # type: ignore[no-untyped-def]
    """Return the next state of Knuth's linear congruential generator and a number in [0, 1)."""
    state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return state, np.float32((state >> np.uint64(40)) / 16777216.0)


@numba.njit(cache=True, inline="always", fastmath=True)
def _vary(state, attempt, iteration, z, n0, n1, n2, search):  # type: ignore[no-untyped-def]
    """Return a random variation of a plane: first a wide one, then a narrow one, then any plane at all."""
    state, u = _uniform(state)
    state, v = _uniform(state)
    state, w = _uniform(state)
    state, t = _uniform(state)
    if attempt == 2 and iteration < 2:
        z = 1.0 / (1.0 / search.farthest + t * (1.0 / search.nearest - 1.0 / search.farthest))
        n0, n1, n2 = 2 * u - 1, 2 * v - 1, -0.2 - w
    else:
        spread = 0.5 ** (iteration + 1) * (1.0 if attempt == 0 else 0.25)
        z = z * (1 + 0.2 * spread * (2 * t - 1))
        n0, n1, n2 = n0 + spread * (2 * u - 1), n1 + spread * (2 * v - 1), n2 + spread * (2 * w - 1)
    shrink = 1.0 / np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    return state, np.float32(z), np.float32(n0 * shrink), np.float32(n1 * shrink), np.float32(n2 * shrink)


@numba.njit(cache=True, inline="always", fastmath=True)
def _window(image, x, y, search, window):  # type: ignore[no-untyped-def]
    """Fill (2, K) grey values and bilateral weights around a pixel; return weight, mean and variance."""
    height, width = image.shape
    middle = image[y, x]
    weight, mean, square, k = np.float32(0), np.float32(0), np.float32(0), 0
    for dy in range(-search.radius, search.radius + 1, search.stride):
        for dx in range(-search.radius, search.radius + 1, search.stride):
            grey = image[min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)]
            unlike = grey - middle
            # 0.15 of grey and one radius of distance: standard deviations of the bilateral weight.
            w = np.float32(np.exp(-unlike * unlike / 0.045 - (dx * dx + dy * dy) / (2.0 * search.radius**2)))
            window[0, k], window[1, k] = grey, w
            weight, mean, square, k = weight + w, mean + w * grey, square + w * grey * grey, k + 1
    mean /= weight
    return weight, mean, square / weight - mean * mean


@numba.njit(cache=True, inline="always", fastmath=True)
def _plane_cost(z, n0, n1, n2, x, y, window, stats, reference, sources, search, scratch):  # type: ignore[no-untyped-def]
    """Return the mean cost of a plane over its best sources."""
    a, b, c, d = reference.inverse
    ray_x, ray_y = a * (x + 0.5) + c, b * (y + 0.5) + d
    facing = n0 * ray_x + n1 * ray_y + n2
    if stats[2] < _FLAT or facing > _GRAZING * np.sqrt(ray_x * ray_x + ray_y * ray_y + 1.0):
        return WORST_COST
    # x_source ~ (turn + shift * plane^T) * pixel: the homography that the plane induces.
    inverse_offset = np.float32(1.0 / (facing * z))
    p0, p1, p2 = n0 * a * inverse_offset, n1 * b * inverse_offset, (n0 * c + n1 * d + n2) * inverse_offset
    for s in range(len(scratch)):
        scratch[s] = _source_cost(p0, p1, p2, x, y, window, stats, sources, s, search)
    total = np.float32(0)
    for _ in range(search.best):
        low = scratch.argmin()
        total += min(scratch[low], WORST_COST)
        scratch[low] = np.float32(9)
    return total / np.float32(search.best)


@numba.njit(cache=True, inline="always", fastmath=True)
def _source_cost(p0, p1, p2, x, y, window, stats, sources, s, search):  # type: ignore[no-untyped-def]
    """Return 1 - NCC of the window in one source, or the worst cost where it does not lie in the photo."""
    turn, shift, image = sources.turns[s], sources.shifts[s], sources.images[s]
    height, width = sources.sizes[s, 0], sources.sizes[s, 1]
    h00, h01, h02 = turn[0] + shift[0] * p0, turn[1] + shift[0] * p1, turn[2] + shift[0] * p2
    h10, h11, h12 = turn[3] + shift[1] * p0, turn[4] + shift[1] * p1, turn[5] + shift[1] * p2
    h20, h21, h22 = turn[6] + shift[2] * p0, turn[7] + shift[2] * p1, turn[8] + shift[2] * p2
    px, py = np.float32(x + 0.5), np.float32(y + 0.5)
    if h20 * px + h21 * py + h22 <= 1e-6:
        return WORST_COST
    total, square, cross, k = np.float32(0), np.float32(0), np.float32(0), 0
    for dy in range(-search.radius, search.radius + 1, search.stride):
        v = py + np.float32(dy)
        base_x, base_y, base_w = h01 * v + h02, h11 * v + h12, h21 * v + h22
        for dx in range(-search.radius, search.radius + 1, search.stride):
            u = px + np.float32(dx)
            scale = np.float32(1.0) / (h20 * u + base_w)
            i = (h00 * u + base_x) * scale - np.float32(0.5)
            j = (h10 * u + base_y) * scale - np.float32(0.5)
            if not (i >= 0 and j >= 0 and i < width - 1 and j < height - 1):
                return WORST_COST
            left, top = int(i), int(j)
            right, down = i - np.float32(left), j - np.float32(top)
            upper = image[top, left] + right * (image[top, left + 1] - image[top, left])
            lower = image[top + 1, left] + right * (image[top + 1, left + 1] - image[top + 1, left])
            grey = upper + down * (lower - upper)
            weighted = window[1, k] * grey
            total, square, cross = total + weighted, square + weighted * grey, cross + weighted * window[0, k]
            k += 1
    mean = total / stats[0]
    variance = square / stats[0] - mean * mean
    if variance < _FLAT:
        return WORST_COST
    return np.float32(1.0) - (cross / stats[0] - mean * stats[1]) / np.sqrt(variance * stats[2])
