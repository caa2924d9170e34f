"""How fine a scan is resampled, and what that costs: decided, and said, before the work starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.scan.orientation import face_areas
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.types import Array, Mesh, PointCloud

VOXELS_PER_RADIUS = 4.0
"""A quarter of the vehicle's radius resolves any place it can pass; finer is never needed."""
MESH_VOXELS_PER_RADIUS = 2.0
"""Large triangles do not mean low detail: a mesh is never resampled coarser than half the radius for them."""
VOXELS_OF_NOISE = 4.0
"""A voxel is four times the typical noise, so that half of the points can lie within a quarter voxel of the wall ..."""
NOISE_VOXELS_PER_RADIUS = 1.0
"""... but never larger than the vehicle's radius."""
MIN_MESH_NOISE = 0.2
"""Unevenness of a mesh below this share of its edges is the relief of the wall: decimation leaves no noise."""
MAX_RADII = 8.0
"""A cave so large that the memory only lets it be closed at more radii of the vehicle is refused; chosen: at 4 GB and
0.17 m, two square kilometres of wall."""
NUM_NOISE_SAMPLES = 5_000
NUM_MESH_NEIGHBOURS = 16
NUM_CLOUD_NEIGHBOURS = 48
"""Points that a plane is laid through; the nearest few of a dense cloud lie within its noise and tell nothing."""
SPACINGS_PER_VOXEL = 2.0
"""A voxel of a cloud holds about four points of its wall."""
BASE_GB = 0.4
"""The libraries and the scan itself."""
BYTES_PER_CELL = 3600
"""Peak memory of closing and proving per voxel of wall; measured, see eval/benchmarks/cavity.py."""


@dataclass(frozen=True)
class Resolution:
    """The voxel and its cost."""

    voxel: float
    """m."""
    reason: str
    """What decided it."""
    memory_gb: float
    """Forecast of the peak while closing, GB."""
    noise: float
    """Typical distance of the scan's points from the plane through their neighbours, m; of a coarse mesh its relief."""


def choose_resolution(
    scan: Mesh | PointCloud, vehicle_radius: float, budget_gb: float, wanted: float | None = None
) -> Resolution:
    """Return the voxel for a scan.

    The median edge of a mesh or twice the median spacing of a cloud, or four times the noise where that is more;
    within what the vehicle needs and what fits into the memory budget.

    Args:
        scan: world frame, m.
        vehicle_radius: m.
        budget_gb: memory that closing may take, GB.
        wanted: the user's own choice, m.

    Raises:
        InputError: the scan has no extent.
        ResourceError: the user's choice does not fit into the budget, or what fits is far too coarse.
    """
    area = _wall_area(scan, vehicle_radius)
    smallest = float(np.sqrt(area * BYTES_PER_CELL / max((budget_gb - BASE_GB) * 1e9, 1.0)))
    unevenness = _noise(scan)
    if wanted is not None:
        if wanted < smallest:
            raise ResourceError(
                f"Closing {area:.0f} m2 of wall at {wanted:.3g} m takes about {_memory(area, wanted):.1f} GB, more "
                f"than the {budget_gb:.1f} GB allowed. Give --voxel {1.01 * smallest:.2g} or more, or more --memory."
            )
        return Resolution(wanted, "as given", _memory(area, wanted), unevenness)
    finest = vehicle_radius / VOXELS_PER_RADIUS
    edge = float(np.median(_edge_lengths(scan))) if isinstance(scan, Mesh) else 0.0
    if isinstance(scan, Mesh):
        coarsest = vehicle_radius / MESH_VOXELS_PER_RADIUS
        detail, reason = min(
            (edge, "the median edge of the surface"),
            (coarsest, f"half of the vehicle's radius; the surface's median edge is {1000.0 * edge:.0f} mm"),
        )
    else:
        detail, reason = SPACINGS_PER_VOXEL * _spacing(scan.points), "twice the spacing of the points"
    noise = min(VOXELS_OF_NOISE * unevenness, vehicle_radius / NOISE_VOXELS_PER_RADIUS)
    is_relief = isinstance(scan, Mesh) and unevenness < MIN_MESH_NOISE * edge
    if detail < noise and not is_relief:
        detail, reason = noise, "the noise of the surface"
    if detail < finest:
        detail, reason = finest, "a quarter of the vehicle's radius"
    if detail < smallest:
        detail, reason = smallest, f"the memory limit of {budget_gb:.1f} GB"
    if detail > MAX_RADII * vehicle_radius:
        raise ResourceError(
            f"The scan has {area:,.0f} m2 of wall. Within {budget_gb:.1f} GB it can be closed at {detail:.2g} m, "
            f"{detail / vehicle_radius:.0f} times the vehicle's radius: passages it fits through would be lost. Check "
            "--unit, give more --memory, or build the cave in parts."
        )
    return Resolution(detail, reason, _memory(area, detail), unevenness)


def _memory(area: float, voxel: float) -> float:
    return BASE_GB + area / voxel**2 * BYTES_PER_CELL / 1e9


def _wall_area(scan: Mesh | PointCloud, cell: float) -> float:
    """Return about the area of the scanned wall, m^2; of a cloud, of the cells it occupies."""
    points = scan.vertices if isinstance(scan, Mesh) else scan.points
    if not np.ptp(points, axis=0).max() > 0.0:
        raise InputError(
            f"All {len(points)} points of the scan lie in one place. The export went wrong, or the unit is wrong; "
            "check the file and --unit."
        )
    if isinstance(scan, Mesh):
        return float(face_areas(scan)[0].sum())
    # A wall through a grid of cells occupies about 1.5 cells per cell of area.
    return len(np.unique(np.floor(points / cell).astype(np.int64), axis=0)) * cell**2 / 1.5


def _edge_lengths(mesh: Mesh) -> Array:
    corners = mesh.triangles
    lengths: Array = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).ravel()
    return lengths


def _noise(scan: Mesh | PointCloud) -> float:
    """Return the median distance of points from the plane through their neighbours, m."""
    from scipy.spatial import cKDTree

    is_mesh = isinstance(scan, Mesh)
    points = _distinct(scan.vertices) if isinstance(scan, Mesh) else scan.points
    num_neighbours = NUM_MESH_NEIGHBOURS if is_mesh else NUM_CLOUD_NEIGHBOURS
    if len(points) <= num_neighbours:
        return 0.0
    asked = points[:: max(1, len(points) // NUM_NOISE_SAMPLES)]
    _, neighbours = cKDTree(points).query(asked, k=num_neighbours)
    around = points[neighbours[:, 1:]]
    middles = around.mean(axis=1)
    normals = np.linalg.svd(around - middles[:, None], full_matrices=False)[2][:, 2]
    return float(np.median(np.abs(np.einsum("nk,nk->n", asked - middles, normals))))


def _distinct(points: Array) -> Array:
    """Return (N, 3) points without repetitions, in ascending order."""
    ordered = points[np.lexsort(points.T[::-1])]
    distinct: Array = ordered[np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))]
    return distinct


def _spacing(points: Array) -> float:
    from scipy.spatial import cKDTree

    nearest, _ = cKDTree(points).query(points[:: max(1, len(points) // 20_000)], k=2)
    return float(np.median(nearest[:, 1]))
