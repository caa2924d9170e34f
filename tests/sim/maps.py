"""Maps of known walls, and ways through them."""

from __future__ import annotations

import numpy as np

from aquanav_tools.sim import occupancy, way
from aquanav_tools.sim.occupancy import CELL, HIGHEST, LOWEST, PASSED, Maps
from aquanav_tools.types import Array

ALL_ROUND = np.array([(np.cos(turn), np.sin(turn), 0.0) for turn in np.radians(np.arange(0.0, 360.0, 5.0))])
REACH = 4.0


def empty(goal: Array, place: Array | None = None, heading: float = 0.5 * np.pi) -> Maps:
    """Return a map that begins at the origin, or elsewhere, with nothing known but that the vehicle came along y."""
    maps = occupancy.make_maps(1)
    occupancy.begin(maps, 0, np.zeros(3) if place is None else place, goal, heading)
    return maps


def look(maps: Maps, place: Array, rays: Array, ranges: Array) -> None:
    """Note what rays have met that reach 4 m."""
    reaches = np.full(len(rays), REACH)
    occupancy.see(maps, 0, place, rays, ranges, reaches)
    occupancy.be_at(maps, 0, place)


def found_way(maps: Maps, place: Array, goal: Array) -> Array:
    """Return the (P, 3) middles of the first cells of the way, m."""
    way.plan(maps, way.make_search(), 0, place, goal)
    return np.array([way.middle(maps, 0, p) for p in range(maps.lengths[0, 0])])


def known(maps: Maps, place: Array) -> int:
    """Return the evidence of the cell at a place: above 0 a wall, below 0 water."""
    return int(occupancy.evidence(maps, 0, *occupancy.cell_of(maps, 0, place)))


def pocket(goal: Array) -> Maps:
    """Return a known pocket, 2.4 m wide and 3.6 m high, from x = -3 m, where it is open, to x = 3 m."""
    maps = empty(goal)
    for x in np.arange(-3.0, 3.01, 0.5 * CELL):
        for y in np.arange(-1.2, 1.21, 0.5 * CELL):
            for z in np.arange(-1.8, 1.81, 0.5 * CELL):
                is_wall = x > 2.9 or abs(y) > 1.1 or abs(z) > 1.7
                place = np.array([x, y, z])
                if is_wall or known(maps, place) <= 0:
                    occupancy._add(maps, 0, *occupancy.cell_of(maps, 0, place), HIGHEST - LOWEST if is_wall else PASSED)
    return maps
