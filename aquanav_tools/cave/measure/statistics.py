"""What there is to say about a cave in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.measure.sections import cross_sections
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.polyline import arc_lengths, resample
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, Mesh

NUM_MEAN_SECTIONS = 60
"""Stretches between the sections that the mean is taken over; four times as many change a real cave's by 0.5 %."""
ROSE_BIN_DEG = 10
"""Width of a sector of the rose diagram, degrees; the first is centred on north."""
ROSE_LEG = 1.0
"""Lines are cut into legs of this length for the rose, m: a survey's legs are no shorter, and bends still show."""

STILL_THERE = 0.01
"""Wall that cutting the ends did not touch is moved by less than this, voxels: only stored as float32."""


@dataclass(frozen=True)
class CaveStatistics:
    """Sizes of a cave, SI units."""

    num_triangles: int
    volume: float
    """Water, m^3."""
    wall_area: float
    """Without the portals, m^2."""
    observed_share: float
    """Share of the wall that the scan saw."""
    genus: int
    """Number of pillars and loops: ways around that do not shrink to a point."""
    num_portals: int
    route_length: float
    """Along the guide from the first panel to the last, m."""
    total_length: float
    """Of all branches of the centreline; that of the route when no branches are known, m."""
    num_panels: int
    max_clearance: float
    """Anywhere in the water, to the nearest wall or portal, m."""
    lowest: float
    """World z of the lowest water, m."""
    highest: float
    """World z of the highest water, m."""
    extent_east: float
    """From the westernmost to the easternmost water, m."""
    extent_north: float
    """From the southernmost to the northernmost water, m."""
    mean_section: float
    """Mean area of the true cross-sections, evenly spaced along the guide, m^2."""
    volume_per_metre: float
    """Volume over total length, m^2; below the mean section where branches run side by side in one wide passage."""
    rose: tuple[float, ...]
    """Horizontal metres of centreline per sector of ROSE_BIN_DEG, of bearings 0, 10, ... 170 degrees from north."""

    @property
    def vertical_range(self) -> float:
        """From the lowest to the highest water, m."""
        return self.highest - self.lowest


@dataclass(frozen=True)
class ScanFit:
    """How far the cavity lies from the scan it was made of."""

    median: float
    """Distance from the scan's points to the cavity, m."""
    percentile_95: float
    """m."""
    within_voxel: float
    """Share of the scan's points within one voxel."""


def measure_cave(cavity: Cavity, field: DistanceField, guide: Guide, branches: Sequence[Array] = ()) -> CaveStatistics:
    """Return the numbers of a cave.

    Args:
        cavity: the water.
        field: its clearance.
        guide: the route.
        branches: (C, 3) lines of the whole centreline graph, m; without them the route stands for the cave.
    """
    lines = branches or (guide.centreline,)
    total_length = float(sum(arc_lengths(line)[-1] for line in lines))
    low, high = cavity.mesh.vertices.min(axis=0), cavity.mesh.vertices.max(axis=0)
    return CaveStatistics(
        num_triangles=len(cavity.mesh.faces),
        volume=cavity.volume,
        wall_area=wall_area(cavity),
        observed_share=cavity.observed_share,
        genus=int(1 - cavity.mesh.to_trimesh().euler_number // 2),
        num_portals=len(cavity.portals),
        route_length=guide.length,
        total_length=total_length,
        num_panels=len(guide.panels),
        max_clearance=field.max_clearance,
        lowest=float(low[2]),
        highest=float(high[2]),
        extent_east=float(high[0] - low[0]),
        extent_north=float(high[1] - low[1]),
        mean_section=mean_section(cavity, guide.centreline),
        volume_per_metre=cavity.volume / total_length,
        rose=tuple(rose_of(lines).tolist()),
    )


def wall_area(cavity: Cavity) -> float:
    """Return the area of the rock around the water, portals not counted, m^2."""
    return float(cavity.mesh.areas[cavity.labels == WALL].sum())


def mean_section(cavity: Cavity, centreline: Array) -> float:
    """Return the mean area of evenly spaced true cross-sections of a (C, 3) line, m^2."""
    sections = cross_sections(cavity, centreline, float(arc_lengths(centreline)[-1]) / NUM_MEAN_SECTIONS)
    return float(np.mean([section.area for section in sections]))


def rose_of(lines: Sequence[Array]) -> Array:
    """Return the horizontal metres of (C, 3) lines by bearing, (180 / ROSE_BIN_DEG,) from north (y) over east (x).

    A passage has no direction of travel: bearings 180 degrees apart are the same. Each sector is centred on its
    bearing, so that a passage due north counts in one sector, not by chance in either of two.
    """
    legs = np.concatenate([np.diff(resample(line, ROSE_LEG), axis=0) for line in lines])
    bearings = np.degrees(np.arctan2(legs[:, 0], legs[:, 1]))
    sectors = np.floor(bearings / ROSE_BIN_DEG + 0.5).astype(int) % (180 // ROSE_BIN_DEG)
    rose: Array = np.bincount(sectors, np.hypot(legs[:, 0], legs[:, 1]), 180 // ROSE_BIN_DEG).astype(float)
    return rose


def measure_fit(cavity: Cavity, points: Array, voxel: float, closed: Mesh) -> ScanFit:
    """Return how well a cavity follows (N, 3) points of the scan; those of parts that were cut off do not count.

    Args:
        cavity: the water.
        points: (N, 3) of the scan, m.
        voxel: resolution of the scan, m.
        closed: the solid before its ends were cut. Where the nearest place on it is not the cavity's any more, a point
            belongs to what was cut off.

    Raises:
        MeshError: no point of the scan is left between the cuts.
    """
    import igl

    nearest = igl.point_mesh_squared_distance(points, closed.vertices, closed.faces)[2]
    kept = points[cavity.surface.distance(nearest) <= STILL_THERE * voxel]
    if len(kept) == 0:
        raise MeshError(
            f"None of the scan's {len(points)} points is left between the cuts, so that nothing tells how well the "
            "cave follows it. The triangles there are longer than what the cuts leave. Move the cuts apart."
        )
    distance = cavity.surface.distance(kept)
    return ScanFit(float(np.median(distance)), float(np.percentile(distance, 95)), float((distance <= voxel).mean()))
