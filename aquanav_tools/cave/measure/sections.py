"""True cross-sections of the water along a route, with left, right, up and down as a caver measures them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.geometry.mesh.slicing import polygons_in_plane
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.geometry.polyline import arc_lengths, point_at, resample
from aquanav_tools.types import Array, Mesh

TANGENT_LENGTH = 1.0
"""A section stands across the route's direction over this length, m: that of the panels, about a vehicle and a half."""
ROUND_SPACINGS = (1.0, 2.0, 5.0)
"""Stations are these times a power of ten metres apart, which is easy to read off."""
MAX_STATIONS = 36
"""More sections than this no longer fit one sheet at a legible size."""


@dataclass(frozen=True, eq=False)
class Section:
    """The water's cross-section around one station of a route.

    Plane coordinates are metres from the station: first to the left, looking along the route, then up. Up is as
    upright as the plane allows: it leans by as much as the route climbs.
    """

    arc_length: float
    """Distance along the route, m."""
    centre: Array
    """(3,) the station, world, m."""
    normal: Array
    """(3,) unit vector along the route."""
    outline: Array
    """(K, 2) outer ring, counter-clockwise, not closed, plane coordinates."""
    holes: tuple[Array, ...]
    """(H, 2) each: rings of the pillars inside, plane coordinates."""
    area: float
    """Of the water, without pillars, m^2."""
    perimeter: float
    """Of the wall, pillars included, m."""
    left: float
    """From the station to the first wall, m; so are the next three."""
    right: float
    up: float
    down: float

    @property
    def width(self) -> float:
        """Across the whole section, m; more than left + right where the station is not at the widest height."""
        return float(np.ptp(self.outline[:, 0]))

    @property
    def height(self) -> float:
        """From the lowest to the highest point of the section, m."""
        return float(np.ptp(self.outline[:, 1]))

    @property
    def outline_world(self) -> Array:
        """(K, 3) outer ring, m."""
        world: Array = self.centre + self.outline @ plane_axes(self.normal)
        return world


def station_spacing(length: float) -> float:
    """Return the smallest round spacing, m, that puts at most MAX_STATIONS stations on a route of `length` m."""
    smallest = length / (MAX_STATIONS - 1)
    decade = 10.0 ** np.floor(np.log10(smallest))
    return float(min(step * decade for step in (*ROUND_SPACINGS, 10.0) if step * decade >= smallest * (1.0 - 1e-9)))


def cross_sections(cavity: Cavity, points: Array, spacing: float) -> tuple[Section, ...]:
    """Return the sections at 0, `spacing`, 2 * `spacing`, ... metres along a line through the water.

    Where the plane of a station does not meet the water around it (a line that touches a wall), there is no section.

    Args:
        cavity: the water.
        points: (C, 3) polyline, for example a guide's centreline, m.
        spacing: distance between stations along the line, m.

    Raises:
        ValueError: the spacing is not positive.
    """
    if not spacing > 0.0:
        raise ValueError(f"The spacing of stations must be positive, not {spacing} m.")
    lengths = arc_lengths(points)
    stations = np.arange(0.0, lengths[-1] + 1e-9, spacing)
    centres = point_at(points, lengths, stations)
    chords = _chords(points, lengths, stations)
    found = (_section(cavity.mesh, *row) for row in zip(stations, centres, chords, strict=True))
    return tuple(section for section in found if section is not None)


def floor_and_ceiling(mesh: Mesh, points: Array) -> tuple[Array, Array]:
    """Return the (N,) heights (world z) of the floor straight below and the ceiling straight above (N, 3) points, m.

    NaN where a point outside the water sees none.
    """
    scene, heights = RayScene(mesh), []
    for sign in (-1.0, 1.0):
        distance = scene.lengths(points, np.tile([0.0, 0.0, sign], (len(points), 1)))
        heights.append(points[:, 2] + sign * np.where(np.isfinite(distance), distance, np.nan))
    return heights[0], heights[1]


def _chords(points: Array, lengths: Array, stations: Array) -> Array:
    """Return the (S, 3) unit directions of a polyline over TANGENT_LENGTH around each station."""
    smooth = resample(points, 0.1 * TANGENT_LENGTH)
    along = np.linspace(0.0, lengths[-1], len(smooth))
    half = np.minimum(0.5 * TANGENT_LENGTH, 0.5 * lengths[-1])
    # A shorter but centred window at the ends: a one-sided chord would lean where the route bends.
    reach = np.clip(np.minimum(stations, lengths[-1] - stations), 0.1 * half, half)
    ahead = point_at(smooth, along, np.minimum(stations + reach, lengths[-1]))
    behind = point_at(smooth, along, np.maximum(stations - reach, 0.0))
    chords = ahead - behind
    unit: Array = chords / np.linalg.norm(chords, axis=1, keepdims=True)
    return unit


def _section(mesh: Mesh, arc_length: float, centre: Array, normal: Array) -> Section | None:
    import shapely

    polygon = water_around(mesh, centre, normal)
    if polygon is None:
        return None
    origin = shapely.Point(0.0, 0.0)
    reach = 2.0 * float(np.abs(polygon.bounds).max()) + 1.0
    left, right, up, down = (
        float(shapely.LineString([(0.0, 0.0), (reach * u, reach * v)]).intersection(polygon.boundary).distance(origin))
        for u, v in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
    )
    return Section(
        arc_length=float(arc_length),
        centre=centre,
        normal=normal,
        outline=np.asarray(polygon.exterior.coords)[:-1],
        holes=tuple(np.asarray(ring.coords)[:-1] for ring in polygon.interiors),
        area=float(polygon.area),
        perimeter=float(polygon.length),
        left=left, right=right, up=up, down=down,
    )  # fmt: skip


def water_around(mesh: Mesh, centre: Array, normal: Array) -> Any:
    """Return the shapely polygon of the water around a station, in plane coordinates; None where it is in rock."""
    import shapely

    origin = shapely.Point(0.0, 0.0)
    return next((piece for piece in polygons_in_plane(mesh, centre, normal) if piece.contains(origin)), None)
