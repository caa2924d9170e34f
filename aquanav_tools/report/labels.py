"""Placing labels on a drawing so that none covers another."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.report.figures import INK, MUTED, PAPER
from aquanav_tools.types import Array

DIRECTIONS = np.radians([45.0, 135.0, -45.0, -135.0, 90.0, -90.0, 0.0, 180.0])
"""Where a label may stand, seen from its point, best first: above right, as on maps."""
NEAR_PT = (5.0, 11.0, 18.0)
"""Distances from the point to the label that are tried for every label, points."""
FAR_PT = (28.0, 40.0, 55.0, 75.0, 100.0)
"""Further distances, with a leader line, for labels that must not be left out."""
GAP_PT = 1.5
"""Kept free around every label, points."""


class Labels:
    """The labels of one pair of axes and the room they have taken."""

    def __init__(self, figure: Any, axes: Any) -> None:
        self._axes = axes
        self._renderer = figure.canvas.get_renderer()
        self._pixels_per_point = figure.dpi / 72.0
        page = figure.get_window_extent(self._renderer)
        self._page = np.array([page.x0, page.y0, page.x1, page.y1])
        self._taken = np.empty((0, 4))
        """(N, 4) left, bottom, right, top of what must stay uncovered, pixels."""
        self._apart = np.empty((0, 2))
        """(N, 2) points of labels that stand apart, pixels."""

    def keep_inside(self, left_in: float, right_in: float) -> None:
        """Write labels only between two distances from the page's left edge, inches."""
        self._page[[0, 2]] = 72.0 * self._pixels_per_point * np.array([left_in, right_in])

    def keep_free(self, points: Array, radius_pt: float) -> None:
        """Keep labels off (N, 2) points of the drawing, given in its coordinates."""
        reach = radius_pt * self._pixels_per_point
        pixels = self._axes.transData.transform(np.atleast_2d(points))
        self._taken = np.vstack([self._taken, np.hstack([pixels - reach, pixels + reach])])

    def add(self, point: Array, text: str, must: bool = True, apart: float = 0.0, **style: Any) -> bool:
        """Write a label next to a (2,) point and return whether there was room.

        A label that `must` be there moves away on a leader line until it finds room; another is left out. One that is
        to stand `apart` is left out as well where another such label belongs to a point within so many points of it.
        """
        from matplotlib.patheffects import withStroke

        anchor = self._axes.transData.transform(point)
        if apart and (np.linalg.norm(self._apart - anchor, axis=1) < apart * self._pixels_per_point).any():
            return False

        halo = [withStroke(linewidth=2.5, foreground=PAPER)]
        label = self._axes.annotate(
            text, point, xytext=(0.0, 0.0), textcoords="offset points", ha="center", va="center", zorder=20,
            path_effects=halo, **{"color": INK, "fontsize": 9.0, **style},
        )  # fmt: skip
        size = label.get_window_extent(self._renderer).size
        for distance in (*NEAR_PT, *(FAR_PT if must else ())):
            for angle in DIRECTIONS:
                offset = self._offset(size, distance, angle)
                box = self._box(anchor + offset, size)
                if self._is_free(box):
                    self._taken = np.vstack([self._taken, box])
                    label.set_position(tuple(offset / self._pixels_per_point))
                    if apart:
                        self._apart = np.vstack([self._apart, anchor])
                    if distance > NEAR_PT[-1]:
                        self._draw_leader(point, offset - np.clip(offset, -0.5 * size, 0.5 * size))
                    return True
        label.remove()
        return False

    def _offset(self, size: Array, distance_pt: float, angle: float) -> Array:
        """Return the (2,) pixels from the point to the middle of a label whose nearest corner or side is that far."""
        way = np.array([np.cos(angle), np.sin(angle)])
        offset: Array = distance_pt * self._pixels_per_point * way + 0.5 * size * np.sign(np.round(way, 6))
        return offset

    def _box(self, middle: Array, size: Array) -> Array:
        gap = GAP_PT * self._pixels_per_point
        return np.concatenate([middle - 0.5 * size - gap, middle + 0.5 * size + gap])

    def _is_free(self, box: Array) -> bool:
        if (box[:2] < self._page[:2]).any() or (box[2:] > self._page[2:]).any():
            return False
        overlaps = (box[:2] < self._taken[:, 2:]).all(axis=1) & (self._taken[:, :2] < box[2:]).all(axis=1)
        return not bool(overlaps.any())

    def _draw_leader(self, point: Array, offset: Array) -> None:
        self._axes.annotate(
            "", point, xytext=tuple(offset / self._pixels_per_point), textcoords="offset points",
            arrowprops={"arrowstyle": "-", "color": MUTED, "linewidth": 0.7, "shrinkA": 0.0, "shrinkB": 2.0}, zorder=19,
        )  # fmt: skip
