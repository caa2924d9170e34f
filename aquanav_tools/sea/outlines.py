"""Geometry of outlines (simple polygons, counter-clockwise) in the plane, compiled."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from aquanav_tools.types import Array, IntArray


def outline_area(outline: Array) -> float:
    """Return the area of a (C, 2) outline, m^2; negative if it runs clockwise."""
    x, y = outline[:, 0], outline[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def outlines_of(outlines: Sequence[Array], edge: Array) -> tuple[Array, IntArray, Array, Array]:
    """Return (C, 2) outlines in one array, with where each begins, a circle around each, and the bay's edge."""
    first = np.cumsum([0, *(len(one) for one in outlines)]).astype(np.int64)
    corners = np.concatenate([np.empty((0, 2)), *outlines])
    discs = np.empty((len(outlines), 3))
    for n, outline in enumerate(outlines):
        middle = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
        discs[n, :2], discs[n, 2] = middle, np.sqrt(((outline - middle) ** 2).sum(axis=1).max())
    return corners, first, discs, np.asarray(edge, dtype=np.float64)


@numba.njit(cache=True)
def to_segment(x, y, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Return the distance from a point to the segment from a to b, m."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = ((x - ax) * dx + (y - ay) * dy) / square if square > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return np.hypot(x - ax - share * dx, y - ay - share * dy)


@numba.njit(cache=True)
def between_segments(ax, ay, bx, by, cx, cy, dx, dy):  # type: ignore[no-untyped-def]
    """Return the distance between the segments from a to b and from c to d, m; 0 where they cross."""
    one = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    two = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
    three = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
    four = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
    if one * two < 0.0 and three * four < 0.0:
        return 0.0
    nearest = min(to_segment(ax, ay, cx, cy, dx, dy), to_segment(bx, by, cx, cy, dx, dy))
    return min(nearest, to_segment(cx, cy, ax, ay, bx, by), to_segment(dx, dy, ax, ay, bx, by))


@numba.njit(cache=True)
def to_outline(corners, begin, end, x, y):  # type: ignore[no-untyped-def]
    """Return the distance from a point to the outline corners[begin:end], m; negative inside it."""
    nearest, is_inside, before = np.inf, False, end - 1
    for here in range(begin, end):
        ax, ay, bx, by = corners[before, 0], corners[before, 1], corners[here, 0], corners[here, 1]
        nearest = min(nearest, to_segment(x, y, ax, ay, bx, by))
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            is_inside = not is_inside
        before = here
    return -nearest if is_inside else nearest


@numba.njit(cache=True)
def clearance_at(corners, first, discs, edge, x, y):  # type: ignore[no-untyped-def]
    """Return the distance from a point to the nearest outline or edge, m; negative inside a rock or outside."""
    nearest = min(x - edge[0], y - edge[1], edge[2] - x, edge[3] - y)
    for n in range(len(discs)):
        if np.hypot(x - discs[n, 0], y - discs[n, 1]) - discs[n, 2] < nearest:
            nearest = min(nearest, to_outline(corners, first[n], first[n + 1], x, y))
    return nearest


@numba.njit(cache=True)
def is_segment_free(corners, first, discs, edge, ax, ay, bx, by, reach):  # type: ignore[no-untyped-def]
    """Return whether all of a segment that begins in the water keeps `reach` from every rock and from the edge, m."""
    if min(ax, bx) < edge[0] + reach or max(ax, bx) > edge[2] - reach:
        return False
    if min(ay, by) < edge[1] + reach or max(ay, by) > edge[3] - reach:
        return False
    for n in range(len(discs)):
        if to_segment(discs[n, 0], discs[n, 1], ax, ay, bx, by) >= discs[n, 2] + reach:
            continue
        before = first[n + 1] - 1
        for here in range(first[n], first[n + 1]):
            cx, cy, dx, dy = corners[before, 0], corners[before, 1], corners[here, 0], corners[here, 1]
            if between_segments(ax, ay, bx, by, cx, cy, dx, dy) < reach:
                return False
            before = here
    return True


@numba.njit(cache=True)
def is_arc_free(corners, first, discs, edge, x, y, radius, begin, turn, reach):  # type: ignore[no-untyped-def]
    """Return whether an arc keeps `reach` from every rock and from the edge.

    An arc's nearest point to a segment is one of its ends, or lies towards the segment's point nearest to the middle,
    or towards one of the segment's ends.

    Args:
        corners: Of all outlines, (V, 2).
        first: (N + 1,) where each outline begins.
        discs: (N, 3) around the outlines.
        edge: (4,) of the bay.
        x: Of the arc's middle, m.
        y: Of the arc's middle, m.
        radius: Of the arc, m.
        begin: Angle at which it begins, rad.
        turn: Signed angle that it spans, rad.
        reach: m.
    """
    for k in range(4):  # the edge is nearest to the arc's ends, or to its points due east, north, west and south
        if _is_within(0.5 * np.pi * k, begin, turn) and not _is_inside(edge, x, y, radius, 0.5 * np.pi * k, reach):
            return False
    if not _is_inside(edge, x, y, radius, begin, reach) or not _is_inside(edge, x, y, radius, begin + turn, reach):
        return False
    for n in range(len(discs)):
        if np.hypot(x - discs[n, 0], y - discs[n, 1]) >= discs[n, 2] + radius + reach:
            continue
        before = first[n + 1] - 1
        for here in range(first[n], first[n + 1]):
            cx, cy, dx, dy = corners[before, 0], corners[before, 1], corners[here, 0], corners[here, 1]
            if _arc_to_segment(x, y, radius, begin, turn, cx, cy, dx, dy) < reach:
                return False
            before = here
    return True


@numba.njit(cache=True)
def _arc_to_segment(x, y, radius, begin, turn, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    nearest = np.inf
    for angle in (begin, begin + turn):
        nearest = min(nearest, to_segment(x + radius * np.cos(angle), y + radius * np.sin(angle), ax, ay, bx, by))
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    foot = ((x - ax) * dx + (y - ay) * dy) / square if square > 0.0 else 0.0
    for share in (0.0, 1.0, min(max(foot, 0.0), 1.0)):
        px, py = ax + share * dx - x, ay + share * dy - y
        if _is_within(np.arctan2(py, px), begin, turn):
            nearest = min(nearest, abs(np.hypot(px, py) - radius))
    return nearest


@numba.njit(cache=True)
def _is_within(angle, begin, turn):  # type: ignore[no-untyped-def]
    """Return whether an angle lies in the range that begins at `begin` and spans the signed angle `turn`."""
    ahead = (angle - begin if turn >= 0.0 else begin - angle) % (2.0 * np.pi)
    return ahead <= abs(turn)


@numba.njit(cache=True)
def _is_inside(edge, x, y, radius, angle, reach):  # type: ignore[no-untyped-def]
    px, py = x + radius * np.cos(angle), y + radius * np.sin(angle)
    return min(px - edge[0], py - edge[1], edge[2] - px, edge[3] - py) >= reach
