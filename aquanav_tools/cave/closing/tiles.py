"""Resampling a damaged surface: the implicit field of its water, and the surface on which that is zero.

The field is negative in water, and near a wall the distance from it. Space is sampled in tiles, of which only those
with wall in them, and those into which the water's border goes on from there, are ever held: memory follows the area of
the walls and not the box around them. Away from the walls the winding number has neither a highest nor a lowest place,
so no border of water lies there alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.closing.field_edits import (
    BAND_VOXELS,
    NO_EDITS,
    SMOOTHING_REACH,
    FieldEdits,
    Samples,
    apply_edits,
    is_seen_through,
    with_seen_through,
)
from aquanav_tools.cave.closing.packed_samples import PackedSamples, packed, unpacked
from aquanav_tools.cave.closing.solid import no_space
from aquanav_tools.cave.closing.winding import COARSE_STEP, WATER_LEVEL, WindingField, winding_field, winding_in_box
from aquanav_tools.cave.scan.sight import Sight
from aquanav_tools.geometry.mesh.box_tree import boxes_of
from aquanav_tools.geometry.mesh.marching_cubes import WITHIN_CELL, marching_cubes
from aquanav_tools.geometry.mesh.rasterise import band_distances
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh, Progress, ignore_progress

Float32Array = npt.NDArray[np.float32]

TILE = 96
"""Cells along a tile's edge."""
ODD_SHARES = np.array([0.0203, 0.0227, 0.0249])
"""Of a voxel, by which samples are off the surface's lowest corner: flat walls do not lie on whole layers of them."""
HALO = 4
"""Samples around a tile that smoothing may look at; a multiple of COARSE_STEP."""
EDITS_HALO = 8
"""The same where something is carved, which looks farther ..."""
SPURIOUS_HALO = 28
"""... and where spurious handles are smoothed away, with balls of up to five samples four times over."""
BETWEEN_STEP = 12
"""Samples of which one is asked to find tiles with water that was only looked through."""
SMOOTHING = 0.6
"""Standard deviation of the filter that removes the staircase, voxels. It rounds off rock, too: of a scan with 3 mm of
noise at 42 mm, median and 95 % of the error are 1.3 / 4.8 mm at 0.3, 1.4 / 4.8 at 0.4 and 1.9 / 7.3 at 0.6. But below
0.6 the wall follows noise of half a voxel, which then is not noticed, and ends of photos fray; and at 0.4 a third more
triangles are left, one false handle among them, and the whole build takes 2.5 GB for 1.5."""
HOLE_SLOPE = 20.0
"""Over a hole, where the surface is far, the distance is how far the winding number is from its level, times this."""
ALL_OF_BAND = 1.0 - 1e-4
"""Distances of more than this share of the band are cut off by it, and differ from it by rounding alone."""
SMALLEST_VALUE = 1e-3
"""A surface has degenerate faces where a sample lies on it; none comes nearer than this, voxels."""


class Piece(NamedTuple):
    """The surface in one tile."""

    vertices: Array
    """(V, 3) in samples of the lattice."""
    faces: IntArray
    """(F, 3)."""
    places: IntArray
    """(V, 4) the sample of the lattice and the axis along which each vertex lies beyond it; see `marching_cubes`."""


@dataclass(frozen=True, eq=False)
class TileCache:
    """What was sampled before, to be handed in again.

    Tiles whose corrections stay as they were are kept; of others, what the corrections are made to.
    """

    pieces: dict[tuple[int, ...], tuple[FieldEdits, Piece]] = field(default_factory=dict)
    """By tile, with the corrections it was made with."""
    samples: dict[tuple[int, ...], tuple[PackedSamples, PackedSamples]] = field(default_factory=dict)
    """By tile, with EDITS_HALO: the values before any correction, and the distances from the surface, in voxels."""


@dataclass(frozen=True, eq=False)
class ImplicitField:
    """A surface with normals out of the water, ready to be sampled: holes, cracks and repetitions are allowed."""

    surface: Mesh
    voxel: float
    """Spacing of the samples, m."""
    sight: Sight | None
    """What cameras looked through is water, whatever the surface says."""
    lattice: Lattice
    winding: WindingField
    seen_tiles: IntArray
    """(T, 3) tiles in which cameras looked through space."""


def implicit_field(surface: Mesh, voxel: float, sight: Sight | None = None) -> ImplicitField:
    """Return the field of the water in a surface; see `ImplicitField`."""
    lattice = Lattice(surface, voxel, surface.vertices[:0] if sight is None else sight.centres)
    seen = np.zeros((0, 3), dtype=np.int64) if sight is None else lattice.tiles_seen(sight)
    return ImplicitField(surface, voxel, sight, lattice, winding_field(surface), seen)


def water_surface(
    water: ImplicitField,
    edits: FieldEdits = NO_EDITS,
    cache: TileCache | None = None,
    progress: Progress = ignore_progress,
) -> Mesh:
    """Return the boundary of all water, normals out of it.

    Args:
        water: of the scan.
        edits: corrections.
        cache: of an earlier call with the same field; what is sampled now is added to it.
        progress: called with (tiles done, tiles in all).

    Raises:
        MeshError: no space is enclosed.
    """
    cache, lattice = cache or TileCache(), water.lattice
    found: dict[tuple[int, ...], Piece] = {}
    waiting = [tuple(tile) for tile in (*lattice.tiles_of(edits).tolist(), *water.seen_tiles.tolist())]
    while waiting:
        key = waiting.pop(0)
        if key in found:
            continue
        tile = np.array(key)
        local = edits.near(*lattice.box(tile))
        kept = cache.pieces.get(key)
        if kept is None or not kept[0].is_as(local):
            kept = cache.pieces[key] = local, _piece(_sample(water, tile, local, cache), tile * TILE)
        found[key] = kept[1]
        # The border of water leaves the walls across holes, and where it was looked through.
        waiting += _across_borders(found[key].places, tile)
        progress(len(found), len(found) + len(waiting))
    mesh = _weld(list(found.values()), lattice.num_samples)
    if not len(mesh.faces):
        raise no_space(water.surface, water.voxel)
    return Mesh(lattice.origin + water.voxel * mesh.vertices, mesh.faces)


def _sample(water: ImplicitField, tile: IntArray, edits: FieldEdits, cache: TileCache) -> Float32Array:
    """Return the (TILE + 1)^3 values of a tile, negative in water, in voxels from the wall near it.

    The edits is what of it reaches there.
    """
    lattice, voxel = water.lattice, water.voxel
    if len(edits.spurious):
        halo, (values, distance) = SPURIOUS_HALO, _with_neighbours(water, tile, edits, cache)
    else:
        halo = EDITS_HALO if edits.columns or len(edits.legs) or water.sight is not None else HALO
        values, distance = _unedited(water, tile, halo, cache)
    values = apply_edits(values, distance, lattice.origin + voxel * (tile * TILE - halo), voxel, edits)
    smooth = _smoothed(values, halo, SMOOTHING)
    for axis in range(3):  # no water leaves the samples
        ends = np.moveaxis(smooth, axis, 0)
        if tile[axis] == 0:
            ends[0] = np.maximum(ends[0], SMALLEST_VALUE)
        if tile[axis] == lattice.num_tiles[axis] - 1:
            ends[-1] = np.maximum(ends[-1], SMALLEST_VALUE)
    return smooth


def _with_neighbours(
    water: ImplicitField, tile: IntArray, edits: FieldEdits, cache: TileCache
) -> tuple[Samples, Samples]:
    """Return what `_unedited` returns, with a halo as wide as smoothing spurious handles looks.

    It is filled from the tiles around where that looks, and elsewhere rock.
    """
    origin = water.lattice.origin + water.voxel * TILE * tile
    centres = (edits.spurious[:, :3] - origin) / water.voxel + SPURIOUS_HALO
    reach = (edits.spurious[:, 3:4] + SMOOTHING_REACH * edits.smoothing_radius) / water.voxel + 2.0
    wide = tuple(np.full((TILE + 1 + 2 * SPURIOUS_HALO,) * 3, BAND_VOXELS, dtype=np.float32) for _ in range(2))
    steps = [step for step in product((-1, 0, 1), repeat=3) if any(step)]
    for step in (*steps, (0, 0, 0)):  # its own samples last, with all of their halo
        halo = 0 if any(step) else EDITS_HALO
        low = SPURIOUS_HALO + TILE * np.array(step) - halo
        first, end = np.maximum(low, 0), np.minimum(low + TILE + 1 + 2 * halo, len(wide[0]))
        other = tile + step
        is_asked = ((centres + reach >= first) & (centres - reach < end)).all(axis=1).any() or not any(step)
        if is_asked and (other >= 0).all() and (other < water.lattice.num_tiles).all():
            start = EDITS_HALO - halo - low
            for whole, part in zip(wide, _unedited(water, other, EDITS_HALO, cache), strict=True):
                whole[_slices(first, end)] = part[_slices(first + start, end + start)]
    return wide[0], wide[1]


def _slices(first: IntArray, end: IntArray) -> tuple[slice, ...]:
    return tuple(slice(*ends) for ends in zip(first.tolist(), end.tolist(), strict=True))


def _unedited(water: ImplicitField, tile: IntArray, halo: int, cache: TileCache) -> tuple[Samples, Samples]:
    """Return the values of a tile and its halo before any correction, and the distances from the surface, in voxels.

    Sampling costs more than all else about a tile, so what corrections reach is kept for the next ones.
    """
    key = tuple(tile.tolist())
    if halo == EDITS_HALO and key in cache.samples:
        kept = cache.samples[key]
        return unpacked(kept[0]), unpacked(kept[1])
    lattice, voxel = water.lattice, water.voxel
    count = TILE + 1 + 2 * halo
    origin = lattice.origin + voxel * (tile * TILE - halo)
    triangles = lattice.triangles_near(tile)
    distance, _ = band_distances(triangles, origin, voxel, (count, count, count), BAND_VOXELS * voxel)
    distance /= np.float32(voxel)
    distance[distance > ALL_OF_BAND * BAND_VOXELS] = BAND_VOXELS
    numbers = winding_in_box(water.winding, triangles, origin, voxel, distance)
    values: Samples = np.empty_like(distance)
    _combine(distance, numbers, values)
    if water.sight is not None:
        seen = _seen_through(water.sight, values > 0.0, origin, voxel)
        values = with_seen_through(values, seen).astype(np.float32, copy=False)
    if halo == EDITS_HALO:
        cache.samples[key] = packed(values), packed(distance)
    return values, distance


def _seen_through(sight: Sight, is_rock: BoolArray, origin: Array, voxel: float) -> BoolArray:
    """Return the flags of a box of samples that are rock to the surface and that cameras looked through."""
    near = sight.near(origin, origin + voxel * np.array(is_rock.shape))
    seen = np.zeros(is_rock.shape, dtype=bool)
    seen[is_rock] = is_seen_through(near, origin + voxel * np.argwhere(is_rock), voxel)
    return seen


@numba.njit(cache=True, parallel=True)
def _combine(distance, numbers, values):  # type: ignore[no-untyped-def]
    """Fill the values of samples from their distance from the wall, in voxels, and their winding number."""
    for i in numba.prange(distance.shape[0]):
        for j in range(distance.shape[1]):
            for k in range(distance.shape[2]):
                excess = numbers[i, j, k] - WATER_LEVEL
                size = min(min(distance[i, j, k], HOLE_SLOPE * abs(excess)), BAND_VOXELS)
                values[i, j, k] = -size if excess > 0.0 else size


def _smoothed(values: Samples, halo: int, deviation: float) -> Float32Array:
    """Return the values inside of a halo, smoothed, none of them 0."""
    radius = int(4.0 * deviation + 0.5)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / deviation) ** 2)
    count = len(values) - 2 * halo
    smooth = np.empty((count, count, count), dtype=np.float32)
    _smooth(np.ascontiguousarray(values, dtype=np.float32), (weights / weights.sum()).astype(np.float32), halo, smooth)
    return smooth


@numba.njit(cache=True, parallel=True)
def _smooth(values, weights, halo, smooth):  # type: ignore[no-untyped-def]
    """Fill the values inside of the halo with their means, weighted along each axis."""
    radius, count, whole = len(weights) // 2, len(smooth), len(values)
    for i in numba.prange(count):
        layer = np.zeros((whole, whole), np.float32)
        for n in range(len(weights)):
            layer += weights[n] * values[halo + i + n - radius]
        rows = np.zeros((count, whole), np.float32)
        for j in range(count):
            for n in range(len(weights)):
                rows[j] += weights[n] * layer[halo + j + n - radius]
        for j in range(count):
            for k in range(count):
                value = np.float32(0.0)
                for n in range(len(weights)):
                    value += weights[n] * rows[j, halo + k + n - radius]
                smooth[i, j, k] = value if abs(value) >= SMALLEST_VALUE else SMALLEST_VALUE


class Lattice:
    """The samples in space around a surface: their tiles, and which triangles come near each tile.

    Around (N, 3) places, too, and with room to draw out ends towards them.
    """

    def __init__(self, surface: Mesh, voxel: float, places: Array) -> None:
        self.voxel = voxel
        margin = (TILE if len(places) else EDITS_HALO + COARSE_STEP) * voxel
        within = np.concatenate([surface.vertices, places])
        self.origin = within.min(axis=0) - margin - ODD_SHARES * voxel
        extent = within.max(axis=0) + margin - self.origin
        self.num_tiles = np.ceil(extent / (TILE * voxel)).astype(np.int64)
        self.num_samples = self.num_tiles * TILE + 1
        self._corners = surface.triangles
        reach = (EDITS_HALO + BAND_VOXELS + 1) * voxel
        low, high = boxes_of(self._corners)
        low = np.floor((low - reach - self.origin) / (TILE * voxel)).astype(np.int64)
        high = np.floor((high + reach - self.origin) / (TILE * voxel)).astype(np.int64)
        last = self.num_tiles - 1
        members, tile_ids = _cover(np.clip(low, 0, last), np.clip(high, 0, last), self.num_tiles)
        order = np.argsort(tile_ids, kind="stable")
        self._members, self._tile_ids = members[order], tile_ids[order]

    def box(self, tile: IntArray) -> tuple[Array, Array]:
        """Return the corners of all samples that are looked at for a tile, m."""
        low = self.origin + self.voxel * (tile * TILE - EDITS_HALO)
        return low, low + self.voxel * (TILE + 2 * EDITS_HALO)

    def tiles_of(self, edits: FieldEdits) -> IntArray:
        """Return the (T, 3) tiles with wall near them, and those that legs and columns of water pass through."""
        near = np.unique(self._tile_ids)
        legs = zip(edits.legs, edits.leg_radii, strict=True)
        boxes = [np.stack([leg.min(axis=0) - around, leg.max(axis=0) + around]) for leg, around in legs]
        boxes += [column.box for column in edits.columns]
        if boxes:
            places = (np.array(boxes) - self.origin) / (TILE * self.voxel)
            last = self.num_tiles - 1
            low, high = (np.clip(np.floor(places[:, end]).astype(np.int64), 0, last) for end in (0, 1))
            near = np.union1d(near, _cover(low, high, self.num_tiles)[1])
        return np.stack(np.unravel_index(near, self.num_tiles), axis=1)

    def tiles_seen(self, sight: Sight) -> IntArray:
        """Return the (T, 3) tiles in which enough cameras looked through some sample of a wide grid."""
        counts = self.num_samples // BETWEEN_STEP + 1
        y, z = np.meshgrid(np.arange(counts[1]), np.arange(counts[2]), indexing="ij")
        found = [np.zeros((0, 3), dtype=np.int64)]
        for x in range(counts[0]):
            samples = BETWEEN_STEP * np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)
            places = self.origin + self.voxel * samples
            is_seen = is_seen_through(sight.near(places[0], places[-1]), places, self.voxel)
            found.append(np.unique(np.minimum(samples[is_seen] // TILE, self.num_tiles - 1), axis=0))
        return np.unique(np.concatenate(found), axis=0)

    def triangles_near(self, tile: IntArray) -> Array:
        """Return the (K, 3, 3) triangles near a tile."""
        number = np.ravel_multi_index(tuple(tile), self.num_tiles)
        start, end = (np.searchsorted(self._tile_ids, number, side=side) for side in ("left", "right"))
        return self._corners[self._members[start:end]]


def _cover(low: IntArray, high: IntArray, num_tiles: IntArray) -> tuple[IntArray, IntArray]:
    """Return all pairs of a box and a tile it touches, the boxes given by their (N, 3) first and last tiles."""
    spans = high - low + 1
    counts = spans.prod(axis=1)
    boxes = np.repeat(np.arange(len(low)), counts)
    rank = np.arange(len(boxes)) - np.repeat(np.cumsum(counts) - counts, counts)
    span = spans[boxes]
    steps = np.stack([rank // (span[:, 1] * span[:, 2]), rank // span[:, 2] % span[:, 1], rank % span[:, 2]])
    return boxes, np.ravel_multi_index(low[boxes].T + steps, num_tiles)


def _piece(values: Float32Array, first: IntArray) -> Piece:
    """Return the surface in one tile, of which the first sample is given."""
    vertices, faces, places = marching_cubes(values)
    places[:, :3] += first
    return Piece(vertices + first, faces, places)


def _across_borders(places: IntArray, tile: IntArray) -> list[tuple[int, ...]]:
    """Return the tiles beside one into which its surface goes on, by the places of its vertices."""
    beside = []
    for axis in range(3):
        on_plane = places[(places[:, 3] != axis) & (places[:, 3] < WITHIN_CELL), axis]
        for side in (0, 1):
            if (on_plane == (tile[axis] + side) * TILE).any():
                neighbour = tile.copy()
                neighbour[axis] += 2 * side - 1
                beside.append(tuple(neighbour.tolist()))
    return beside


def _weld(pieces: list[Piece], num_samples: IntArray) -> Mesh:
    """Return the tiles' surfaces as one: vertices on the same edge of the lattice are the same vertex."""
    starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
    vertices = np.concatenate([piece.vertices for piece in pieces])
    faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)])
    places = np.concatenate([piece.places for piece in pieces])
    keys = 8 * np.ravel_multi_index(places[:, :3].T, num_samples + 1) + places[:, 3]
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return Mesh(vertices[first], inverse[faces])
