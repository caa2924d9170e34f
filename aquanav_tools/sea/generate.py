"""A new bay of rocks and reefs from a seed: always one that the boat can cross, with the shortest way."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.sea.outlines import clearance_at
from aquanav_tools.sea.sea_map import Berth, Goal, Rock, SeaMap
from aquanav_tools.sea.shortest import shortest_path
from aquanav_tools.types import Array

MAX_DARTS = 2000
"""Places that are tried for rocks."""
MAX_MAPS = 20
"""Draws of a whole map until one can be crossed."""
MAX_LINES = 2000
"""Tangents among which the way is sought before another bay is drawn; without a way there are a hundred times more."""
NUM_BERTHS = 64
"""Places that are tried for start and goal in each draw."""
MIN_CORNERS, MAX_CORNERS = 6, 9
"""Of a rock's outline."""
FLATTEST = 0.6
"""Least width of a rock over its length."""
OVERLAP = 0.5
"""Distance between two rocks of a ridge over the sum of their radii: below FLATTEST, so that they overlap."""
LONGEST_RIDGE = 4
"""Rocks."""
HIGHEST = 8.0
"""Of a rock above the water, m; the original's reach 8."""
LOWEST = 0.5
"""Of a rock above the water, m."""
MAX_START_TURN = float(np.radians(45.0))
"""The boat begins heading for the goal within this angle, as vehicles in caves do, rad."""


@dataclass(frozen=True)
class MapSettings:
    """What a bay is like. The values given are near the original's two maps, which rocks cover by 8 and 13 %."""

    length: float = 180.0
    """Along x, m."""
    width: float = 80.0
    """Along y, m."""
    depth: float = 6.0
    """m."""
    density: float = 0.1
    """Share of the bay that rocks take up, each with a circle around it."""
    clearance: float = 7.0
    """Least gap between two rocks that do not form a ridge, m; the original's narrowest is 7."""
    min_radius: float = 3.0
    """Of the circle around a rock, m."""
    max_radius: float = 9.0
    """m."""
    ridge_share: float = 0.25
    """Share of rocks that grow out of the one before them."""
    reef_share: float = 0.3
    """Share of rocks that end below still water."""
    reef_depth: float = 0.4
    """Reefs end at most this far below still water, m."""
    boat_width: float = 3.09
    """m; the original's boat."""
    margin: float = 0.25
    """Room that the way keeps on either side of the boat, m."""
    min_path: float = 0.5
    """Least distance from start to goal as the crow flies, over the bay's length."""
    tolerance: float = 5.0
    """The goal is reached within this distance, m: about half a boat's length."""

    def __post_init__(self) -> None:
        for name in ("length", "width", "depth", "clearance", "min_radius", "max_radius", "boat_width", "tolerance"):
            _check(0.0 < getattr(self, name) < 1e4, name, getattr(self, name), "a length above 0 m")
        for name in ("ridge_share", "reef_share"):
            _check(0.0 <= getattr(self, name) <= 1.0, name, getattr(self, name), "a share from 0 to 1")
        _check(0.0 <= self.density <= 0.3, "density", self.density, "a share from 0 to 0.3; more leaves no way")
        _check(0.0 <= self.min_path <= 0.9, "min_path", self.min_path, "a share of the bay's length from 0 to 0.9")
        _check(0.0 <= self.margin < 100.0, "margin", self.margin, "a length of 0 m or more")
        _check(0.0 <= self.reef_depth < self.depth, "reef_depth", self.reef_depth, "0 or more and less than depth")
        _check(self.min_radius <= self.max_radius, "min_radius", self.min_radius, "at most max_radius")
        room = 2.0 * self.room
        _check(self.clearance >= room, "clearance", self.clearance, f"at least boat and margins, {room:g} m")
        least = 2.0 * (self.max_radius + self.room)
        _check(min(self.length, self.width) >= least, "width", self.width, f"with length at least {least:g} m")

    @property
    def room(self) -> float:
        """Clearance that the way keeps, from the boat's middle line, m."""
        return 0.5 * self.boat_width + self.margin


def generate_map(seed: int, settings: MapSettings | None = None) -> SeaMap:
    """Return the bay of a seed, its middle at the world's origin; the same for the same seed and settings.

    Raises:
        InputError: the settings leave no room for the rocks, or for a way between them; the message says which.
    """
    return draw_map(np.random.default_rng(seed), settings or MapSettings(), f"bay-{seed}")


def draw_map(rng: np.random.Generator, settings: MapSettings, name: str = "bay") -> SeaMap:
    """Return the next bay that a generator gives.

    Raises:
        InputError: as `generate_map`.
    """
    half = 0.5 * np.array([settings.length, settings.width])
    edge = np.concatenate([-half, half])
    for _ in range(MAX_MAPS):
        rocks = _draw_rocks(rng, settings, half)
        bay = SeaMap(name, edge, settings.depth, rocks, Goal(np.zeros((1, 2))), (), (), source="aquanav")
        found = _draw_way(rng, settings, bay, half)
        if found is not None:
            return found
    raise InputError(
        f"None of {MAX_MAPS} bays of {settings.length:g} x {settings.width:g} m could be crossed with "
        f"{settings.room:g} m to either side over {settings.min_path:.0%} of its length: rocks leave too little room. "
        "Take a lower density, smaller rocks, or a shorter min_path."
    )


def _draw_way(rng: np.random.Generator, settings: MapSettings, bay: SeaMap, half: Array) -> SeaMap | None:
    """Return the bay with a start, a goal and the shortest way; None where no two places are free and joined."""
    places = rng.uniform(-half, half, (NUM_BERTHS, 2))
    turn = rng.uniform(-MAX_START_TURN, MAX_START_TURN)
    pairs = _pairs(places, settings.min_path * settings.length, settings.room + settings.tolerance, *bay.outlines)
    if pairs[0] < 0:
        return None
    start, goal = places[pairs[0]], Goal(places[pairs[1]][None], settings.tolerance)
    path = shortest_path(bay.outlines, start, goal, settings.room, MAX_LINES)
    if path is None:
        return None
    east, north = goal.centre - start
    berth = Berth(start, float(np.arctan2(north, east) + turn))
    finished = SeaMap(bay.name, bay.edge, bay.depth, bay.rocks, goal, (berth,), (path,), source=bay.source)
    finished.__dict__["outlines"] = bay.outlines  # the rocks are the same, so they need not be packed again
    return finished


def _draw_rocks(rng: np.random.Generator, settings: MapSettings, half: Array) -> tuple[Rock, ...]:
    darts = rng.random((MAX_DARTS, 7 + MAX_CORNERS))
    wanted = settings.density * settings.length * settings.width
    radii = (settings.min_radius, settings.max_radius)
    corners, counts, covered = _place(darts, half, radii, settings.clearance, settings.ridge_share, wanted)
    if covered < wanted:
        raise InputError(
            f"Rocks of {settings.min_radius:g} to {settings.max_radius:g} m with gaps of {settings.clearance:g} m "
            f"cover {covered / (settings.length * settings.width):.3f} of the bay after {MAX_DARTS} tries, and density "
            f"asks for {settings.density:g}. Take a lower density, a smaller clearance or smaller rocks."
        )
    is_reef = rng.random(len(counts)) < settings.reef_share
    heights = rng.random(len(counts))
    tops = np.where(is_reef, -settings.reef_depth * (1.0 - heights), LOWEST + (HIGHEST - LOWEST) * heights)
    outlines = np.split(corners, np.cumsum(counts)[:-1]) if len(counts) else []
    return tuple(Rock(outline, top) for outline, top in zip(outlines, tops.tolist(), strict=True))


@numba.njit(cache=True)
def _place(darts, half, radii, clearance, ridge_share, wanted):  # type: ignore[no-untyped-def]
    """Return the (V, 2) corners of rocks, how many each has, and the area that they cover when none overlaps, m^2.

    A dart is numbers in [0, 1): place (2), radius, whether the rock continues the ridge of the one before, and shape.
    """
    discs, ridges = np.empty((len(darts), 3)), np.empty(len(darts), dtype=np.int64)
    corners, counts = np.empty((len(darts) * MAX_CORNERS, 2)), np.empty(len(darts), dtype=np.int64)
    count, num_corners, covered, num_in_ridge = 0, 0, 0.0, 0
    for dart in darts:
        if covered >= wanted:
            break
        radius = radii[0] + (radii[1] - radii[0]) * dart[2]
        is_joined = dart[3] < ridge_share and 0 < num_in_ridge < LONGEST_RIDGE
        x, y = half[0] * (2.0 * dart[0] - 1.0), half[1] * (2.0 * dart[1] - 1.0)
        ridge = ridges[count - 1] + 1 if count > 0 else 0
        if is_joined:
            angle, apart = 2.0 * np.pi * dart[0], OVERLAP * (radius + discs[count - 1, 2])
            x, y = discs[count - 1, 0] + apart * np.cos(angle), discs[count - 1, 1] + apart * np.sin(angle)
            ridge -= 1
        is_free = abs(x) < half[0] and abs(y) < half[1]
        for k in range(count):
            gap = np.hypot(x - discs[k, 0], y - discs[k, 1]) - radius - discs[k, 2]
            is_free &= ridges[k] == ridge or gap >= clearance
        if is_free:
            discs[count, 0], discs[count, 1], discs[count, 2], ridges[count] = x, y, radius, ridge
            counts[count], area = _shape(x, y, radius, dart[4:], corners[num_corners:])
            num_corners += counts[count]
            covered += area
            num_in_ridge = num_in_ridge + 1 if is_joined else 1
            count += 1
    return corners[:num_corners], counts[:count], covered


@numba.njit(cache=True)
def _shape(x, y, radius, shape, corners):  # type: ignore[no-untyped-def]
    """Write a convex outline, corners on an ellipse at uneven angles; return their number and its area, m^2."""
    num = MIN_CORNERS + int((MAX_CORNERS + 1 - MIN_CORNERS) * shape[0])
    flatness, tilt = FLATTEST + (1.0 - FLATTEST) * shape[1], 2.0 * np.pi * shape[2]
    for k in range(num):
        angle = 2.0 * np.pi * (k + 0.6 * (shape[3 + k] - 0.5)) / num
        along, across = radius * np.cos(angle), flatness * radius * np.sin(angle)
        corners[k, 0] = x + np.cos(tilt) * along - np.sin(tilt) * across
        corners[k, 1] = y + np.sin(tilt) * along + np.cos(tilt) * across
    area = 0.0
    for k in range(num):
        a, b = corners[k - 1 if k > 0 else num - 1], corners[k]
        area += 0.5 * ((a[0] - x) * (b[1] - y) - (b[0] - x) * (a[1] - y))
    return num, area


@numba.njit(cache=True)
def _pairs(places, min_path, room, corners, first, discs, edge):  # type: ignore[no-untyped-def]
    """Return the numbers of the first two places that are free and far enough apart; -1 where there are none."""
    is_free = np.empty(len(places), dtype=np.bool_)
    for n in range(len(places)):
        is_free[n] = clearance_at(corners, first, discs, edge, places[n, 0], places[n, 1]) >= room
        for k in range(n):
            apart = np.hypot(places[n, 0] - places[k, 0], places[n, 1] - places[k, 1])
            if is_free[n] and is_free[k] and apart >= min_path:
                return k, n
    return -1, -1


def _check(is_right: bool, name: str, value: float, rule: str) -> None:
    if not is_right:
        raise InputError(f"The map's {name} is {value:g}; it must be {rule}.")
