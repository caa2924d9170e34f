"""The rock of a plan as a field over space: negative in water, near the wall about the distance to it, m."""

from __future__ import annotations

import numba
import numpy as np
from scipy.ndimage import gaussian_filter1d

from aquanav_tools.synthetic.noise import fractal, noise
from aquanav_tools.synthetic.styles.plan import NO_FLOOR, Block, Column, Passage, Plan
from aquanav_tools.types import Array

MARGIN = 0.75
"""Rock around the passages that is looked at, m."""
MAX_RELIEF = 0.45
"""Hollows of the wall are cut off at this times the size of the relief, m."""
NEAR = 0.3
"""A cross-section lays its floor this far into the rock, m; the cross-section nearest along the passage lays it."""
RELIEF_SIZE, MAX_SCALE = 1.2, 1.5
"""Half width at which relief has its full height, m; it grows with the root of the width, up to so many times."""
INWARDS = 0.2
"""Rock stands out into the water by up to this share of the half width."""
FINEST = 0.9
"""Cells of noise per sample: a wave takes two cells."""
LOOK = 2.5
"""Voxels around the wall that its surface is made from."""
DEEP = 1.0
"""Water this far from the wall needs no further cross-section, m, once the nearest one along the passage is known."""
FILLET = 0.25
"""Sediment meets rock in a fillet of this size, m."""
SPACING_SHARE = 0.35
"""Of the shortest half axis, between the stations that are carved."""
_UNLIMITED = 1e9
_CENTRE, _AHEAD, _SIDE, _UP, _W, _ABOVE, _BELOW, _ALONG = 0, 3, 6, 9, 12, 13, 14, 15
_P_ABOVE, _P_BELOW, _LEAN, _LEAN_RATE, _PHASE, _FLOOR, _CLIMB, _SCALE = 16, 17, 18, 19, 20, 21, 22, 23
_PASSAGE, _REACH = 24, 25
COLUMNS = 26
_FLOOR_LENGTH = 0.6
"""Length over which floors are smoothed, m: sediment fills what is uneven below it."""


def station_table(passages: tuple[Passage, ...]) -> Array:
    """Return the (N, COLUMNS) table of all stations that are carved, as `fill_block` reads it."""
    tables = [_stations(passage) for passage in passages]
    for number, table in enumerate(tables):
        table[:, _PASSAGE] = number
    return np.concatenate(tables)


def _stations(passage: Passage) -> Array:
    """Return the rows of one passage; neighbouring cross-sections overlap, so that their union is smooth."""
    axis = passage.axis
    ahead = np.gradient(axis, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.stack([-np.sin(passage.heading), np.cos(passage.heading), np.zeros(len(axis))], axis=1)
    side -= (side * ahead).sum(axis=1, keepdims=True) * ahead
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    step = float(np.linalg.norm(axis[1] - axis[0]))
    smallest = np.minimum(passage.half_width, np.minimum(passage.above, passage.below))
    table = np.zeros((len(axis), COLUMNS))
    table[:, _CENTRE : _CENTRE + 3], table[:, _AHEAD : _AHEAD + 3] = axis, ahead
    table[:, _SIDE : _SIDE + 3], table[:, _UP : _UP + 3] = side, np.cross(ahead, side)
    table[:, _W], table[:, _ABOVE], table[:, _BELOW] = passage.half_width, passage.above, passage.below
    table[:, _ALONG] = np.maximum(0.8 * smallest, 2.5 * step)
    table[:, _P_ABOVE], table[:, _P_BELOW] = passage.exponent_above, passage.exponent_below
    lean = np.zeros(len(axis)) if passage.lean is None else passage.lean
    table[:, _LEAN], table[:, _LEAN_RATE] = lean, 2.0 * np.pi / passage.lean_length
    table[:, _PHASE] = 0.6 * np.arange(len(axis)) * step / passage.lean_length
    table[:, _FLOOR] = NO_FLOOR
    if passage.floor is not None:
        table[:, _FLOOR] = gaussian_filter1d(axis[:, 2] - passage.floor, _FLOOR_LENGTH / step, mode="nearest")
        table[:, _CLIMB] = np.gradient(table[:, _FLOOR], step)
    table[:, _SCALE] = np.minimum(np.sqrt(smallest / RELIEF_SIZE), MAX_SCALE)
    highest = np.maximum(passage.above, passage.below)
    table[:, _REACH] = np.maximum(np.hypot(passage.half_width + np.abs(lean), highest), table[:, _ALONG]) + MARGIN
    every = max(1, int(SPACING_SHARE * smallest.min() / step))
    return table[::every]


def block_table(blocks: tuple[Block, ...], faces: int) -> Array:
    """Return the (B, 4 + 4 * faces) table of blocks: centre, radius, then normal and distance of each face."""
    table = np.zeros((len(blocks), 4 + 4 * faces))
    for row, block in zip(table, blocks, strict=True):
        row[:3], row[3] = block.centre, block.radius
        row[4:] = np.column_stack([block.normals, block.distances]).ravel()
    return table


def column_table(columns: tuple[Column, ...]) -> Array:
    """Return the (K, 6) table of columns: foot, height, radius, flare."""
    return np.array([[*c.foot, c.height, c.radius, c.flare] for c in columns]).reshape(-1, 6)


def relief_table(plan: Plan) -> Array:
    """Return the relief of a plan as the (11,) numbers that `fill_block` reads."""
    r = plan.relief
    return np.array(
        [r.swell, r.ledges, r.bed, r.scallops, r.scallop_length, r.joints, r.grain, r.floor, *r.dip, plan.extent]
    )


@numba.njit(cache=True)
def fill_block(low, voxel, stations, members, blocks, columns, relief, seed, rooms):  # type: ignore[no-untyped-def]
    """Write the field of one cubic block of samples.

    Args:
        low: (3,) position of its first sample, m.
        voxel: distance between samples, m.
        stations: (N, COLUMNS) of the plan.
        members: rows of the stations whose reach comes near the block.
        blocks: of `block_table`, near the block.
        columns: of `column_table`.
        relief: of `relief_table`.
        seed: picks the noise.
        rooms: (5, S, S, S); the first is written: the field. The others are room for the height of the floor, that
            of one passage, the distance along it to the cross-section that laid it, and the size of the relief.
    """
    field, floor, own, along, scale = rooms[0], rooms[1], rooms[2], rooms[3], rooms[4]
    field[:] = MARGIN
    floor[:] = _UNLIMITED
    own[:] = _UNLIMITED
    along[:] = _UNLIMITED
    scale[:] = 1.0
    passage = -1.0
    for m in members:
        if stations[m, _PASSAGE] != passage:
            _join_floors(floor, own, along)
            passage = stations[m, _PASSAGE]
        _carve(low, voxel, stations[m], field, own, along, scale)
    _join_floors(floor, own, along)
    _roughen(low, voxel, relief, seed, field, floor, scale)
    for b in range(len(blocks)):
        _leave_block(low, voxel, blocks[b], relief, seed, field)
    for c in range(len(columns)):
        _leave_column(low, voxel, columns[c], seed, field)


@numba.njit(cache=True)
def _join_floors(floor, own, along):  # type: ignore[no-untyped-def]
    """Lower the floor to that of one passage where the passage is, and make ready for the next passage."""
    for i in range(floor.shape[0]):
        for j in range(floor.shape[1]):
            for k in range(floor.shape[2]):
                if own[i, j, k] < floor[i, j, k]:
                    floor[i, j, k] = own[i, j, k]
                own[i, j, k] = _UNLIMITED
                along[i, j, k] = _UNLIMITED


@numba.njit(cache=True)
def _range(low, voxel, middle, reach, size):  # type: ignore[no-untyped-def]
    first = max(0, int(np.ceil((middle - reach - low) / voxel)))
    last = min(size, int(np.floor((middle + reach - low) / voxel)) + 1)
    return first, last


@numba.njit(cache=True)
def _carve(low, voxel, st, field, floor, along, scale):  # type: ignore[no-untyped-def]
    """Unite the field with one station's cross-section, thick along the passage; `floor` is of this passage alone."""
    size = field.shape[0]
    # Farther out, neither relief nor the surface looks.
    margin = min(MAX_RELIEF * st[_SCALE] + LOOK * voxel, MARGIN)
    # The box around the section: its half axes, projected.
    tall = max(st[_ABOVE], st[_BELOW])
    wide = st[_W] + abs(st[_LEAN])
    reach = np.empty(3)
    for axis in range(3):
        reach[axis] = margin + (
            abs(st[_AHEAD + axis]) * st[_ALONG] + abs(st[_SIDE + axis]) * wide + abs(st[_UP + axis]) * tall
        )
    i0, i1 = _range(low[0], voxel, st[0], reach[0], size)
    j0, j1 = _range(low[1], voxel, st[1], reach[1], size)
    k0, k1 = _range(low[2], voxel, st[2], reach[2], size)
    for i in range(i0, i1):
        dx = low[0] + i * voxel - st[0]
        for j in range(j0, j1):
            dy = low[1] + j * voxel - st[1]
            for k in range(k0, k1):
                dz = low[2] + k * voxel - st[2]
                ahead = dx * st[_AHEAD] + dy * st[_AHEAD + 1] + dz * st[_AHEAD + 2]
                if field[i, j, k] < -DEEP and abs(ahead) >= along[i, j, k]:
                    continue
                if abs(ahead) > st[_ALONG] + margin:
                    continue
                up = dx * st[_UP] + dy * st[_UP + 1] + dz * st[_UP + 2]
                if up > st[_ABOVE] + margin or -up > st[_BELOW] + margin:
                    continue
                aside = dx * st[_SIDE] + dy * st[_SIDE + 1] + dz * st[_SIDE + 2]
                if abs(aside) > wide + margin:
                    continue
                away = _section(st, ahead, aside, up)
                if away < NEAR and abs(ahead) < along[i, j, k]:
                    along[i, j, k] = abs(ahead)
                    floor[i, j, k] = st[_FLOOR] + ahead * st[_CLIMB]
                if away < field[i, j, k]:
                    field[i, j, k] = away
                    scale[i, j, k] = st[_SCALE]


@numba.njit(cache=True)
def _section(st, ahead, u, v):  # type: ignore[no-untyped-def]
    """Return the distance to one station's body to first order, m: its implicit function over its gradient."""
    a = abs(ahead) / st[_ALONG]
    if st[_LEAN] != 0.0:
        u -= st[_LEAN] * np.sin(st[_LEAN_RATE] * v + st[_PHASE])
    half, power = (st[_ABOVE], st[_P_ABOVE]) if v > 0.0 else (st[_BELOW], st[_P_BELOW])
    u, v = abs(u) / st[_W], abs(v) / half
    if power == 2.0:
        across = np.sqrt(u * u + v * v)
        du, dv = u, v
    else:
        larger = max(u, v)
        across, du, dv = 0.0, 0.0, 0.0
        if larger > 1e-9:
            share = (min(u, v) / larger) ** power
            across = larger * (1.0 + share) ** (1.0 / power)
            most = across * across / (larger * (1.0 + share))
            least = most * share * larger / max(min(u, v), 1e-9)
            du, dv = (most, least) if u >= v else (least, most)
    q = np.sqrt(a * a + across * across)
    slope = np.sqrt((a / st[_ALONG]) ** 2 + (du / st[_W]) ** 2 + (dv / half) ** 2)
    if slope < 1e-9:
        return -min(st[_W], half)
    return (q - 1.0) * q / slope


@numba.njit(cache=True)
def _roughen(low, voxel, relief, seed, field, floor, scale):  # type: ignore[no-untyped-def]
    """Add the relief of the wall, and lay the floor."""
    size = field.shape[0]
    # Farther off than the relief is high, and than the surface looks, there is nothing to add.
    highest = min(4.0 * relief[0] + relief[1] + 0.6 * relief[3] + 1.5 * relief[5] + 2.2 * relief[6], MAX_RELIEF)
    near = LOOK * voxel
    for i in range(size):
        x = low[0] + i * voxel
        for j in range(size):
            y = low[1] + j * voxel
            for k in range(size):
                if field[i, j, k] >= MARGIN:
                    continue
                z = low[2] + k * voxel
                wall = field[i, j, k]
                if abs(wall) < scale[i, j, k] * highest + near:
                    out = scale[i, j, k] * _wall_relief(x, y, z, relief, FINEST / voxel, seed)
                    # The scale is the root of the half width over RELIEF_SIZE.
                    inwards = INWARDS * RELIEF_SIZE * scale[i, j, k] ** 2
                    wall += min(max(out, -MAX_RELIEF * scale[i, j, k]), inwards)
                ground = floor[i, j, k] - z if floor[i, j, k] < _UNLIMITED else NO_FLOOR
                if ground > -(relief[7] * 1.75 + FILLET + near) and wall < near:
                    if ground < relief[7] * 1.75 + FILLET + near:
                        ground += relief[7] * scale[i, j, k] * _floor_relief(x, y, FINEST / voxel, seed)
                    blend = max(FILLET - abs(wall - ground), 0.0) / FILLET
                    wall = max(wall, ground) + 0.06 * blend * blend
                field[i, j, k] = wall


@numba.njit(cache=True)
def _wall_relief(x, y, z, relief, finest, seed):  # type: ignore[no-untyped-def]
    """Return by how much rock stands out, m; about zero on average."""
    out = relief[0] * 1.75 * fractal(x, y, z, 0.225, 6, 0.57, finest, seed)
    if relief[1] > 0.0:
        height = (z + relief[8] * x + relief[9] * y) / relief[2] + 0.35 * noise(0.3 * x, 0.3 * y, 0.3 * z, seed + 11)
        bed = np.floor(height)
        part = height - bed
        # Each bed stands out by a number of its own; the next begins over a fifth of its thickness.
        here = noise(0.12 * x, 0.12 * y, 7.31 * bed, seed + 12)
        there = noise(0.12 * x, 0.12 * y, 7.31 * (bed + 1.0), seed + 12)
        share = min(max((part - 0.8) / 0.2, 0.0), 1.0)
        out += relief[1] * (here + (there - here) * share)
    if relief[3] > 0.0 and relief[4] > 2.0 / finest:
        rate = 1.0 / relief[4]
        crest = 1.0 - abs(noise(rate * x, rate * y, rate * z, seed + 21)) * 1.6
        out += relief[3] * (crest * crest - 0.4)
    if relief[5] > 0.0:
        out += relief[5] * _broken(0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x, z, seed + 31)
    return out + relief[6] * fractal(x, y, z, 1.6, 3, 0.7, finest, seed + 20)


@numba.njit(cache=True)
def _floor_relief(x, y, finest, seed):  # type: ignore[no-untyped-def]
    """Return how high sediment lies, relative to its relief."""
    return fractal(0.8 * x + 0.5 * y, 0.8 * y - 0.5 * x, 0.3 * x, 0.5, 3, 0.5, finest, seed + 40)


@numba.njit(cache=True)
def _broken(x, y, z, seed):  # type: ignore[no-untyped-def]
    """Return the relief of rock that breaks along cracks: flat facets, the highest of three directions each."""
    shift = noise(0.5 * x, 0.5 * y, 0.5 * z, seed + 3)
    one = _steps(0.9 * x + 0.6 * shift, seed) + 0.5 * noise(0.7 * y, 0.7 * z, 0.2 * x, seed + 4)
    other = _steps(0.9 * y + 0.6 * shift, seed + 1) + 0.5 * noise(0.7 * x, 0.7 * z, 0.2 * y, seed + 5)
    return max(one, other, _steps(1.3 * z + 0.4 * shift, seed + 2)) - 0.45


@numba.njit(cache=True)
def _steps(t, seed):  # type: ignore[no-untyped-def]
    """Return a slanting step function of one coordinate in [-1, 1]."""
    cell = np.floor(t)
    level = noise(cell + 0.5, 0.5, 0.5, seed)
    return level + 0.4 * (t - cell - 0.5)


@numba.njit(cache=True)
def _leave_block(low, voxel, block, relief, seed, field):  # type: ignore[no-untyped-def]
    """Leave the rock of one fallen block in the water."""
    size = field.shape[0]
    i0, i1 = _range(low[0], voxel, block[0], block[3], size)
    j0, j1 = _range(low[1], voxel, block[1], block[3], size)
    k0, k1 = _range(low[2], voxel, block[2], block[3], size)
    for i in range(i0, i1):
        x = low[0] + i * voxel
        for j in range(j0, j1):
            y = low[1] + j * voxel
            for k in range(k0, k1):
                z = low[2] + k * voxel
                rock = -1e9
                for f in range((len(block) - 4) // 4):
                    n = 4 + 4 * f
                    out = (x - block[0]) * block[n] + (y - block[1]) * block[n + 1] + (z - block[2]) * block[n + 2]
                    rock = max(rock, out - block[n + 3])
                if rock < 0.3:
                    rock -= 0.05 * fractal(x, y, z, 1.3, 2, 0.5, FINEST / voxel, seed + 60)
                field[i, j, k] = max(field[i, j, k], -rock)


@numba.njit(cache=True)
def _leave_column(low, voxel, column, seed, field):  # type: ignore[no-untyped-def]
    """Leave the rock of one column in the water."""
    size = field.shape[0]
    widest = column[4] * (1.0 + column[5]) + 0.6
    i0, i1 = _range(low[0], voxel, column[0], widest, size)
    j0, j1 = _range(low[1], voxel, column[1], widest, size)
    k0, k1 = _range(low[2], voxel, column[2] + 0.5 * column[3], 0.5 * column[3], size)
    for i in range(i0, i1):
        x = low[0] + i * voxel
        for j in range(j0, j1):
            y = low[1] + j * voxel
            away = np.sqrt((x - column[0]) ** 2 + (y - column[1]) ** 2)
            for k in range(k0, k1):
                z = low[2] + k * voxel
                share = 2.0 * (z - column[2]) / column[3] - 1.0
                radius = column[4] * (1.0 + column[5] * share * share)
                rough = 0.35 * column[4] * fractal(x, y, z, 0.9, 3, 0.5, FINEST / voxel, seed + 70)
                field[i, j, k] = max(field[i, j, k], radius + rough - away)
