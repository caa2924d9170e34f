"""How wide a passage is and what gets through it. Report, terminal and `aquanav info` take these numbers from here.

Clearance: distance from a point to the nearest wall. Lids of portals are no walls.
Width at a place of the route: diameter of the largest sphere that passes the cross-section there.
Narrowest place: where the route's width is least.
Narrow place: a place narrower than on both sides of it, and below NARROW_SHARE times the width of the vehicle.
Largest vehicle: diameter of the largest sphere that gets from the route's first point to its last, on whatever way.

So twice the clearance of the route is nowhere more than its width, and the largest vehicle is as wide as the narrowest
place, or wider where another way leads around that. A bend that is too short for a long vehicle is not seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.contact import Surface
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.geometry.polyline import length_of, resample
from aquanav_tools.geometry.volume.bottleneck_path import BottleneckPath, bottleneck_path
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, BoolArray, IntArray

STEP = 0.1
"""Distance between the stations that are measured, m. A ledge of no thickness with a hole of radius r is half a step
away from one at most, where the width seems larger by less than 0.0025 / r m; it is refined afterwards."""
NARROW_SHARE = 2.0
"""A place is narrow where half of the vehicle's width, or less, is left on either side of it."""
MIN_NARROWING = 1.2
"""... and where the passage is wider by at least this factor on both sides."""
SAME_WIDTH = 0.03
"""Widths that differ by less than this share are of one place: its cross-section and the widest way measure it to about
a hundredth each."""
NUM_DIRECTIONS = 8
"""Directions in a cross-section in which a roomier point is looked for."""
FIRST_MOVE = 0.5
"""First move within a cross-section, in clearances, so that it stays in the water."""
SURVEY_MOVES = 10
"""Moves per cross-section when looking for narrow places: the width is then known to about a hundredth."""
NUM_MOVES = 24
"""Moves per cross-section at a narrow place; each that finds no roomier point halves the next, to a ten thousandth."""
REFINEMENTS = (0.02, 0.004)
"""Distances between stations around a narrow place, m, one round each."""


@dataclass(frozen=True, eq=False)
class Narrow:
    """A place of the route and its width."""

    position: Array
    """(3,) middle of the free width, world, m."""
    arc_length: float
    """Distance along the route, m."""
    width: float
    """Diameter of the largest sphere that passes the cross-section, m."""
    vehicle_width: float
    """m."""

    @property
    def is_passable(self) -> bool:
        """Whether the vehicle fits through."""
        return self.width >= self.vehicle_width

    @property
    def is_narrow(self) -> bool:
        """Whether it is narrow for the vehicle."""
        return self.width < NARROW_SHARE * self.vehicle_width

    def __str__(self) -> str:
        """Return the sentence for a caver."""
        verdict = "narrower than" if not self.is_passable else "passable for"
        what = "the vehicle's" if not self.is_passable else "the vehicle of"
        return f"{self.width:.2f} m at {self.arc_length:.1f} m: {verdict} {what} {self.vehicle_width:.3f} m"


@dataclass(frozen=True, eq=False)
class RouteClearance:
    """Distance from the route to the nearest wall."""

    least: float
    """m."""
    arc_length: float
    """Where it is least, along the route, m."""
    position: Array
    """(3,) there, m."""
    width: float
    """Of the passage there, m."""
    mean: float
    """Along the route, m."""
    median: float
    """Along the route, m."""


@dataclass(frozen=True, eq=False)
class Passability:
    """What gets through a cave along its route."""

    vehicle_width: float
    """Diameter of the vehicle's capsule, m."""
    narrowest: Narrow
    """Of the whole route."""
    narrows: tuple[Narrow, ...]
    """The narrow places in order."""
    largest_vehicle: float
    """m."""
    clearance: RouteClearance

    @property
    def marked(self) -> tuple[Narrow, ...]:
        """The narrowest place, be it narrow or not, and all narrow places, in order."""
        if self.narrowest.is_narrow:
            return self.narrows
        return tuple(sorted((self.narrowest, *self.narrows), key=lambda narrow: narrow.arc_length))

    @property
    def has_wider_way(self) -> bool:
        """Whether a larger vehicle gets through on another way than the route."""
        return self.largest_vehicle > self.narrowest.width

    def __str__(self) -> str:
        """Return the numbers in sentences, each by its name."""
        place, near = self.narrowest, self.clearance
        where = f"at {place.arc_length:.1f} m of the route"
        if self.has_wider_way:
            where = f"on a wider way than the route, whose narrowest place, {where}, leaves {place.width:.2f} m"
        text = (
            f"Largest vehicle that gets through: {self.largest_vehicle:.2f} m wide ({where}); this one has "
            f"{self.vehicle_width:.2f} m. The route comes within {near.least:.2f} m of a wall, at "
            f"{near.arc_length:.1f} m"
        )
        is_beside = 2.0 * near.least < (1.0 - SAME_WIDTH) * near.width
        return text + (f", where the passage is {near.width:.2f} m wide." if is_beside else ".")

    def facts(self) -> dict[str, Any]:
        """Return all as plain values, for report.json."""
        near = self.clearance
        return {
            "text": str(self),
            "vehicle_width": self.vehicle_width,
            "largest_vehicle": self.largest_vehicle,
            "has_wider_way": self.has_wider_way,
            "narrowest": _facts(self.narrowest),
            "narrow_below": NARROW_SHARE * self.vehicle_width,
            "narrow_places": [_facts(narrow) for narrow in self.narrows],
            "clearance": {
                "least": near.least,
                "arc_length": near.arc_length,
                "position": near.position.tolist(),
                "width": near.width,
                "mean": near.mean,
                "median": near.median,
            },
        }


def measure_passability(cavity: Cavity, field: DistanceField, line: Array, vehicle_width: float) -> Passability:
    """Return what gets through a cave along a line.

    The width is exact at cross-sections square to the line: twice the distance to the wall from the roomiest point that
    is reached from the line uphill. Where a cross-section also runs through an alcove, that may be wider than the way
    on. So it counts only where a path is found on which a sphere of that width moves; otherwise that path's width does.

    Args:
        cavity: the water.
        field: its clearance.
        line: (C, 3) through the water, for example a guide's, m; arc lengths count from its first point. It need not be
            passable.
        vehicle_width: diameter of the vehicle's capsule, m.

    Raises:
        MeshError: the water does not join the line's ends.
    """
    walls = cavity.wall_surface
    points = resample(line, STEP)
    step = length_of(points) / (len(points) - 1)
    tops, rooms = _roomiest(points, np.arange(len(points), dtype=float), walls, SURVEY_MOVES)
    narrows = [
        Narrow(top, station * step, 2.0 * room, vehicle_width)
        for low in _minima(rooms, vehicle_width)
        for station, top, room in [_narrowest_near(points, float(low), step, walls)]
    ]
    narrowest = min(narrows, key=lambda narrow: narrow.width)
    way = _bottleneck_path(cavity, field, tops[[0, -1]], narrowest.width)
    proven = max((way, _path_through(tops, walls)), key=lambda path: path.width)
    if proven.width < (1.0 - SAME_WIDTH) * narrowest.width:
        narrowest = _bottleneck(proven, points, step, vehicle_width)
        narrows = sorted([*narrows, narrowest], key=lambda narrow: narrow.arc_length)
    is_wider = way.width > (1.0 + SAME_WIDTH) * narrowest.width
    return Passability(
        vehicle_width,
        narrowest,
        tuple(narrow for narrow in narrows if narrow.is_narrow),
        way.width if is_wider else narrowest.width,
        route_clearance(walls, points),
    )


def route_clearance(walls: Surface, line: Array) -> RouteClearance:
    """Return the clearance of an evenly spaced (C, 3) line from the cavity's walls."""
    clearance = walls.distance(line)
    least = int(np.argmin(clearance))
    _, rooms = _roomiest(line, np.array([float(least)]), walls, NUM_MOVES)
    return RouteClearance(
        float(clearance[least]),
        length_of(line[: least + 1]),
        line[least],
        2.0 * float(rooms[0]),
        float(clearance.mean()),
        float(np.median(clearance)),
    )


def _bottleneck_path(cavity: Cavity, field: DistanceField, ends: Array, width: float) -> BottleneckPath:
    """Return the widest way between (2, 3) ends; most of the search is spared where it is no wider than the route."""
    enough = 0.5 * (1.0 + SAME_WIDTH) * width + field.spacing
    way = bottleneck_path(cavity.wall_surface, field, ends[0], ends[1], enough)
    if way is not None and way.clearance.min() >= enough - field.spacing:
        way = bottleneck_path(cavity.wall_surface, field, ends[0], ends[1])
    if way is None:
        raise MeshError(f"No water joins the ends of the route, {ends[0].round(2)} m and {ends[1].round(2)} m.")
    return way


def _path_through(tops: Array, walls: Surface) -> BottleneckPath:
    """Return the path through the (S, 3) roomiest points of a line's cross-sections."""
    points = resample(tops, REFINEMENTS[0])
    return BottleneckPath(points, walls.distance(points))


def _bottleneck(way: BottleneckPath, points: Array, step: float, vehicle_width: float) -> Narrow:
    """Return the tightest place of the widest way as a place of a line's (C, 3) points, `step` m apart."""
    nearest = int(np.argmin(np.linalg.norm(points - way.tightest, axis=1)))
    return Narrow(way.tightest, nearest * step, way.width, vehicle_width)


def _facts(narrow: Narrow) -> dict[str, Any]:
    return {
        "position": narrow.position.tolist(),
        "arc_length": narrow.arc_length,
        "width": narrow.width,
        "is_passable": narrow.is_passable,
        "text": str(narrow),
    }


def _narrowest_near(points: Array, station: float, step: float, walls: Surface) -> tuple[float, Array, float]:
    """Return the station, the roomiest point and its clearance (m) of the narrowest cross-section near a station."""
    for refinement in REFINEMENTS:
        near = station + np.linspace(-5.0, 5.0, 11) * refinement / step
        near = near[(near >= 0.0) & (near <= len(points) - 1)]
        tops, rooms = _roomiest(points, near, walls, NUM_MOVES)
        best = int(np.argmin(rooms))
        station = float(near[best])
    return station, tops[best], float(rooms[best])


def _roomiest(points: Array, stations: Array, walls: Surface, num_moves: int) -> tuple[Array, Array]:
    """Return the (S, 3) roomiest points of the cross-sections at (S,) fractional stations, and their clearance, m.

    Climbs from the line in steps below the clearance, so that it never passes through a wall.
    """
    index = np.arange(len(points))
    places = np.stack([np.interp(stations, index, points[:, axis]) for axis in range(3)], axis=1)
    ahead = np.gradient(points, axis=0)
    normals = np.stack([np.interp(stations, index, ahead[:, axis]) for axis in range(3)], axis=1)
    axes = np.array([plane_axes(normal / np.linalg.norm(normal)) for normal in normals])
    angles = 2.0 * np.pi * np.arange(NUM_DIRECTIONS) / NUM_DIRECTIONS
    ways = np.einsum("da,sai->sdi", np.stack([np.cos(angles), np.sin(angles)], axis=1), axes)
    clearance = walls.distance(places)
    share = np.full(len(places), FIRST_MOVE)
    for _ in range(num_moves):
        tries = places[:, None] + (share * clearance)[:, None, None] * ways
        rooms = walls.distance(tries.reshape(-1, 3)).reshape(len(places), NUM_DIRECTIONS)
        best = rooms.argmax(axis=1)
        rows = np.arange(len(places))
        is_better: BoolArray = rooms[rows, best] > clearance
        places = np.where(is_better[:, None], tries[rows, best], places)
        clearance = np.where(is_better, rooms[rows, best], clearance)
        share = np.where(is_better, share, 0.5 * share)
    return places, clearance


def _minima(clearance: Array, vehicle_width: float) -> IntArray:
    """Return the stations of the narrowest place, of every clear narrowing, and of every stretch too tight."""
    from scipy.ndimage import label

    stretches, count = label(2.0 * clearance < vehicle_width)
    chosen = {int(np.argmin(clearance)), *_dips(clearance)}
    for stretch in range(1, count + 1):
        inside = np.flatnonzero(stretches == stretch)
        if not chosen & set(inside.tolist()):
            chosen.add(int(inside[np.argmin(clearance[inside])]))
    return np.array(sorted(chosen), dtype=np.int64)


def _dips(clearance: Array) -> list[int]:
    """Return the stations with MIN_NARROWING times the room on both sides, before the next narrower place or an end."""
    dips = []
    falls, rises = np.diff(clearance, prepend=np.inf) < 0.0, np.diff(clearance, append=np.inf) >= 0.0
    for station in np.flatnonzero(falls & rises):
        here = clearance[station]
        before, after = clearance[:station][::-1], clearance[station + 1 :]
        rooms = [side[: np.argmax(side < here) if (side < here).any() else None] for side in (before, after)]
        if min(room.max(initial=0.0) for room in rooms) >= MIN_NARROWING * here:
            dips.append(int(station))
    return dips
