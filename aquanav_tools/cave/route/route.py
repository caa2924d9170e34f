"""The route: the way through the water from entrance to goal that keeps away from the walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import Cavity, Portal
from aquanav_tools.errors import InputError, MeshError
from aquanav_tools.geometry.polyline import length_of, resample
from aquanav_tools.geometry.volume.bottleneck_path import bottleneck_path
from aquanav_tools.geometry.volume.field import BAND, DistanceField
from aquanav_tools.geometry.volume.geodesic import WaterGraph
from aquanav_tools.types import Array

COARSE_NODES = 50_000
"""Nodes that suffice to tell which portals are farthest apart."""
SMOOTHING = 0.4
"""Length over which the route is smoothed, m."""


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
        return length_of(self.points)


def find_route(
    cavity: Cavity,
    field: DistanceField,
    vehicle_radius: float,
    entrance: Array | None = None,
    goal: Array | None = None,
    graph: WaterGraph | None = None,
) -> Route:
    """Return the route between the two portals that are farthest apart through the water.

    With one portal the route ends at the farthest place from it, with none it joins the two farthest places.

    Args:
        cavity: whose portals are the ends that are not given.
        field: of the cavity.
        vehicle_radius: clearance that the route keeps, m.
        entrance: (3,) where the route begins instead: in the water, or on a portal.
        goal: (3,) where the route ends instead: in the water, or on a portal.
        graph: of the water with the vehicle's radius for clearance, where it is at hand: it takes time to make.

    Raises:
        InputError: an end that is given lies in rock.
        MeshError: the narrowest place between the ends is too tight for the vehicle; the message says how tight, where.
    """
    graph = graph or WaterGraph(field, vehicle_radius)
    start, end = _choose_ends(cavity, field, graph, entrance, goal)
    path = graph.roomy_path(start, end)
    if path is None:
        raise _too_tight(cavity, field, start, end, vehicle_radius)
    ends = np.vstack([start, path[1:-1], end]) if len(path) > 2 else np.vstack([start, end])
    points = _smooth(ends, field, vehicle_radius)
    return Route(points, field.clearance(points))


def _choose_ends(
    cavity: Cavity, field: DistanceField, graph: WaterGraph, entrance: Array | None, goal: Array | None
) -> tuple[Array, Array]:
    start = None if entrance is None else _given_end(cavity, field, entrance, "entrance")
    end = None if goal is None else _given_end(cavity, field, goal, "goal")
    if start is not None and end is not None:
        return start, end
    doors = [_behind(portal, field) for portal in cavity.portals]
    if start is None and end is None:
        if len(doors) < 2:
            return _ends_without_portals(graph, doors)
        return _farthest_doors(graph, doors)
    given = start if start is not None else end
    assert given is not None
    other = _farthest_door(graph, doors, given)
    return (given, other) if start is not None else (other, given)


def _given_end(cavity: Cavity, field: DistanceField, point: Array, name: str) -> Array:
    """Return a place in the water for an end that the user named, by a point in the water or on a portal."""
    point = np.asarray(point, dtype=np.float64)
    for portal in cavity.portals:
        offset = point - portal.centre
        if abs(offset @ portal.normal) <= 2.0 * field.spacing and offset @ offset <= portal.area:
            return _behind(portal, field)
    clearance = field.clearance_at(point)
    if clearance <= 0.0:
        raise InputError(
            f"The {name} {point.round(2)} m lies in rock, {'more than ' * (clearance <= -BAND * field.spacing)}"
            f"{-clearance:.2f} m from the water. Give a point in the water or on a portal, in metres."
        )
    return point


def _coarse(graph: WaterGraph) -> WaterGraph:
    """Return a graph of fewer nodes that also passes places too tight for the vehicle."""
    return WaterGraph(graph.field, 0.5 * graph.min_clearance, COARSE_NODES)


def _farthest_doors(graph: WaterGraph, doors: list[Array]) -> tuple[Array, Array]:
    coarse = _coarse(graph)
    lengths = np.array([coarse.ways_from(door).lengths_to(np.array(doors)) for door in doors])
    first, last = np.unravel_index(np.argmax(np.where(np.isfinite(lengths), lengths, -1.0)), lengths.shape)
    return doors[min(first, last)], doors[max(first, last)]


def _farthest_door(graph: WaterGraph, doors: list[Array], given: Array) -> Array:
    """Return the portal's place farthest from a point; without another portal, the farthest place at all."""
    coarse = _coarse(graph)
    others = [door for door in doors if np.linalg.norm(door - given) > coarse.spacing]
    if not others:
        return _farthest(graph, given)
    lengths = coarse.ways_from(given).lengths_to(np.array(others))
    return others[int(np.argmax(np.where(np.isfinite(lengths), lengths, -1.0)))]


def _ends_without_portals(graph: WaterGraph, doors: list[Array]) -> tuple[Array, Array]:
    # The vehicle must be able to reach the farthest place, so the search keeps its clearance all the way.
    start = doors[0] if doors else _farthest(graph, graph.points[np.argmax(graph.clearance)])
    return start, _farthest(graph, start)


def _behind(portal: Portal, field: DistanceField) -> Array:
    """Return the roomiest point along the portal's inward normal, within its half width, m."""
    depths = np.linspace(0.0, 0.5 * np.sqrt(portal.area), 20)
    points = portal.centre - depths[:, None] * portal.normal
    return np.asarray(points[np.argmax(field.clearance(points))])


def _farthest(graph: WaterGraph, point: Array) -> Array:
    """Return the place with the longest way from a point."""
    lengths = graph.ways_from(point).lengths
    farthest: Array = graph.points[np.argmax(np.where(np.isfinite(lengths), lengths, -1.0))]
    return farthest


def _too_tight(cavity: Cavity, field: DistanceField, start: Array, end: Array, vehicle_radius: float) -> MeshError:
    """Return the error that says where the widest way is too narrow, and which vehicle would fit."""
    found = bottleneck_path(cavity.wall_surface, field, start, end)
    if found is None:
        return MeshError(
            f"There is no way through the water from {start.round(2)} m to {end.round(2)} m. The wall closes the "
            "passage in between; cut the obstacle away or build the two parts apart.",
            [(_place(start), "start of the route"), (_place(end), "its end")],
        )
    where = found.tightest
    along = length_of(found.points[: int(np.argmin(found.clearance)) + 1])
    if found.width >= 2.0 * vehicle_radius:
        return MeshError(
            f"The vehicle, {2.0 * vehicle_radius:.3f} m wide, all but fits: {along:.1f} m along the widest way, at "
            f"{where.round(2)} m, {found.width:.2f} m are free, and of the places sampled there every "
            f"{field.spacing:.2f} m none leaves it room. Choose a smaller vehicle with --vehicle, or end the cave "
            "before that place with --cut.",
            [(_place(where), f"{found.width:.2f} m wide")],
        )
    return MeshError(
        f"The passage is too tight for the vehicle: {found.width:.2f} m at {along:.1f} m along the widest way, at "
        f"{where.round(2)} m: narrower than the vehicle's {2.0 * vehicle_radius:.3f} m. The largest vehicle that "
        f"fits is {found.width:.2f} m wide. Check the unit (--unit of a scan), or choose a smaller vehicle with "
        "--vehicle.",
        [(_place(where), f"{found.width:.2f} m wide")],
    )


def _place(point: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z


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
