"""Resampling a damaged surface: winding numbers tell water from rock, marching cubes draws the wall between them.

The generalised winding number of the surface is near 1 in the water and near 0 in the rock even where the surface has
holes, crosses itself or is a mere soup (Jacobson et al. 2013, Barill et al. 2018). Space is sampled in tiles, of which
only those with wall in them are ever held, so that memory follows the area of the walls and not the box around them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

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
BAND_VOXELS = 2
"""Distances are exact this near to the wall and cut off beyond: the smoothing looks no farther."""
HALO = 4
"""Samples around a tile that smoothing may look at; a multiple of COARSE_STEP."""
CARVING_HALO = 8
"""The same where something is carved, which looks farther."""
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
MIN_CAMERAS = 3
"""Space that at least so many cameras looked through is water, whatever the surface says: a single one may be wrong."""
SIGHT_VOXELS = 2.0
"""... if the wall they saw lies this far behind it, voxels: the surface itself is as thick as its noise."""
SIGHT_SMOOTHING = 1.5
"""Standard deviation of the filter that takes slivers and pits from such water, voxels ..."""
MIN_CARVED = 0.1
"""... and changes nothing where less than this share of the surroundings was carved."""
SMALLEST_VALUE = 1e-3
"""Marching cubes makes degenerate faces where a sample lies on the level; none comes nearer than this, voxels."""


@dataclass(frozen=True, eq=False)
class Carving:
    """Where the field is corrected after looking at a first result."""

    legs: Array
    """(M, 2, 3) lines that are water up to `leg_radius` around them, m."""
    leg_radius: float
    """m."""
    faults: Array
    """(K, 5) balls (centre, radius) in which wall is smoothed until no window or pillar is left in it, and how near to
    the scan it stays as it is, m."""
    fault_radius: float
    """Windows and pillars that are thinner than twice this disappear there, m."""
    sight: Sight | None = None
    """What cameras looked through becomes water; None without cameras."""


NO_CARVING = Carving(np.zeros((0, 2, 3)), 0.0, np.zeros((0, 5)), 0.0)


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
    import igl

    is_carved = len(carving.faults) > 0 or carving.sight is not None
    lattice = _Lattice(surface, voxel, CARVING_HALO if is_carved else HALO)
    winding = igl.FastWindingNumberBVH()
    winding.init(surface.vertices, surface.faces)
    tiles = lattice.tiles_with_level(winding, carving.sight)
    pieces = []
    for done, (tile, triangles) in enumerate(lattice.triangles_by_tile(tiles)):
        pieces.append(_march(_tile_field(lattice, tile, triangles, winding, carving), tile * TILE))
        progress(done + 1, len(tiles))
    mesh = _weld(pieces, lattice.num_samples)
    if not len(mesh.faces):
        raise MeshError(
            f"The scan of {len(surface.faces)} triangles encloses no space at {voxel:.3g} m. It is a single wall "
            "or floor and no passage. Scan the surroundings too, or give a smaller --voxel if the passage is narrower."
        )
    return Mesh(lattice.origin + voxel * mesh.vertices, mesh.faces)


class _Lattice:
    """The samples in space: their tiles, and which triangles come near each tile."""

    def __init__(self, surface: Mesh, voxel: float, halo: int) -> None:
        self.voxel, self.halo = voxel, halo
        margin = (halo + COARSE_STEP) * voxel
        self.origin = surface.vertices.min(axis=0) - margin
        extent = surface.vertices.max(axis=0) + margin - self.origin
        self.num_tiles = np.ceil(extent / (TILE * voxel)).astype(np.int64)
        self.num_samples = self.num_tiles * TILE + 1
        self._corners = surface.triangles
        reach = (halo + BAND_VOXELS + 1) * voxel
        low = np.floor((self._corners.min(axis=1) - reach - self.origin) / (TILE * voxel)).astype(np.int64)
        high = np.floor((self._corners.max(axis=1) + reach - self.origin) / (TILE * voxel)).astype(np.int64)
        last = self.num_tiles - 1
        self._members, self._tile_ids = _cover(np.clip(low, 0, last), np.clip(high, 0, last), self.num_tiles)

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
                is_carved = _is_seen_through(cameras, samples, self.voxel).reshape(y.shape) & (values[x] < WATER_LEVEL)
                values[x][is_carved] = WATER_LEVEL
        unsure = np.argwhere(np.abs(values - WATER_LEVEL) < UNSURE)
        touched = [np.clip((unsure + shift) * step // TILE, 0, self.num_tiles - 1) for shift in (-1, 0, 1)]
        between = np.unique(np.ravel_multi_index(np.concatenate(touched).T, self.num_tiles))
        return np.stack(np.unravel_index(np.union1d(near, between), self.num_tiles), axis=1)

    def triangles_by_tile(self, tiles: IntArray) -> Iterator[tuple[IntArray, Array]]:
        """Yield each tile with the (K, 3, 3) triangles near it."""
        order = np.argsort(self._tile_ids, kind="stable")
        ids = np.asarray(np.ravel_multi_index(tiles.T, self.num_tiles))
        sorted_ids = self._tile_ids[order]
        starts = np.searchsorted(sorted_ids, ids).tolist()
        ends = np.searchsorted(sorted_ids, ids, side="right").tolist()
        for tile, start, end in zip(tiles, starts, ends, strict=True):
            yield tile, self._corners[self._members[order[start:end]]]


def _cover(low: IntArray, high: IntArray, num_tiles: IntArray) -> tuple[IntArray, IntArray]:
    """Return all pairs of a box and a tile it touches, the boxes given by their (N, 3) first and last tiles."""
    spans = high - low + 1
    counts = spans.prod(axis=1)
    boxes = np.repeat(np.arange(len(low)), counts)
    rank = np.arange(len(boxes)) - np.repeat(np.cumsum(counts) - counts, counts)
    span = spans[boxes]
    steps = np.stack([rank // (span[:, 1] * span[:, 2]), rank // span[:, 2] % span[:, 1], rank % span[:, 2]])
    return boxes, np.ravel_multi_index(low[boxes].T + steps, num_tiles)


def _tile_field(  # type: ignore[no-untyped-def]  # igl ships no types
    lattice: _Lattice, tile: IntArray, triangles: Array, winding, carving: Carving
) -> Array:
    """Return the (TILE + 1)^3 values of a tile, negative in water, in voxels from the wall near it."""
    from scipy.ndimage import gaussian_filter

    voxel, halo = lattice.voxel, lattice.halo
    count = TILE + 1 + 2 * halo
    origin = lattice.origin + voxel * (tile * TILE - halo)
    close, _ = band_distances(triangles, origin, voxel, (count, count, count), BAND_VOXELS * voxel)
    distance = close.astype(np.float64)
    excess = _winding_in_tile(winding, origin, voxel, distance < CROSSED_VOXELS * voxel) - WATER_LEVEL
    magnitude = np.minimum(np.minimum(distance / voxel, HOLE_SLOPE * np.abs(excess)), BAND_VOXELS)
    field: Array = -np.sign(excess) * magnitude
    field = _with_sight(field, origin, voxel, carving.sight)
    field = _without_faults(field, distance / voxel, origin, voxel, carving)
    field = _with_legs(field, origin, voxel, carving)
    inner = slice(halo, -halo)
    smooth: Array = gaussian_filter(field, SMOOTHING)[inner, inner, inner]
    smooth[np.abs(smooth) < SMALLEST_VALUE] = SMALLEST_VALUE
    return smooth


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


def _without_faults(field: Array, distance: Array, origin: Array, voxel: float, carving: Carving) -> Array:
    """Return the field with the wall closed and opened by a ball inside the faulty places."""
    from scipy.ndimage import distance_transform_edt

    size = field.shape[0] * voxel
    beside = np.abs(carving.faults[:, :3] - (origin + 0.5 * size)).max(axis=1) < 0.5 * size + carving.faults[:, 3]
    if not beside.any():
        return field
    points = origin + voxel * np.stack(np.meshgrid(*[np.arange(n) for n in field.shape], indexing="ij"), axis=-1)
    is_faulty = np.zeros(field.shape, dtype=bool)
    for x, y, z, radius, untouched in carving.faults[beside]:
        is_faulty |= (((points - (x, y, z)) ** 2).sum(axis=-1) < radius**2) & (distance * voxel >= untouched)
    radius = carving.fault_radius / voxel
    water = distance_transform_edt(field >= 0) <= radius  # grown: pillars drown
    water = distance_transform_edt(water) > radius  # shrunk back
    water = distance_transform_edt(water) > radius  # shrunk: windows close
    water = distance_transform_edt(~water) <= radius  # grown back
    smooth = np.where(water, -1.0, 1.0)
    return np.where(is_faulty, smooth, field)


def _with_sight(field: Array, origin: Array, voxel: float, sight: Sight | None) -> Array:
    """Return the field with water where cameras looked through it, its border as smooth as noise allows."""
    from scipy.ndimage import gaussian_filter

    rock = np.argwhere(field > 0.0)
    if sight is None or not len(rock):
        return field
    sight = sight.near(origin, origin + voxel * np.array(field.shape))
    carved = np.zeros(field.shape, dtype=np.float32)
    carved[tuple(rock[_is_seen_through(sight, origin + voxel * rock, voxel)].T)] = 1.0
    if not carved.any():
        return field
    wet = np.where(field < 0.0, np.float32(1.0), carved)
    wet, beside = (gaussian_filter(mask, SIGHT_SMOOTHING, truncate=3.0) for mask in (wet, carved))
    # Across a flat border the smooth mask falls by 1 / (sigma * sqrt(2 pi)) per voxel.
    level = np.clip((0.5 - wet) * SIGHT_SMOOTHING * np.sqrt(2.0 * np.pi), -BAND_VOXELS, BAND_VOXELS)
    return np.where(beside > MIN_CARVED, np.minimum(field, level), field)


def _is_seen_through(sight: Sight, points: Array, voxel: float) -> BoolArray:
    """Return the (N,) flags of (N, 3) points that enough cameras looked through."""
    seen: BoolArray = sight.num_through(points, SIGHT_VOXELS * voxel, MIN_CAMERAS) >= MIN_CAMERAS
    return seen


def _with_legs(field: Array, origin: Array, voxel: float, carving: Carving) -> Array:
    """Return the field with water around the legs."""
    size = field.shape[0] * voxel
    for start, end in carving.legs:
        low, high = np.minimum(start, end) - 2 * carving.leg_radius, np.maximum(start, end) + 2 * carving.leg_radius
        if (low > origin + size).any() or (high < origin).any():
            continue
        points = origin + voxel * np.stack(np.meshgrid(*[np.arange(n) for n in field.shape], indexing="ij"), axis=-1)
        along = end - start
        share = np.clip((points - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        distance = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
        field = np.minimum(field, (distance - carving.leg_radius) / voxel)
    return field


def _march(field: Array, first: IntArray) -> tuple[Array, IntArray]:
    """Return the vertices (in samples) and faces of the level in one tile."""
    from skimage.measure import marching_cubes

    if field.min() > 0.0 or field.max() < 0.0:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
    return vertices.astype(np.float64) + first, faces.astype(np.int64)


def _weld(pieces: list[tuple[Array, IntArray]], num_samples: IntArray) -> Mesh:
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
