"""Cutting the water into cells for the flow: sparse bricks of cubes, and how far each of their faces is open.

A face that the wall cuts is open by the share of its area that is water, so that the wall is felt where it is and not
as a staircase. Behind a lid that water passes through, the passage goes on for a few cells, straight out, so that
there are faces to flow through.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.geometry.volume.field import BAND, BRICK, BRICK_BITS, ROCK, DistanceField, interpolate, number_bricks
from aquanav_tools.types import Array, IntArray

DUCT_CELLS = 2.5
"""Length of the passage that goes on behind a lid, in cells."""
FACE_SAMPLES = 4
"""Samples along the edge of a face that the wall may cut: its open share errs by about 1 %."""
MIN_OPEN = 0.01
"""Faces that are open by less count as closed: they carry no flow to speak of and make the equations stiff."""


@dataclass(frozen=True, eq=False)
class Lids:
    """The lids that water passes through, as arrays for compiled functions."""

    frames: Array
    """(L, 4, 3) centre, two axes in its plane, and the normal out of the water."""
    outlines: Array
    """(S, 4) segments of all outlines, (a, b) to (a, b) in the plane, m."""
    ends: IntArray
    """(L + 1,) the segments of lid n are outlines[ends[n]:ends[n + 1]]."""
    reach: Array
    """(L,) distance from the centre to the farthest point of the outline, m."""
    labels: tuple[int, ...]
    """Of the portals."""

    @property
    def arrays(self) -> tuple[Array, Array, IntArray, Array]:
        """What compiled functions read."""
        return self.frames, self.outlines, self.ends, self.reach


@dataclass(frozen=True, eq=False)
class FlowCells:
    """Cubes of water; cell [0, 0, 0] has its lowest corner at the origin."""

    origin: Array
    """(3,) m."""
    spacing: float
    """Edge of a cell, m."""
    bricks: npt.NDArray[np.int32]
    """(X, Y, Z) number of the brick of BRICK^3 cells in each place, ROCK where there is none."""
    places: IntArray
    """(B, 3) where each brick is; the first row stands for ROCK."""
    openness: npt.NDArray[np.float32]
    """(B, BRICK, BRICK, BRICK, 3) open share of the faces towards -x, -y and -z of each cell, in [0, 1]."""

    def centres(self, cells: IntArray) -> Array:
        """Return the (N, 3) centres of (N,) cells, numbered through all bricks in C order, m."""
        local = np.stack(np.unravel_index(cells % BRICK**3, (BRICK,) * 3), axis=1)
        centres: Array = self.origin + self.spacing * (BRICK * self.places[cells // BRICK**3] + local + 0.5)
        return centres


def find_lids(cavity: Cavity, labels: tuple[int, ...]) -> Lids:
    """Return the lids of some portals; each must be flat, as those of a build are."""
    frames, outlines, reach = [], [], []
    for label in labels:
        portal = next(portal for portal in cavity.portals if portal.label == label)
        faces = cavity.mesh.faces[cavity.labels == label]
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        single, counts = np.unique(edges, axis=0, return_counts=True)
        normal = portal.normal / np.linalg.norm(portal.normal)
        first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(normal, first)])
        middle = portal.centre
        flat = (cavity.mesh.vertices[single[counts == 1]] - middle) @ axes.T
        frames.append(np.stack([middle, *axes, normal]))
        outlines.append(flat.reshape(-1, 4))
        reach.append(np.linalg.norm(flat, axis=-1).max())
    ends = np.cumsum([0, *(len(outline) for outline in outlines)])
    segments = np.concatenate([np.zeros((0, 4)), *outlines])
    return Lids(np.array(frames).reshape(-1, 4, 3), segments, ends, np.array(reach, dtype=np.float64), labels)


def cut_cells(field: DistanceField, lids: Lids, spacing: float) -> FlowCells:
    """Return the cells of the water in a field, with passages of DUCT_CELLS behind the lids."""
    extent = field.spacing * (np.array(field.shape) - 1)
    ends = np.concatenate([field.origin[None], (field.origin + extent)[None], *_duct_boxes(lids, spacing)])
    origin = ends.min(axis=0) - 1.5 * spacing
    shape = np.ceil((ends.max(axis=0) + 1.5 * spacing - origin) / (BRICK * spacing)).astype(int)
    is_kept = np.zeros(tuple(shape), dtype=np.bool_)
    places = np.argwhere(field.bricks != ROCK)
    lows = field.origin + field.spacing * BRICK * places
    _mark(is_kept, (lows - origin) / spacing, BRICK * field.spacing / spacing)
    for low, high in _duct_boxes(lids, spacing):
        first = np.floor((low - origin) / (BRICK * spacing)).astype(int)
        last = np.floor((high - origin) / (BRICK * spacing)).astype(int) + 1
        is_kept[first[0] : last[0], first[1] : last[1], first[2] : last[2]] = True
    bricks = number_bricks(is_kept)
    brick_places = np.concatenate([np.zeros((1, 3), dtype=np.int64), np.argwhere(is_kept)])
    openness = np.zeros((len(brick_places), BRICK, BRICK, BRICK, 3), dtype=np.float32)
    _measure_faces(origin, spacing, brick_places, field.grid, lids.arrays, openness)
    return FlowCells(origin, spacing, bricks, brick_places, openness)


def _duct_boxes(lids: Lids, spacing: float) -> list[Array]:
    """Return the (2, 3) lowest and highest corner around each lid with the passage behind it, m."""
    boxes = []
    for (centre, first, second, normal), reach in zip(lids.frames, lids.reach, strict=True):
        aside = reach * np.sqrt(first**2 + second**2) + spacing
        tips = np.stack([centre, centre + (DUCT_CELLS + 1.0) * spacing * normal])
        boxes.append(np.stack([tips.min(axis=0) - aside, tips.max(axis=0) + aside]))
    return boxes


@numba.njit(cache=True)
def _mark(is_kept, lows, size):  # type: ignore[no-untyped-def]
    """Set the bricks that boxes with a lowest corner and an edge, in cells, reach into, one cell wider."""
    for low in lows:
        x0, y0, z0 = int(low[0] - 1.0) >> BRICK_BITS, int(low[1] - 1.0) >> BRICK_BITS, int(low[2] - 1.0) >> BRICK_BITS
        x1 = min(int(low[0] + size + 1.0) >> BRICK_BITS, is_kept.shape[0] - 1)
        y1 = min(int(low[1] + size + 1.0) >> BRICK_BITS, is_kept.shape[1] - 1)
        z1 = min(int(low[2] + size + 1.0) >> BRICK_BITS, is_kept.shape[2] - 1)
        is_kept[max(x0, 0) : x1 + 1, max(y0, 0) : y1 + 1, max(z0, 0) : z1 + 1] = True


@numba.njit(cache=True, parallel=True)
def _measure_faces(origin, spacing, places, grid, lids, openness):  # type: ignore[no-untyped-def]
    """Fill in the open share of every face."""
    for b in numba.prange(1, len(places)):
        for i in range(BRICK):
            for j in range(BRICK):
                for k in range(BRICK):
                    x = origin[0] + spacing * (BRICK * places[b, 0] + i)
                    y = origin[1] + spacing * (BRICK * places[b, 1] + j)
                    z = origin[2] + spacing * (BRICK * places[b, 2] + k)
                    for axis in range(3):
                        share = _open_share(x, y, z, axis, spacing, grid, lids)
                        openness[b, i, j, k, axis] = share if share >= MIN_OPEN else 0.0


@numba.njit(cache=True)
def _open_share(x, y, z, axis, spacing, grid, lids):  # type: ignore[no-untyped-def]
    """Return the open share of the face square to an axis with its lowest corner at (x, y, z)."""
    half = 0.5 * spacing
    mx = x + (half if axis != 0 else 0.0)
    my = y + (half if axis != 1 else 0.0)
    mz = z + (half if axis != 2 else 0.0)
    clearance = interpolate(grid[0], grid[1], grid[2], grid[3], mx, my, mz)
    lid = _lid_near(mx, my, mz, spacing, lids)
    if lid < 0:
        if clearance > 0.75 * spacing:
            return 1.0
        # Deeper in the rock than its band, the field holds the band's depth.
        if clearance <= -0.75 * spacing or (clearance < 0.0 and clearance <= -0.999 * BAND * grid[3] < -half):
            return 0.0
    patch, total = spacing / FACE_SAMPLES, 0.0
    for m in range(FACE_SAMPLES):
        for n in range(FACE_SAMPLES):
            a, b = patch * (m + 0.5), patch * (n + 0.5)
            px = x if axis == 0 else x + a
            py = y + a if axis == 0 else (y if axis == 1 else y + b)
            pz = z if axis == 2 else z + b
            total += _open_at(px, py, pz, patch, lid, grid, lids, spacing)
    return total / FACE_SAMPLES**2


@numba.njit(cache=True)
def _open_at(x, y, z, patch, lid, grid, lids, spacing):  # type: ignore[no-untyped-def]
    """Return the open share of a small patch around a point, from its distance to the wall."""
    clearance = interpolate(grid[0], grid[1], grid[2], grid[3], x, y, z)
    if lid >= 0:
        a, b, height = in_frame(lids[0][lid], x, y, z)
        aside = inside_outline(a, b, lids[1], lids[2][lid], lids[2][lid + 1])
        if 0.0 <= height <= DUCT_CELLS * spacing:
            clearance = max(clearance, aside)
        elif height < 0.0 and aside > 0.0 and clearance >= -height - 0.1 * grid[3] and clearance > -0.1 * grid[3]:
            return 1.0  # the nearest surface is the lid, and the wall farther away
    return min(max(0.5 + clearance / patch, 0.0), 1.0)


@numba.njit(cache=True)
def _lid_near(x, y, z, spacing, lids):  # type: ignore[no-untyped-def]
    """Return the lid whose duct a face at a point may touch; -1 for none."""
    for n in range(len(lids[0])):
        a, b, height = in_frame(lids[0][n], x, y, z)
        if -spacing < height < (DUCT_CELLS + 1.0) * spacing and max(abs(a), abs(b)) < lids[3][n] + spacing:
            return n
    return -1


@numba.njit(cache=True)
def in_frame(frame, x, y, z):  # type: ignore[no-untyped-def]
    """Return the two coordinates of a point in a lid's plane and its height above it, out of the water, m."""
    dx, dy, dz = x - frame[0, 0], y - frame[0, 1], z - frame[0, 2]
    a = dx * frame[1, 0] + dy * frame[1, 1] + dz * frame[1, 2]
    b = dx * frame[2, 0] + dy * frame[2, 1] + dz * frame[2, 2]
    return a, b, dx * frame[3, 0] + dy * frame[3, 1] + dz * frame[3, 2]


@numba.njit(cache=True)
def inside_outline(a, b, outlines, first, last):  # type: ignore[no-untyped-def]
    """Return the distance from a point to an outline, positive inside it (even-odd rule), m."""
    nearest, is_inside = 1e30, False
    for n in range(first, last):
        a0, b0, a1, b1 = outlines[n, 0], outlines[n, 1], outlines[n, 2], outlines[n, 3]
        if (b0 > b) != (b1 > b) and a < a0 + (b - b0) / (b1 - b0) * (a1 - a0):
            is_inside = not is_inside
        da, db = a1 - a0, b1 - b0
        share = ((a - a0) * da + (b - b0) * db) / max(da * da + db * db, 1e-30)
        share = min(max(share, 0.0), 1.0)
        nearest = min(nearest, (a - a0 - share * da) ** 2 + (b - b0 - share * db) ** 2)
    return np.sqrt(nearest) if is_inside else -np.sqrt(nearest)
