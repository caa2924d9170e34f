"""Resampling a damaged surface: winding numbers tell water from rock, marching cubes draws the wall between them.

The generalised winding number of the surface is near 1 in the water and near 0 in the rock even where the surface has
holes, crosses itself or is a mere soup (Jacobson et al. 2013, Barill et al. 2018). Space is sampled in tiles, of which
only those with wall in them are ever held, so that memory follows the area of the walls and not the box around them.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.closing.carving import (
    BAND_VOXELS,
    NO_CARVING,
    Carving,
    carve,
    is_seen_through,
    with_seen_through,
)
from aquanav_tools.cave.mesh.rasterise import band_distances
from aquanav_tools.cave.scan.sight import Sight
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh, Progress, ignore_progress

WATER_LEVEL = 0.5
TILE = 96
"""Cells along a tile's edge."""
COARSE_STEP = 4
"""Away from the walls the winding number is sampled on every fourth sample only."""
CROSSED_VOXELS = 0.9
"""Every point of a wall is this near to a sample, half a cell's diagonal and a little more."""
HALO = 4
"""Samples around a tile that smoothing may look at; a multiple of COARSE_STEP."""
CARVING_HALO = 8
"""The same where something is carved, which looks farther ..."""
FAULTS_HALO = 28
"""... and where faults are smoothed, with balls of up to five samples four times over."""
BETWEEN_STEP = 12
"""Samples of which one is asked to find tiles that the water's border crosses away from any wall."""
NEAR_ACCURACY, HOLE_ACCURACY = 1.3, 2.0
"""Of igl's fast winding number: within 0.04 at the first (measured), enough to tell the sides of a wall apart, and
within 0.005 at the second, where the number itself shapes the fill; the first costs less than half."""
SMOOTHING = 0.6
"""Standard deviation of the filter that removes the staircase, voxels."""
UNSURE = 0.35
"""Winding numbers within this of the level are computed at every sample: a hole's middle passes there."""
HOLE_SLOPE = 20.0
"""Over a hole, where the surface is far, the distance is how far the winding number is from its level, times this."""
SMALLEST_VALUE = 1e-3
"""Marching cubes makes degenerate faces where a sample lies on the level; none comes nearer than this, voxels."""


_Piece: TypeAlias = tuple[Array, IntArray]
"""Vertices, in samples, and faces."""


def water_surface(
    surface: Mesh, voxel: float, carving: Carving = NO_CARVING, progress: Progress = ignore_progress
) -> Mesh:
    """Return the boundary of all water that a surface encloses, normals out of it.

    Args:
        surface: walls with normals out of the water; may have holes, cracks and repetitions.
        voxel: spacing of the samples, m.
        carving: corrections.
        progress: called with (tiles done, tiles in all).

    Raises:
        MeshError: no space is enclosed.
    """
    return Sampler(surface, voxel).water_surface(carving, progress)


class Sampler:
    """Samples the water in one surface, and again only where its corrections change.

    Args:
        surface: walls with normals out of the water; may have holes, cracks and repetitions.
        voxel: spacing of the samples, m.
        sight: what cameras looked through is water, whatever the surface says.
    """

    def __init__(self, surface: Mesh, voxel: float, sight: Sight | None = None) -> None:
        import igl

        self._surface, self._voxel, self._sight = surface, voxel, sight
        self._lattice = _Lattice(surface, voxel, surface.vertices[:0] if sight is None else sight.centres)
        self._winding = igl.FastWindingNumberBVH()
        self._winding.init(surface.vertices, surface.faces)
        self._tiles_with_level = self._lattice.tiles_with_level(self._winding, sight)
        self._pieces: dict[tuple[int, ...], tuple[Carving, _Piece]] = {}
        self._seen: dict[tuple[int, ...], npt.NDArray[np.uint8]] = {}

    def water_surface(self, carving: Carving, progress: Progress = ignore_progress) -> Mesh:
        """Return the boundary of all water; see the function of this name."""
        lattice, found = self._lattice, {}
        waiting = [tuple(tile) for tile in lattice.with_tiles_of(self._tiles_with_level, carving).tolist()]
        while waiting:
            key = waiting.pop(0)
            if key in found:
                continue
            tile = np.array(key)
            local = carving.near(*lattice.box(tile))
            kept = self._pieces.get(key)
            if kept is None or not kept[0].is_as(local):
                self._pieces[key] = local, _march(self._field(tile, local), tile * TILE)
            found[key] = self._pieces[key][1]
            # Narrow water that was only looked through passes between the samples that told which tiles there are.
            waiting += _across_borders(found[key][0], tile)
            progress(len(found), len(found) + len(waiting))
        mesh = _weld(list(found.values()), lattice.num_samples)
        if not len(mesh.faces):
            raise MeshError(
                f"The scan of {len(self._surface.faces)} triangles encloses no space at {self._voxel:.3g} m. It is a "
                "single wall or floor and no passage. Scan the surroundings too, or give a smaller --voxel if the "
                "passage is narrower."
            )
        return Mesh(lattice.origin + self._voxel * mesh.vertices, mesh.faces)

    def _field(self, tile: IntArray, carving: Carving) -> Array:
        """Return the (TILE + 1)^3 values of a tile, negative in water, in voxels from the wall near it.

        The carving is what of it reaches there.
        """
        from scipy.ndimage import gaussian_filter

        lattice, voxel = self._lattice, self._voxel
        halo = CARVING_HALO if carving.columns or self._sight is not None else HALO
        halo = FAULTS_HALO if len(carving.faults) else halo
        count = TILE + 1 + 2 * halo
        origin = lattice.origin + voxel * (tile * TILE - halo)
        triangles = lattice.triangles_near(tile, around=1 if halo > CARVING_HALO else 0)
        close, _ = band_distances(triangles, origin, voxel, (count, count, count), BAND_VOXELS * voxel)
        distance = close.astype(np.float64)
        excess = _winding_in_tile(self._winding, origin, voxel, distance < CROSSED_VOXELS * voxel) - WATER_LEVEL
        magnitude = np.minimum(np.minimum(distance / voxel, HOLE_SLOPE * np.abs(excess)), BAND_VOXELS)
        field: Array = -np.sign(excess) * magnitude
        if self._sight is not None:
            field = with_seen_through(field, self._seen_through(tile, halo, field > 0.0))
        field = carve(field, distance / voxel, origin, voxel, carving)
        inner = slice(halo, -halo)
        smooth: Array = gaussian_filter(field, SMOOTHING)[inner, inner, inner]
        smooth[np.abs(smooth) < SMALLEST_VALUE] = SMALLEST_VALUE
        for axis in range(3):  # no water leaves the samples
            ends = np.moveaxis(smooth, axis, 0)
            if tile[axis] == 0:
                ends[0] = np.maximum(ends[0], SMALLEST_VALUE)
            if tile[axis] == lattice.num_tiles[axis] - 1:
                ends[-1] = np.maximum(ends[-1], SMALLEST_VALUE)
        return smooth

    def _seen_through(self, tile: IntArray, halo: int, is_rock: BoolArray) -> BoolArray:
        """Return the flags of a tile's samples that are rock to the surface and that cameras looked through.

        Asking costs more than all else about a tile, so the answer is kept, a bit per sample.
        """
        key = (*tile.tolist(), halo)
        if self._sight is not None and key not in self._seen:
            low = self._lattice.origin + self._voxel * (tile * TILE - halo)
            sight = self._sight.near(low, low + self._voxel * np.array(is_rock.shape))
            seen = np.zeros(is_rock.shape, dtype=bool)
            seen[is_rock] = is_seen_through(sight, low + self._voxel * np.argwhere(is_rock), self._voxel)
            self._seen[key] = np.packbits(seen)
        return np.unpackbits(self._seen[key], count=is_rock.size).astype(bool).reshape(is_rock.shape)


class _Lattice:
    """The samples in space around a surface: their tiles, and which triangles come near each tile.

    Around (N, 3) places, too, and with room to draw out ends towards them.
    """

    def __init__(self, surface: Mesh, voxel: float, places: Array) -> None:
        self.voxel = voxel
        margin = (TILE if len(places) else CARVING_HALO + COARSE_STEP) * voxel
        within = np.concatenate([surface.vertices, places])
        self.origin = within.min(axis=0) - margin
        extent = within.max(axis=0) + margin - self.origin
        self.num_tiles = np.ceil(extent / (TILE * voxel)).astype(np.int64)
        self.num_samples = self.num_tiles * TILE + 1
        self._corners = surface.triangles
        reach = (CARVING_HALO + BAND_VOXELS + 1) * voxel
        low = np.floor((self._corners.min(axis=1) - reach - self.origin) / (TILE * voxel)).astype(np.int64)
        high = np.floor((self._corners.max(axis=1) + reach - self.origin) / (TILE * voxel)).astype(np.int64)
        last = self.num_tiles - 1
        members, tile_ids = _cover(np.clip(low, 0, last), np.clip(high, 0, last), self.num_tiles)
        order = np.argsort(tile_ids, kind="stable")
        self._members, self._tile_ids = members[order], tile_ids[order]

    def tiles_with_level(  # type: ignore[no-untyped-def]  # igl ships no types
        self, winding, sight: Sight | None
    ) -> IntArray:
        """Return the (T, 3) tiles with wall near them, and those through which the water's border may pass unseen."""
        near = np.unique(self._tile_ids)
        # Between two walls or across a hole the winding number changes over metres.
        step = BETWEEN_STEP
        counts = self.num_samples // step + 1
        values = np.empty(counts)
        y, z = np.meshgrid(np.arange(counts[1]), np.arange(counts[2]), indexing="ij")
        for x in range(counts[0]):
            samples = self.origin + self.voxel * step * np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)
            values[x] = winding.winding_number(samples).reshape(y.shape)
            if sight is not None:
                cameras = sight.near(samples[0], samples[-1])
                # Water that was looked through where the surface has rock ends somewhere near.
                is_carved = is_seen_through(cameras, samples, self.voxel).reshape(y.shape) & (values[x] < WATER_LEVEL)
                values[x][is_carved] = WATER_LEVEL
        unsure = np.argwhere(np.abs(values - WATER_LEVEL) < UNSURE)
        touched = [np.clip((unsure + shift) * step // TILE, 0, self.num_tiles - 1) for shift in (-1, 0, 1)]
        between = np.unique(np.ravel_multi_index(np.concatenate(touched).T, self.num_tiles))
        return np.stack(np.unravel_index(np.union1d(near, between), self.num_tiles), axis=1)

    def box(self, tile: IntArray) -> tuple[Array, Array]:
        """Return the corners of all samples that are looked at for a tile, m."""
        low = self.origin + self.voxel * (tile * TILE - CARVING_HALO)
        return low, low + self.voxel * (TILE + 2 * CARVING_HALO)

    def with_tiles_of(self, tiles: IntArray, carving: Carving) -> IntArray:
        """Return (T, 3) tiles and those that legs and columns of water pass through far from any wall."""
        around = carving.leg_radius
        boxes = [np.stack([leg.min(axis=0) - around, leg.max(axis=0) + around]) for leg in carving.legs]
        boxes += [column.box for column in carving.columns]
        if not boxes:
            return tiles
        places = (np.array(boxes) - self.origin) / (TILE * self.voxel)
        last = self.num_tiles - 1
        low, high = (np.clip(np.floor(places[:, end]).astype(np.int64), 0, last) for end in (0, 1))
        touched = np.union1d(np.ravel_multi_index(tiles.T, self.num_tiles), _cover(low, high, self.num_tiles)[1])
        return np.stack(np.unravel_index(touched, self.num_tiles), axis=1)

    def triangles_near(self, tile: IntArray, around: int) -> Array:
        """Return the (K, 3, 3) triangles near a tile, or near any of those so many tiles around it."""
        low, high = np.maximum(tile - around, 0), np.minimum(tile + around, self.num_tiles - 1)
        ids = _cover(low[None], high[None], self.num_tiles)[1]
        starts, ends = (np.searchsorted(self._tile_ids, ids, side=side) for side in ("left", "right"))
        members = [self._members[start:end] for start, end in zip(starts, ends, strict=True)]
        return self._corners[np.unique(np.concatenate(members))]


def _cover(low: IntArray, high: IntArray, num_tiles: IntArray) -> tuple[IntArray, IntArray]:
    """Return all pairs of a box and a tile it touches, the boxes given by their (N, 3) first and last tiles."""
    spans = high - low + 1
    counts = spans.prod(axis=1)
    boxes = np.repeat(np.arange(len(low)), counts)
    rank = np.arange(len(boxes)) - np.repeat(np.cumsum(counts) - counts, counts)
    span = spans[boxes]
    steps = np.stack([rank // (span[:, 1] * span[:, 2]), rank // span[:, 2] % span[:, 1], rank % span[:, 2]])
    return boxes, np.ravel_multi_index(low[boxes].T + steps, num_tiles)


def _winding_in_tile(winding, origin: Array, voxel: float, is_wall: BoolArray) -> Array:  # type: ignore[no-untyped-def]
    """Return the winding number at all samples, away from walls and holes that of the nearest coarse sample."""
    from scipy.ndimage import maximum_filter

    count = is_wall.shape[0]
    coarse_count = (count - 1) // COARSE_STEP + 1
    axis = np.arange(coarse_count) * COARSE_STEP
    samples = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    coarse = winding.winding_number(origin + voxel * samples).reshape((coarse_count,) * 3)
    nearest = np.minimum((np.arange(count) + COARSE_STEP // 2) // COARSE_STEP, coarse_count - 1)
    values: Array = coarse[np.ix_(nearest, nearest, nearest)]
    # No wall passes between any other sample and the coarse one that speaks for it.
    is_near = maximum_filter(is_wall, size=COARSE_STEP + 1)
    is_hole = ~is_near & (np.abs(values - WATER_LEVEL) < UNSURE)
    for asked, accuracy in ((is_near, NEAR_ACCURACY), (is_hole, HOLE_ACCURACY)):
        fine = np.argwhere(asked)
        if len(fine):
            values[tuple(fine.T)] = winding.winding_number(origin + voxel * fine, accuracy)
    return values


def _march(field: Array, first: IntArray) -> _Piece:
    """Return the vertices (in samples) and faces of the level in one tile."""
    from skimage.measure import marching_cubes

    if field.min() > 0.0 or field.max() < 0.0:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
    return vertices.astype(np.float64) + first, faces.astype(np.int64)


def _across_borders(vertices: Array, tile: IntArray) -> list[tuple[int, ...]]:
    """Return the tiles beside one into which its surface goes on, by its vertices in samples."""
    beside = []
    for axis in range(3):
        for side in (0, 1):
            if (vertices[:, axis] == (tile[axis] + side) * TILE).any():
                neighbour = tile.copy()
                neighbour[axis] += 2 * side - 1
                beside.append(tuple(neighbour.tolist()))
    return beside


def _weld(pieces: list[_Piece], num_samples: IntArray) -> Mesh:
    """Return the tiles' surfaces as one: vertices on the same edge of the lattice are the same vertex."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in pieces])
    vertices = np.concatenate([vertices for vertices, _ in pieces])
    faces = np.concatenate([faces + start for (_, faces), start in zip(pieces, starts, strict=False)])
    whole = np.floor(vertices).astype(np.int64)
    is_between = vertices != whole
    # Two coordinates of a vertex on an edge are whole; others lie inside a cell, which belongs to one tile.
    on_edge = is_between.sum(axis=1) == 1
    sample = np.ravel_multi_index(whole.T, num_samples + 1)
    keys = np.where(on_edge, 3 * sample + is_between.argmax(axis=1), -1 - np.arange(len(vertices)))
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return Mesh(vertices[first], inverse[faces])
