"""Beams over the water: how far a disc that moves straight ahead comes until it touches a rock or the bay's edge.

Exact: the disc's middle stops where it meets the outline grown by the disc's radius, which is made of segments moved
outwards and of circles around corners. A disc of radius 0 is a ray.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.sea.outlines import to_outline, to_segment


@numba.njit(cache=True)
def cast_disc(corners, first, discs, edge, x, y, ux, uy, length, radius):  # type: ignore[no-untyped-def]
    """Return how far a disc comes until it touches an outline or the edge, at most `length`, m; 0 where it does now.

    Args:
        corners: Of all outlines, (V, 2), m.
        first: (N + 1,) where each outline begins.
        discs: (N, 3) around the outlines.
        edge: (4,) of the bay.
        x: Of the disc's middle, m.
        y: Of the disc's middle, m.
        ux: Unit direction.
        uy: Unit direction.
        length: m.
        radius: Of the disc, m; may be 0.
    """
    way = min(length, _to_edge(edge, x, y, ux, uy, radius))
    for n in range(len(discs)):
        reach = discs[n, 2] + radius
        if to_segment(discs[n, 0], discs[n, 1], x, y, x + way * ux, y + way * uy) <= reach:
            way = min(way, cast_at_outline(corners, first[n], first[n + 1], x, y, ux, uy, radius))
    return way


@numba.njit(cache=True)
def cast_at_outline(corners, begin, end, x, y, ux, uy, radius):  # type: ignore[no-untyped-def]
    """Return how far a disc comes until it touches the outline corners[begin:end], m; inf when it passes by."""
    if to_outline(corners, begin, end, x, y) <= radius:
        return 0.0
    way, before = np.inf, end - 1
    for here in range(begin, end):
        ax, ay, bx, by = corners[before, 0], corners[before, 1], corners[here, 0], corners[here, 1]
        way = min(way, _to_side(ax, ay, bx, by, x, y, ux, uy, radius))
        if radius > 0.0:
            way = min(way, _to_circle(ax - x, ay - y, ux, uy, radius))
        before = here
    return way


@numba.njit(cache=True)
def _to_side(ax, ay, bx, by, x, y, ux, uy, radius):  # type: ignore[no-untyped-def]
    """Return the way to the segment from a to b moved outwards (to its right) by the radius; inf from behind."""
    dx, dy = bx - ax, by - ay
    length = np.hypot(dx, dy)
    nx, ny = dy / length, -dx / length
    closing, away = -(ux * nx + uy * ny), (x - ax) * nx + (y - ay) * ny - radius
    if closing <= 0.0 or away < 0.0:
        return np.inf
    way = away / closing
    along = ((x + way * ux - ax) * dx + (y + way * uy - ay) * dy) / length
    return way if 0.0 <= along <= length else np.inf


@numba.njit(cache=True)
def _to_circle(cx, cy, ux, uy, radius):  # type: ignore[no-untyped-def]
    """Return the way from the origin to a circle around c; inf when it is missed or behind."""
    along, across = cx * ux + cy * uy, cx * uy - cy * ux
    if along <= 0.0 or abs(across) > radius:
        return np.inf
    return max(along - np.sqrt(radius * radius - across * across), 0.0)


@numba.njit(cache=True)
def _to_edge(edge, x, y, ux, uy, radius):  # type: ignore[no-untyped-def]
    """Return the way from within the bay to its edge."""
    way = np.inf
    for away, closing in (
        (x - edge[0], -ux), (y - edge[1], -uy), (edge[2] - x, ux), (edge[3] - y, uy)
    ):  # fmt: skip
        if closing > 0.0:
            way = min(way, max(away - radius, 0.0) / closing)
    return way
