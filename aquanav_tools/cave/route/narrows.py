"""Narrow places of a passage, with the width that is free there and whether the vehicle fits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.mesh.contact import Surface
from aquanav_tools.cave.plane import plane_axes
from aquanav_tools.cave.route.route import resample
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

STEP = 0.1
"""Distance between the stations that are measured, m. A ledge of no thickness with a hole of radius r is half a step
away from one at most, where the width seems larger by less than 0.0025 / r m; it is refined afterwards."""
MIN_NARROWING = 1.2
"""A place counts as narrow when the passage is wider by at least this factor on both sides of it."""
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
    """A place where the passage is narrower than on both sides of it, or too tight for the vehicle."""

    position: Array
    """(3,) middle of the free width, world, m."""
    arc_length: float
    """Distance along the centreline, m."""
    width: float
    """Diameter of the largest ball that passes the cross-section, m."""
    vehicle_width: float
    """m."""

    @property
    def is_passable(self) -> bool:
        """Whether the vehicle fits through."""
        return self.width >= self.vehicle_width

    def __str__(self) -> str:
        """Return the sentence for a caver."""
        verdict = "narrower than" if not self.is_passable else "passable for"
        what = "the vehicle's" if not self.is_passable else "the vehicle of"
        return f"{self.width:.2f} m at {self.arc_length:.1f} m: {verdict} {what} {self.vehicle_width:.3f} m"


def find_narrows(centreline: Array, cavity: Cavity, vehicle_width: float) -> tuple[Narrow, ...]:
    """Return the narrow places along a line, in order; the narrowest of all is always among them.

    The width is exact at cross-sections square to the line: twice the distance to the wall from the roomiest point that
    is reached from the line uphill. Portals are no walls. The line need not be passable. A bend that is too short for a
    long vehicle is not seen.

    Args:
        centreline: (C, 3) through the water, for example a guide's, m; arc lengths count from its first point.
        cavity: the water.
        vehicle_width: diameter of the vehicle's capsule, m.
    """
    points = resample(centreline, STEP)
    walls = Surface(_walls(cavity))
    stations = np.arange(len(points), dtype=float)
    _, clearance = _roomiest(points, stations, walls, SURVEY_MOVES)
    step = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) / (len(points) - 1)
    narrows = []
    for low in _minima(clearance, vehicle_width):
        station, top, room = _narrowest_near(points, float(low), step, walls)
        narrows.append(Narrow(top, station * step, 2.0 * room, vehicle_width))
    return tuple(narrows)


def largest_vehicle(narrows: tuple[Narrow, ...]) -> float:
    """Return the width of the largest vehicle that fits through all narrow places of a line, m.

    Along the widest way between two places, it is the largest that gets from one to the other.
    """
    return min(narrow.width for narrow in narrows)


def _walls(cavity: Cavity) -> Mesh:
    return Mesh(cavity.mesh.vertices, np.ascontiguousarray(cavity.mesh.faces[cavity.labels == WALL]))


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
