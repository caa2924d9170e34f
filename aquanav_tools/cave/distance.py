"""Computing the distance field of a cavity: exact in the water and near the walls."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.surface import sample_faces
from aquanav_tools.cave.field import DistanceField
from aquanav_tools.types import Array, BoolArray

BAND = 3
"""Samples of rock behind the walls that have their exact distance; deeper ones repeat the last, -BAND * spacing."""
MAX_SAMPLES = 6_000_000
CHUNK = 500_000


def choose_spacing(cavity: Cavity, vehicle_radius: float) -> float:
    """Return the field's spacing, m: a third of the vehicle's radius, larger where MAX_SAMPLES would not suffice."""
    extent = np.ptp(cavity.mesh.vertices, axis=0)
    return max(vehicle_radius / 3.0, float(np.cbrt(np.prod(extent) / MAX_SAMPLES)))


def distance_field(cavity: Cavity, spacing: float) -> DistanceField:
    """Return the clearance on a grid around the cavity.

    Distances are exact (to float32) at every sample in the water and up to BAND samples behind the walls.
    """
    import igl

    vertices, faces = cavity.mesh.vertices, cavity.mesh.faces
    origin = vertices.min(axis=0) - (BAND + 1) * spacing
    nx, ny, nz = np.ceil((vertices.max(axis=0) - origin) / spacing).astype(int) + BAND + 2
    near, deep = _split_by_walls(cavity, origin, (int(nx), int(ny), int(nz)), spacing)
    clearance = np.full((nx, ny, nz), -BAND * spacing, dtype=np.float32)
    exact = np.argwhere(near | deep)
    for rows in np.array_split(exact, max(1, len(exact) // CHUNK)):
        points = origin + spacing * rows
        distance = np.sqrt(igl.point_mesh_squared_distance(points, vertices, faces)[0])
        is_water = deep[tuple(rows.T)]
        beside = ~is_water
        is_water[beside] = igl.fast_winding_number(vertices, faces, points[beside]) > 0.5
        clearance[tuple(rows.T)] = np.where(is_water, distance, np.maximum(-distance, -BAND * spacing))
    return DistanceField(origin, spacing, clearance)


def _split_by_walls(
    cavity: Cavity, origin: Array, shape: tuple[int, int, int], spacing: float
) -> tuple[BoolArray, BoolArray]:
    """Return the samples within BAND of a wall, and those deeper in the water."""
    import igl
    from scipy.ndimage import distance_transform_edt, label

    is_empty = np.ones(shape, dtype=bool)
    samples = sample_faces(cavity.mesh, spacing)
    is_empty[tuple(np.rint((samples - origin) / spacing).astype(int).T)] = False
    # A wall's sample is rounded by up to sqrt(3)/2 cells.
    near: BoolArray = distance_transform_edt(is_empty) <= BAND + 1
    regions, num_regions = label(~near)
    deep = np.zeros(shape, dtype=bool)
    for region in range(1, num_regions + 1):
        first = np.unravel_index(np.argmax(regions == region), shape)
        inside = igl.fast_winding_number(
            cavity.mesh.vertices, cavity.mesh.faces, (origin + spacing * np.array(first))[None]
        )
        if inside[0] > 0.5:
            deep |= regions == region
    return near, deep
