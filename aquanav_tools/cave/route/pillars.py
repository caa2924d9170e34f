"""Sections of the water that go on behind a pillar.

A plane across a passage cuts the water on both sides of a pillar that stands in it from wall to wall. A panel must
cover both, or a vehicle that takes the other side is not seen until it is past the pillar. Other water in the plane is
the other side of a pillar where it joins the panel's own water both before and behind the plane: a dead end beside the
passage joins it on one side, and the next leg of a passage that turns back on one as well.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from aquanav_tools.geometry.mesh.slicing import polygons_in_plane
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.geometry.volume.geodesic import WaterGraph
from aquanav_tools.types import Array, Mesh

MAX_WIDTH = 1.0
"""Rock wider than this share of the section beside it is no pillar but parts two passages, which go their own ways."""
MAX_SAMPLES = 30_000
"""Samples of the water that are searched for joins: some hundredths of a second per panel beside a pillar."""


class Pillars:
    """Finds sections with all that they have behind pillars."""

    def __init__(self, mesh: Mesh, field: DistanceField, radius: float, route: Array) -> None:
        """Take a cavity, its field, the vehicle's radius, m, and the (C, 3) route."""
        self._mesh, self._field, self._radius, self._route = mesh, field, radius, route

    def outline(self, centre: Array, normal: Array) -> Array | None:
        """Return the (K, 3) outline of the water around a station, world, m; None where it is in rock.

        Several pieces are joined by lines that go there and back, which the even-odd rule does not see.
        """
        import shapely

        others = polygons_in_plane(self._mesh, centre, normal)
        own = next((piece for piece in others if piece.contains(shapely.Point(0.0, 0.0))), None)
        if own is None:
            return None
        pieces, is_new = [own], len(others) > 1
        while is_new:
            found = [piece for piece in others if piece not in pieces and _is_beside(piece, pieces)]
            found = self._joined(own, found, centre, normal) if found else []
            pieces, is_new = pieces + found, bool(found)
        rings = [np.asarray(piece.exterior.coords) for piece in pieces]
        corners = rings[0][:-1] if len(rings) == 1 else np.concatenate([*rings, *(ring[:1] for ring in rings[-2:0:-1])])
        outline: Array = corners @ plane_axes(normal) + centre
        return outline

    def _joined(self, own: Any, others: list[Any], centre: Array, normal: Array) -> list[Any]:
        """Return those of some polygons in a plane whose water joins that of one on either side, off the route."""
        graph, axes = self._graph, plane_axes(normal)
        heights = (graph.points - centre) @ normal
        is_ahead = heights >= 0.0
        parts = graph.parts(is_ahead)
        near = np.flatnonzero(np.abs(heights) <= graph.spacing)
        places = (graph.points[near] - centre) @ axes.T
        crossings = self._crossings(centre, normal) @ axes.T

        def sides(polygon: Any) -> tuple[set[int], set[int]]:
            nodes = near[_are_in(polygon, places)]
            return set(parts[nodes[is_ahead[nodes]]].tolist()), set(parts[nodes[~is_ahead[nodes]]].tolist())

        ours = sides(own)
        return [
            other
            for other in others
            if not _are_in(other, crossings).any() and all(a & b for a, b in zip(ours, sides(other), strict=True))
        ]

    def _crossings(self, centre: Array, normal: Array) -> Array:
        """Return the (X, 3) places relative to a plane's centre where the route goes through the plane, m."""
        offsets = self._route - centre
        heights = offsets @ normal
        before = np.flatnonzero((heights[:-1] >= 0.0) != (heights[1:] >= 0.0))
        share = heights[before] / (heights[before] - heights[before + 1])
        crossings: Array = offsets[before] + share[:, None] * (offsets[before + 1] - offsets[before])
        return crossings

    @cached_property
    def _graph(self) -> WaterGraph:
        return WaterGraph(self._field, self._radius, MAX_SAMPLES)


def _is_beside(piece: Any, pieces: list[Any]) -> bool:
    """Return whether at most a pillar lies between a polygon and one of some others."""
    for other in pieces:
        low_x, low_y, high_x, high_y = other.bounds
        if piece.distance(other) <= MAX_WIDTH * max(high_x - low_x, high_y - low_y):
            return True
    return False


def _are_in(polygon: Any, places: Array) -> Any:
    import shapely

    return shapely.contains_xy(polygon, places[:, 0], places[:, 1])
