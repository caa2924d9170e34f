"""What there is to say about a cave in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.field import DistanceField
from aquanav_tools.cave.guide import Guide
from aquanav_tools.types import Array, Mesh


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
    num_panels: int
    min_clearance: float
    """At the narrowest place of the guide, m."""
    mean_clearance: float
    """Along the guide, m."""
    max_clearance: float
    """Anywhere in the water, m."""


@dataclass(frozen=True)
class ScanFit:
    """How far the cavity lies from the scan it was made of."""

    median: float
    """Distance from the scan's points to the cavity, m."""
    percentile_95: float
    """m."""
    within_voxel: float
    """Share of the scan's points within one voxel."""


def measure_cave(cavity: Cavity, field: DistanceField, guide: Guide) -> CaveStatistics:
    """Return the numbers of a cave."""
    corners = cavity.mesh.triangles
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    clearance = field.clearance(guide.centreline)
    return CaveStatistics(
        num_triangles=len(cavity.mesh.faces),
        volume=cavity.volume,
        wall_area=float(areas[cavity.labels == WALL].sum()),
        observed_share=cavity.observed_share,
        genus=int(1 - cavity.mesh.to_trimesh().euler_number // 2),
        num_portals=len(cavity.portals),
        route_length=guide.length,
        num_panels=len(guide.panels),
        min_clearance=float(clearance.min()),
        mean_clearance=float(clearance.mean()),
        max_clearance=float(field.values.max()),
    )


def measure_fit(cavity: Cavity, points: Array, voxel: float) -> ScanFit:
    """Return how well the cavity follows (N, 3) points of the scan; those cut off behind portals do not count."""
    import igl

    inside_lids = np.ones(len(points), dtype=bool)
    for portal in cavity.portals:
        offsets = points - portal.centre
        behind = offsets @ portal.normal > 0.0
        inside_lids &= ~(behind & (np.linalg.norm(offsets, axis=1) < 3.0 * np.sqrt(portal.area)))
    kept = points[inside_lids]
    mesh: Mesh = cavity.mesh
    distance = np.sqrt(igl.point_mesh_squared_distance(kept, mesh.vertices, mesh.faces)[0])
    return ScanFit(float(np.median(distance)), float(np.percentile(distance, 95)), float((distance <= voxel).mean()))
