"""What the drawings of a cave show: the water's outline, the line through it, its stations and the places to know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import Cavity, to_manifold
from aquanav_tools.cave.measure.sections import Section
from aquanav_tools.geometry.polyline import arc_lengths
from aquanav_tools.report.relief import View
from aquanav_tools.survey.legs import SurveyLegs
from aquanav_tools.types import Array

SPECK = 1e-4
"""Rings below this share of the largest one's area are left out: they would be smaller than the ink around them."""
EDGE_ON = 1e-3
"""Half the width given to a lid that is seen edge-on, m."""


@dataclass(frozen=True, eq=False)
class Mark:
    """A place that the drawings point at, such as a narrow one."""

    position: Array
    """(3,) m."""
    text: str
    """A few words beside it: "0.41 m"."""
    size: float
    """Free width there, m."""
    is_warning: bool = True
    """Whether the vehicle does not pass, which is drawn in red."""


@dataclass(frozen=True, eq=False)
class CaveMap:
    """A cave, ready to be drawn."""

    name: str
    cavity: Cavity
    centreline: Array
    """(C, 3) the route, m."""
    sections: tuple[Section, ...]
    """At the stations along the route."""
    marks: tuple[Mark, ...] = ()
    branches: tuple[Array, ...] = ()
    """(C, 3) other lines of the centreline, m."""
    has_north: bool = False
    """Whether y is north; otherwise no drawing names a bearing."""
    north_unknown: str = "north is not known"
    """What is said of directions where it is not."""
    seen: str = "seen by the scan"
    """What is said of wall that the source shows,"""
    filled: str = "filled in"
    """and of other wall."""
    survey: SurveyLegs | None = None
    """Stations and legs of the survey that the cave was made from."""

    @cached_property
    def solid(self) -> Any:
        """The water as a manifold3d solid."""
        return to_manifold(self.cavity.mesh)

    @property
    def upward(self) -> str:
        """What is up on a plan."""
        return "north up" if self.has_north else f"y up; {self.north_unknown}"

    @property
    def stations(self) -> Array:
        """(S, 3) m."""
        return np.array([section.centre for section in self.sections]).reshape(-1, 3)

    @property
    def places(self) -> Array:
        """(M, 3) positions of the marks, m."""
        return np.array([mark.position for mark in self.marks]).reshape(-1, 3)

    @property
    def length(self) -> float:
        """Of the route, m."""
        return float(arc_lengths(self.centreline)[-1])

    def along(self, points: Array) -> Array:
        """Return the (N,) metres along the route of the places nearest to (N, 3) points."""
        from scipy.spatial import cKDTree

        lengths: Array = arc_lengths(self.centreline)[cKDTree(self.centreline).query(points)[1]]
        return lengths


def silhouette(solid: Any, view: View) -> tuple[Array, ...]:
    """Return the outline of a manifold3d solid in a view: (K, 2) rings in picture coordinates, m.

    Outer rings run counter-clockwise; a ring that runs clockwise bounds a place where one sees past the cave.
    """
    turn = np.stack([view.right, view.up, view.towards])
    flat = solid.transform(np.column_stack([turn, np.zeros(3)])).project()
    rings = tuple(np.asarray(ring) for ring in flat.to_polygons())
    areas = np.array([signed_area(ring) for ring in rings])
    return tuple(ring for ring, area in zip(rings, areas, strict=True) if abs(area) > SPECK * areas.max())


def signed_area(ring: Array) -> float:
    """Return the area inside a (K, 2) ring, m^2; negative when it runs clockwise."""
    x, y = ring[:, 0], ring[:, 1]
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def lid_rings(cavity: Cavity, label: int, view: View) -> tuple[Array, ...]:
    """Return the (K, 2) rings of a portal's lid in a view; one seen edge-on is a ring without area."""
    import shapely

    faces = view.project(cavity.mesh.triangles[cavity.labels == label])
    thick = shapely.buffer(shapely.polygons(faces), EDGE_ON, quad_segs=1)
    lid = shapely.union_all(thick)
    return tuple(np.asarray(piece.exterior.coords) for piece in getattr(lid, "geoms", (lid,)))


def bounds(rings: Sequence[Array]) -> tuple[Array, Array]:
    """Return the (2,) lowest and (2,) highest coordinates of some rings."""
    corners = np.concatenate(list(rings))
    return corners.min(axis=0), corners.max(axis=0)
