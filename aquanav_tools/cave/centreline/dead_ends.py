"""Dead ends: side passages that leave the largest balls around the skeleton and go on for longer than they are wide."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.cave.centreline.lattice import OFFSETS, Lattice
from aquanav_tools.cave.water.heap import empty_heap, pop, push
from aquanav_tools.types import Array, BoolArray, IntArray

MIN_REACH = 1.0
"""A side passage reaches at least this far beyond the ball at its junction, in radii of that ball; what is shorter
is relief of the wall: the ball's diver looks into all of it."""
MIN_SLENDERNESS = 1.5
"""A side passage is at least this many times as long as wide. A right-angled corner of a wide room measures 1.1, a
corner of 60 degrees 1.2, a round alcove as deep as its diameter 1."""


def find_tips(lattice: Lattice, skeleton: BoolArray) -> IntArray:
    """Return the samples at the tips of the dead ends that a skeleton leaves out.

    A tip lies one clearance from the end of the water: of the places whose ball reaches as far, the roomiest.

    Args:
        lattice: the water.
        skeleton: (N,) which samples are on the skeleton; at least one per part.
    """
    sources = np.flatnonzero(skeleton)
    steps = lattice.spacing * np.linalg.norm(OFFSETS, axis=1)
    beyond, ball = _beyond_balls(lattice.neighbours, steps, sources, lattice.clearance)
    uncovered = np.flatnonzero(beyond > 0.0)
    order = uncovered[np.argsort(-beyond[uncovered], kind="stable")]
    points = lattice.indices.astype(np.float64)
    least = MIN_REACH * ball / lattice.spacing
    peaks = _slender_peaks(lattice.neighbours, order, beyond / lattice.spacing, least, points)
    return np.array([_tip(lattice, beyond, peak) for peak in peaks], dtype=np.int64)


@numba.njit(cache=True)
def _beyond_balls(neighbours, steps, sources, clearance):  # type: ignore[no-untyped-def]
    """Return each sample's way to the nearest ball around a source, negative in it, and that ball's radius."""
    beyond = np.full(len(clearance), np.inf)
    ball = np.zeros(len(clearance))
    (ways, samples), size = empty_heap(), 0
    for source in sources:
        beyond[source], ball[source] = -clearance[source], clearance[source]
        ways, samples = push(ways, samples, size, beyond[source], source)
        size += 1
    while size > 0:
        way, sample = pop(ways, samples, size)
        size -= 1
        if way > beyond[sample]:
            continue
        for n in range(26):
            other = neighbours[sample, n]
            if other >= 0 and way + steps[n] < beyond[other]:
                beyond[other], ball[other] = way + steps[n], ball[sample]
                ways, samples = push(ways, samples, size, beyond[other], other)
                size += 1
    return beyond, ball


@numba.njit(cache=True)
def _slender_peaks(neighbours, order, height, least, points):  # type: ignore[no-untyped-def]
    """Return the highest samples of all fingers of water that are long and slender enough, in samples.

    The water is taken from the farthest sample down. A finger is a connected part of what was taken so far. Where two
    fingers meet, the shorter one ends.
    """
    finger = np.full(len(height), -1, np.int64)  # parent, towards the finger's highest sample
    moments = np.zeros((len(order), 10))  # count, sums, sums of products, by rank in `order`
    rank = np.full(len(height), -1, np.int64)
    is_passage = np.zeros(len(order), np.bool_)
    next_look = np.zeros(len(order))
    peaks = [np.int64(0) for _ in range(0)]
    for n, sample in enumerate(order):
        rank[sample], finger[sample] = n, sample
        _add_point(moments[n], points[sample])
        top = sample
        for other in neighbours[sample]:
            if other < 0 or finger[other] < 0:
                continue
            rival = _root(finger, other)
            if rival == top:
                continue
            if height[rival] > height[top] or (height[rival] == height[top] and rank[rival] < rank[top]):
                top, rival = rival, top
            if is_passage[rank[rival]]:
                peaks.append(rival)
            finger[rival] = top
            moments[rank[top]] += moments[rank[rival]]
        here = rank[top]
        length = height[top] - height[sample]
        if not is_passage[here] and length >= max(least[top], next_look[here]):
            is_passage[here] = length >= MIN_SLENDERNESS * _width(moments[here])
            next_look[here] = length + 1.0
    for sample in order:
        if finger[sample] == sample and is_passage[rank[sample]]:
            peaks.append(sample)
    return np.array(peaks, dtype=np.int64)


@numba.njit(cache=True)
def _root(finger, sample):  # type: ignore[no-untyped-def]
    while finger[sample] != sample:
        finger[sample] = finger[finger[sample]]
        sample = finger[sample]
    return sample


@numba.njit(cache=True)
def _add_point(moments, point):  # type: ignore[no-untyped-def]
    moments[0] += 1.0
    column = 4
    for a in range(3):
        moments[1 + a] += point[a]
        for b in range(a, 3):
            moments[column] += point[a] * point[b]
            column += 1


@numba.njit(cache=True)
def _width(moments):  # type: ignore[no-untyped-def]
    """Return the diameter of a set of samples across its longest direction: 4 standard deviations, as of a disc."""
    covariance = np.empty(6)
    column = 0
    for a in range(3):
        for b in range(a, 3):
            covariance[column] = moments[4 + column] / moments[0] - moments[1 + a] * moments[1 + b] / moments[0] ** 2
            column += 1
    return 4.0 * np.sqrt(max(_middle_eigenvalue(covariance), 0.0))


@numba.njit(cache=True)
def _middle_eigenvalue(matrix):  # type: ignore[no-untyped-def]
    """Return the second eigenvalue of a symmetric matrix, given by xx, xy, xz, yy, yz, zz (Smith's formula, 1961)."""
    xx, xy, xz, yy, yz, zz = matrix
    mean = (xx + yy + zz) / 3.0
    xx, yy, zz = xx - mean, yy - mean, zz - mean
    spread = np.sqrt((xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if spread == 0.0:
        return mean
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    angle = np.arccos(min(max(determinant / (2.0 * spread**3), -1.0), 1.0)) / 3.0
    return mean - 2.0 * spread * (np.cos(angle) + np.cos(angle + 2.0 * np.pi / 3.0))


def _tip(lattice: Lattice, beyond: Array, peak: int) -> int:
    """Return the roomiest sample around a finger's peak whose ball reaches as far as any, to within a spacing."""
    near = _reaching(lattice.neighbours, beyond + lattice.clearance, beyond, peak, lattice.spacing)
    return int(near[np.argmax(lattice.clearance[near])])


@numba.njit(cache=True)
def _reaching(neighbours, reach, beyond, peak, slack):  # type: ignore[no-untyped-def]
    """Return the samples around a peak from which the end of the finger is seen: their balls reach as far as it."""
    is_seen = np.zeros(len(reach), np.bool_)
    is_seen[peak] = True
    found = [np.int64(peak)]
    head = 0
    while head < len(found):
        for other in neighbours[found[head]]:
            if other >= 0 and not is_seen[other] and beyond[other] > 0.0 and reach[other] >= beyond[peak] - slack:
                is_seen[other] = True
                found.append(np.int64(other))
        head += 1
    return np.array(found)
