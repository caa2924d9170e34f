"""From fluxes through faces to velocities at the cells' middles, in the water and as far into the rock as one samples.

In the open a cell's velocity is the mean of its opposite faces. Beside and behind a wall a linear, divergence-free
velocity is fitted to the faces around and to the walls' planes, along which water must flow: interpolated, it follows
the wall, where zeros in the rock would stop it there and copies of the water's velocity would run it into the wall.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.water.flow_cells import FlowCells
from aquanav_tools.cave.water.potential import PotentialFlow, cell_number
from aquanav_tools.geometry.volume.field import BRICK
from aquanav_tools.types import Array, BoolArray

REACH = 2
"""A fit sees this many cells to each side."""
WALL_WEIGHT = 2.0
"""Of a wall's plane against a face's flux in the fit."""
FALL_OFF = 1.2
"""Weights fall to exp(-1) at this distance, in cells."""
RIDGE = 1e-3
"""Holds the gradient of a fit that has too few faces."""
NUM_UNKNOWNS = 11
"""Velocity (3,) and its gradient (8,), the ninth following from zero divergence."""


def cell_velocities(flow: PotentialFlow, cells: FlowCells, cavity: Cavity, through: frozenset[int]) -> Array:
    """Return the (B, BRICK, BRICK, BRICK, 3) velocity at the middle of every cell, m/s; 0 far from the flow.

    Args:
        flow: what flows through the faces.
        cells: it flows through.
        cavity: its wall bounds them.
        through: labels of the portals that are no wall to this flow.
    """
    shape = cells.openness.shape
    speeds, openness = np.zeros((shape[0] * BRICK**3, 3)), np.zeros((shape[0] * BRICK**3, 3))
    axis, upper = flow.faces.axis, flow.faces.upper
    speeds[upper, axis] = flow.flux / (flow.faces.openness * cells.spacing**2)
    openness[upper, axis] = flow.faces.openness
    is_reached = np.zeros(len(speeds), dtype=np.bool_)
    is_reached[flow.cells] = True
    velocities = np.zeros((len(speeds), 3))
    kind = np.zeros(len(speeds), dtype=np.int8)
    _average_open(is_reached, speeds, openness, cells.bricks, cells.places, velocities, kind)
    fitted = np.flatnonzero(kind == 1)
    walls = _nearest_walls(cells.centres(fitted), cavity, through)
    row = np.full(len(speeds), -1, dtype=np.int32)
    row[fitted] = np.arange(len(fitted), dtype=np.int32)
    _fit(fitted, row, walls, speeds, openness, cells.origin, cells.spacing, cells.bricks, cells.places, velocities)
    return velocities.reshape(shape)


def _nearest_walls(points: Array, cavity: Cavity, through: frozenset[int]) -> Array:
    """Return the (N, 6) nearest points on the wall and unit normals there (either way), m."""
    import igl

    is_wall: BoolArray = ~np.isin(cavity.labels, list(through))
    faces = cavity.mesh.faces[is_wall]
    squares, indices, nearest = igl.point_mesh_squared_distance(points, cavity.mesh.vertices, faces)[:3]
    away = points - nearest
    length = np.sqrt(np.maximum(squares, 0.0))[:, None]
    # On the wall itself the direction to it is the face's own.
    normals = np.where(length > 1e-6, away / np.maximum(length, 1e-12), cavity.mesh.normals[is_wall][indices])
    walls: Array = np.concatenate([nearest, normals], axis=1)
    return walls


@numba.njit(cache=True)
def _average_open(is_reached, speeds, openness, bricks, places, velocities, kind):  # type: ignore[no-untyped-def]
    """Fill in the cells whose six faces are open; set kind to 1 for those to fit: cut ones and their neighbours."""
    for number in np.flatnonzero(is_reached):
        x, y, z = cell_indices(number, places)
        is_open = True
        for axis in range(3):
            after = cell_number(bricks, x + (axis == 0), y + (axis == 1), z + (axis == 2))
            if after < 0 or openness[number, axis] < 1.0 or openness[after, axis] < 1.0:
                is_open = False
                break
            velocities[number, axis] = 0.5 * (speeds[number, axis] + speeds[after, axis])
        if is_open:
            continue
        for dx in range(-1, 2):
            for dy in range(-1, 2):
                for dz in range(-1, 2):
                    near = cell_number(bricks, x + dx, y + dy, z + dz)
                    if near >= 0 and (near == number or not is_reached[near]):
                        kind[near] = 1


@numba.njit(cache=True)
def cell_indices(number, places):  # type: ignore[no-untyped-def]
    """Return the indices of a cell in the grid by its number."""
    brick, local = number // BRICK**3, number % BRICK**3
    x, y, z = local // BRICK**2, (local // BRICK) % BRICK, local % BRICK
    return BRICK * places[brick, 0] + x, BRICK * places[brick, 1] + y, BRICK * places[brick, 2] + z


@numba.njit(cache=True, parallel=True)
def _fit(fitted, row, walls, speeds, openness, origin, spacing, bricks, places, velocities):  # type: ignore[no-untyped-def]
    """Fill in the velocity of the cells to fit."""
    weights = _face_weights()
    for n in numba.prange(len(fitted)):
        _fit_cell(fitted[n], weights, row, walls, speeds, openness, origin, spacing, bricks, places, velocities)


@numba.njit(cache=True)
def _fit_cell(number, weights, row, walls, speeds, openness, origin, spacing, bricks, places, velocities):  # type: ignore[no-untyped-def]
    """Fill in the velocity of one cell."""
    normal, right = np.zeros((NUM_UNKNOWNS, NUM_UNKNOWNS)), np.zeros(NUM_UNKNOWNS)
    line, fastest = np.empty(NUM_UNKNOWNS), np.zeros(3)
    x, y, z = cell_indices(number, places)
    for dx in range(-REACH, REACH + 1):
        for dy in range(-REACH, REACH + 1):
            for dz in range(-REACH, REACH + 1):
                near = cell_number(bricks, x + dx, y + dy, z + dz)
                if near < 0:
                    continue
                for axis in range(3):
                    if openness[near, axis] > 0.0:
                        px = dx - 0.5 * (axis == 0)
                        py = dy - 0.5 * (axis == 1)
                        pz = dz - 0.5 * (axis == 2)
                        weight = openness[near, axis] ** 3 * weights[dx + REACH, dy + REACH, dz + REACH, axis]
                        speed = speeds[near, axis]
                        fastest[axis] = max(fastest[axis], abs(speed))
                        _set_line(line, px, py, pz, axis == 0, axis == 1, axis == 2)
                        _add(normal, right, line, speed, weight)
                if row[near] >= 0:
                    wall = walls[row[near]]
                    px = (wall[0] - origin[0]) / spacing - x - 0.5
                    py = (wall[1] - origin[1]) / spacing - y - 0.5
                    pz = (wall[2] - origin[2]) / spacing - z - 0.5
                    weight = WALL_WEIGHT * _weight(px, py, pz)
                    _set_line(line, px, py, pz, wall[3], wall[4], wall[5])
                    _add(normal, right, line, 0.0, weight)
    limit = np.sqrt((fastest * fastest).sum())
    if limit > 0.0:
        _solve_into(normal, right, velocities[number])
        size = np.sqrt((velocities[number] ** 2).sum())
        if size > limit:  # a fit to few faces may overshoot
            velocities[number] *= limit / size


@numba.njit(cache=True)
def _face_weights():  # type: ignore[no-untyped-def]
    """Return the weights of the faces around a cell, by its offset to their cell and their axis."""
    count = 2 * REACH + 1
    weights = np.empty((count, count, count, 3))
    for dx, dy, dz, axis in np.ndindex(weights.shape):
        x, y, z = dx - REACH - 0.5 * (axis == 0), dy - REACH - 0.5 * (axis == 1), dz - REACH - 0.5 * (axis == 2)
        weights[dx, dy, dz, axis] = _weight(x, y, z)
    return weights


@numba.njit(cache=True)
def _weight(x, y, z):  # type: ignore[no-untyped-def]
    return np.exp(-(x * x + y * y + z * z) / FALL_OFF**2)


@numba.njit(cache=True)
def _set_line(line, x, y, z, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Write how the velocity along (nx, ny, nz) at an offset (cells) depends on the unknowns."""
    line[0], line[1], line[2] = nx, ny, nz
    line[3], line[4], line[5] = nx * x - nz * z, nx * y, nx * z
    line[6], line[7], line[8] = ny * x, ny * y - nz * z, ny * z
    line[9], line[10] = nz * x, nz * y


@numba.njit(cache=True)
def _add(normal, right, line, value, weight):  # type: ignore[no-untyped-def]
    for m in range(NUM_UNKNOWNS):
        if line[m] == 0.0:  # as seven in eleven of a face's are
            continue
        scaled = weight * line[m]
        right[m] += scaled * value
        for n in range(m + 1):
            normal[m, n] += scaled * line[n]


@numba.njit(cache=True)
def _solve_into(normal, right, velocity):  # type: ignore[no-untyped-def]
    """Solve the normal equations by Cholesky's method and write the velocity."""
    size = NUM_UNKNOWNS
    for m in range(size):
        normal[m, m] += 1e-9 if m < 3 else RIDGE
    for m in range(size):
        for n in range(m + 1):
            total = normal[m, n]
            for k in range(n):
                total -= normal[m, k] * normal[n, k]
            normal[m, n] = np.sqrt(max(total, 1e-15)) if m == n else total / normal[n, n]
    for m in range(size):
        for n in range(m):
            right[m] -= normal[m, n] * right[n]
        right[m] /= normal[m, m]
    for m in range(size - 1, -1, -1):
        for n in range(m + 1, size):
            right[m] -= normal[n, m] * right[n]
        right[m] /= normal[m, m]
    for axis in range(3):
        velocity[axis] = right[axis]
