"""The route: the way through the water from entrance to goal that keeps away from the walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import Cavity, Portal
from aquanav_tools.cave.field import DistanceField
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array

MAX_SEARCH_SAMPLES = 4_000_000
SMOOTHING = 0.4
"""Length over which the route is smoothed, m."""
WALL_AVERSION = 2.0
"""Exponent of the cost of being near a wall: (largest clearance / clearance) ** WALL_AVERSION."""


@dataclass(frozen=True, eq=False)
class Route:
    """A line through the water."""

    points: Array
    """(C, 3) from the entrance to the goal, evenly spaced, m."""
    clearance: Array
    """(C,) m."""

    @property
    def length(self) -> float:
        """Metres along the line."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


class WaterGraph:
    """Shortest ways through the water on the distance field's samples (26 neighbours)."""

    def __init__(self, field: DistanceField, min_clearance: float, max_samples: int = MAX_SEARCH_SAMPLES) -> None:
        step = int(np.ceil(np.cbrt(field.values.size / max_samples)))
        samples = np.ascontiguousarray(field.values[::step, ::step, ::step])
        self.field = DistanceField(field.origin, field.spacing * step, samples)
        self.min_clearance = min_clearance
        self.is_open = self.field.values >= min_clearance
        if not self.is_open.any():
            raise MeshError(
                f"No place in the water is wide enough: {min_clearance:.2f} m of clearance are needed, the widest "
                f"place has {field.values.max():.2f} m. Check --unit, or choose a smaller vehicle with --vehicle."
            )

    def ways_from(self, point: Array) -> Ways:
        """Return the shortest ways from a (3,) point to everywhere."""
        from skimage.graph import MCP_Geometric

        search = MCP_Geometric(np.where(self.is_open, 1.0, -1.0))
        lengths, _ = search.find_costs([self.nearest_open(point)])
        return Ways(self, search, self.field.spacing * lengths)

    def roomy_path(self, start: Array, end: Array) -> Array | None:
        """Return the (N, 3) samples of the wall-averse way between two points, or None when there is none."""
        from skimage.graph import MCP_Geometric

        clearance = np.maximum(self.field.values, 1e-6)
        search = MCP_Geometric(np.where(self.is_open, (clearance.max() / clearance) ** WALL_AVERSION, -1.0))
        goal = self.nearest_open(end)
        costs, _ = search.find_costs([self.nearest_open(start)], [goal])
        return self.field.positions(np.array(search.traceback(goal))) if np.isfinite(costs[goal]) else None

    def nearest_open(self, point: Array) -> tuple[int, int, int]:
        """Return the open sample nearest to a (3,) point."""
        index = self.field.nearest_index(point)
        if self.is_open[index]:
            return index
        open_samples = np.argwhere(self.is_open)
        distances = np.linalg.norm(self.field.positions(open_samples) - point, axis=1)
        i, j, k = open_samples[np.argmin(distances)]
        return int(i), int(j), int(k)


@dataclass(frozen=True, eq=False)
class Ways:
    """The shortest ways from one point to every sample of a graph."""

    graph: WaterGraph
    search: Any
    lengths: Array
    """(X, Y, Z) m, inf where there is no way."""

    def path_to(self, point: Array) -> Array | None:
        """Return the (N, 3) samples of the shortest way to a (3,) point, or None when there is none."""
        goal = self.graph.nearest_open(point)
        if not np.isfinite(self.lengths[goal]):
            return None
        return self.graph.field.positions(np.array(self.search.traceback(goal)))


def find_route(cavity: Cavity, field: DistanceField, vehicle_radius: float) -> Route:
    """Return the route between the two portals that are farthest apart through the water.

    With one portal the route ends at the farthest place from it, with none it joins the two farthest places.

    Raises:
        MeshError: the narrowest place between the ends is too tight for the vehicle; the message says how tight, where.
    """
    start, end = _choose_ends(cavity, field, vehicle_radius)
    path = WaterGraph(field, vehicle_radius).roomy_path(start, end)
    if path is None:
        raise MeshError(_too_tight(field, start, end, vehicle_radius))
    ends = np.vstack([start, path[1:-1], end]) if len(path) > 2 else np.vstack([start, end])
    points = _smooth(ends, field, vehicle_radius)
    return Route(points, field.clearance(points))


def _choose_ends(cavity: Cavity, field: DistanceField, vehicle_radius: float) -> tuple[Array, Array]:
    doors = [_behind(portal, field) for portal in cavity.portals]
    if len(doors) >= 2:
        graph = WaterGraph(field, 0.5 * vehicle_radius, MAX_SEARCH_SAMPLES // 8)
        indices = tuple(np.transpose([graph.nearest_open(door) for door in doors]))
        lengths = np.array([graph.ways_from(door).lengths[indices] for door in doors])
        first, last = np.unravel_index(np.argmax(np.where(np.isfinite(lengths), lengths, -1.0)), lengths.shape)
        return doors[min(first, last)], doors[max(first, last)]
    # The vehicle must be able to reach the farthest place, so the search keeps its clearance all the way.
    graph = WaterGraph(field, vehicle_radius)
    widest = graph.field.positions(np.array(np.unravel_index(np.argmax(graph.field.values), graph.field.values.shape)))
    start = doors[0] if doors else _farthest(graph, widest)
    return start, _farthest(graph, start)


def _behind(portal: Portal, field: DistanceField) -> Array:
    """Return the roomiest point along the portal's inward normal, within its half width, m."""
    depths = np.linspace(0.0, 0.5 * np.sqrt(portal.area), 20)
    points = portal.centre - depths[:, None] * portal.normal
    return np.asarray(points[np.argmax(field.clearance(points))])


def _farthest(graph: WaterGraph, point: Array) -> Array:
    """Return the place with the longest way from a point."""
    lengths = graph.ways_from(point).lengths
    index = np.unravel_index(np.argmax(np.where(np.isfinite(lengths), lengths, -1.0)), lengths.shape)
    return graph.field.positions(np.array(index))


def _too_tight(field: DistanceField, start: Array, end: Array, vehicle_radius: float) -> str:
    path = WaterGraph(field, 0.0).roomy_path(start, end)
    if path is None:
        return (
            f"There is no way through the water from {start.round(2)} m to {end.round(2)} m. The scan closes the "
            "passage in between; cut the obstacle away or build the two parts apart."
        )
    clearance = field.clearance(path)
    tightest = path[np.argmin(clearance)]
    return (
        f"The passage is too tight for the vehicle: its radius is {vehicle_radius:.2f} m, the clearance at "
        f"{tightest.round(2)} m is {clearance.min():.2f} m. Check --unit, or choose a smaller vehicle with --vehicle."
    )


def _smooth(path: Array, field: DistanceField, vehicle_radius: float) -> Array:
    """Return the path evenly resampled and smoothed, never closer to a wall than it was or the vehicle needs."""
    from scipy.ndimage import gaussian_filter1d

    step = 0.25 * SMOOTHING
    points = resample(path, step)
    for _ in range(10):
        moved = gaussian_filter1d(points, SMOOTHING / step / 2, axis=0, mode="nearest")
        moved[[0, -1]] = points[[0, -1]]
        needed = np.minimum(field.clearance(points), 1.2 * vehicle_radius)
        points = np.where((field.clearance(moved) >= needed)[:, None], moved, points)
    return resample(points, step)


def resample(path: Array, step: float) -> Array:
    """Return a polyline's points at equal distances of about `step` along it, m, ends kept."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    stations = np.linspace(0.0, lengths[-1], max(2, round(lengths[-1] / step) + 1))
    return np.stack([np.interp(stations, lengths, path[:, axis]) for axis in range(3)], axis=1)
