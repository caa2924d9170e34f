"""A boat's hull against rocks, reefs and the bay's edge.

From above a hull is a convex polygon grown by a radius: a prism has radius 0, a capsule is a segment with its radius.
Two such shapes that hardly overlap touch where a corner of one meets the other. A rock stands upright, so it pushes the
hull aside, unless its top is nearer to the hull's bottom than its side: then it carries it.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.sea.outlines import to_outline, to_segment

TINY = 1e-9
"""Distances below this have no direction, m."""


@numba.njit(cache=True)
def hull_clearance(hull, radius, corners, first, discs, edge):  # type: ignore[no-untyped-def]
    """Return the distance from a hull to the nearest outline or edge, seen from above, m; 0 or less where they overlap.

    Args:
        hull: (C, 2) or (C, 3) corners, counter-clockwise, m.
        radius: By which the polygon is grown, m.
        corners: Of all outlines, (V, 2), m.
        first: (N + 1,) where each outline begins.
        discs: (N, 3) around the outlines.
        edge: (4,) of the bay.
    """
    nearest, middle, reach = np.inf, _middle(hull), 0.0
    for k in range(len(hull)):
        x, y = hull[k, 0], hull[k, 1]
        nearest = min(nearest, x - edge[0], y - edge[1], edge[2] - x, edge[3] - y)
        reach = max(reach, np.hypot(x - middle[0], y - middle[1]))
    for n in range(len(discs)):
        apart = np.hypot(discs[n, 0] - middle[0], discs[n, 1] - middle[1]) - discs[n, 2] - reach
        if apart >= nearest:
            continue
        for k in range(len(hull)):
            nearest = min(nearest, to_outline(corners, first[n], first[n + 1], hull[k, 0], hull[k, 1]))
        for here in range(first[n], first[n + 1]):
            nearest = min(nearest, to_outline(hull, 0, len(hull), corners[here, 0], corners[here, 1]))
    return nearest - radius


@numba.njit(cache=True)
def deepest_contact(hull, radius, corners, first, discs, edge, tops, contact):  # type: ignore[no-untyped-def]
    """Write the deepest overlap of a hull with rocks and edge: depth (m), normal out of the rock (3), place (3).

    Args:
        hull: (C, 3) corners of the hull's bottom, counter-clockwise from above, z from still water, m.
        radius: By which it is grown to all sides, m.
        corners: Of all outlines, (V, 2), m.
        first: (N + 1,) where each outline begins.
        discs: (N, 3) around the outlines.
        edge: (4,) of the bay.
        tops: (N,) heights of the rocks' tops above still water, m.
        contact: (7,) receives the overlap; its depth is 0 where there is none.
    """
    contact[:] = 0.0
    middle, reach = _middle(hull), 0.0
    for k in range(len(hull)):
        reach = max(reach, np.hypot(hull[k, 0] - middle[0], hull[k, 1] - middle[1]))
        _meet_edge(hull[k], radius, edge, contact)
    for n in range(len(discs)):
        apart = np.hypot(discs[n, 0] - middle[0], discs[n, 1] - middle[1])
        if apart >= discs[n, 2] + reach + radius:
            continue
        for k in range(len(hull)):
            away, nx, ny = _nearest(corners, first[n], first[n + 1], hull[k, 0], hull[k, 1])
            depth = radius - away
            x, y = hull[k, 0] - radius * nx, hull[k, 1] - radius * ny
            _keep_deeper(contact, depth, nx, ny, tops[n], x, y, hull[k, 2])
        for here in range(first[n], first[n + 1]):
            x, y = corners[here, 0], corners[here, 1]
            away, nx, ny = _nearest(hull, 0, len(hull), x, y)
            _keep_deeper(contact, radius - away, -nx, -ny, tops[n], x, y, _bottom_at(hull, x, y))


@numba.njit(cache=True)
def _keep_deeper(contact, depth, nx, ny, top, x, y, bottom):  # type: ignore[no-untyped-def]
    """Take an overlap over where it is deeper than what is there; where the top is nearer than the side, it carries."""
    above = top - bottom
    if depth <= 0.0 or above <= 0.0 or min(depth, above) <= contact[0]:
        return
    contact[1], contact[2], contact[3] = nx, ny, 0.0
    if above < depth:
        contact[1], contact[2], contact[3] = 0.0, 0.0, 1.0
    contact[0], contact[4], contact[5] = min(depth, above), x, y
    contact[6] = min(top, 0.0) if above >= depth else top


@numba.njit(cache=True)
def _meet_edge(corner, radius, edge, contact):  # type: ignore[no-untyped-def]
    for axis in range(2):
        for side in range(2):
            sign = 1.0 - 2.0 * side
            depth = sign * (edge[axis + 2 * side] - corner[axis]) + radius
            if depth > contact[0]:
                contact[:] = 0.0
                contact[0], contact[1 + axis] = depth, sign
                contact[4], contact[5] = corner[0], corner[1]
                contact[4 + axis] -= sign * radius


@numba.njit(cache=True)
def _nearest(corners, begin, end, x, y):  # type: ignore[no-untyped-def]
    """Return the distance from a point to an outline, negative inside, and the outward normal there."""
    distance = to_outline(corners, begin, end, x, y)
    best, nx, ny, before = np.inf, 0.0, 0.0, end - 1
    for here in range(begin, end):
        ax, ay, bx, by = corners[before, 0], corners[before, 1], corners[here, 0], corners[here, 1]
        apart = to_segment(x, y, ax, ay, bx, by)
        if apart < best:
            dx, dy = bx - ax, by - ay
            square = dx * dx + dy * dy
            best, nx, ny = apart, dy / np.sqrt(square), -dx / np.sqrt(square)
            if apart > TINY:
                share = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
                scale = (1.0 if distance > 0.0 else -1.0) / apart
                nx, ny = scale * (x - ax - share * dx), scale * (y - ay - share * dy)
        before = here
    return distance, nx, ny


@numba.njit(cache=True)
def _bottom_at(hull, x, y):  # type: ignore[no-untyped-def]
    """Return the height of the hull's bottom, a plane, at a place; a segment's is that of its nearer end."""
    ax, ay, az = hull[1, 0] - hull[0, 0], hull[1, 1] - hull[0, 1], hull[1, 2] - hull[0, 2]
    px, py = x - hull[0, 0], y - hull[0, 1]
    if len(hull) < 3:
        return hull[0, 2] if px * ax + py * ay < 0.5 * (ax * ax + ay * ay) else hull[1, 2]
    last = len(hull) - 1
    bx, by, bz = hull[last, 0] - hull[0, 0], hull[last, 1] - hull[0, 1], hull[last, 2] - hull[0, 2]
    area = ax * by - ay * bx
    one, other = (px * by - py * bx) / area, (ax * py - ay * px) / area
    return hull[0, 2] + one * az + other * bz


@numba.njit(cache=True)
def _middle(hull):  # type: ignore[no-untyped-def]
    x, y = 0.0, 0.0
    for k in range(len(hull)):
        x, y = x + hull[k, 0] / len(hull), y + hull[k, 1] / len(hull)
    return x, y
