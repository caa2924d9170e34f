"""From pieces of water to one smooth surface: their union on a grid, rounded off, as triangles.

The grid is worked through in blocks, so that memory does not grow with the extent of the cave.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from aquanav_tools.errors import ResourceError
from aquanav_tools.survey.shapes import Shape
from aquanav_tools.types import Array, IntArray, Mesh

BLOCK = 48
"""Cells along a block's edge."""
HALO = 4
"""Samples around a block that smoothing looks at: four times its standard deviation."""
SMOOTHING = 1.0
"""Standard deviation of the Gaussian that rounds off the creases between pieces, voxels."""
BAND = 3.0
"""Distances are clipped here, voxels; nothing farther from the wall matters to it."""
NUDGE = 0.02
"""No sample is nearer to the level than this, voxels: no corner of a triangle falls on a sample, where it could not be
told which edge of the grid it is on."""
MAX_BLOCKS = 100_000
"""About an hour's work and 100 million triangles."""


def sculpt(shapes: Sequence[Shape], kept: Sequence[Shape], voxel: float) -> Mesh:
    """Return the closed surface around the union of shapes, normals outwards, its creases rounded.

    Args:
        shapes: what is rounded.
        kept: what stays open whatever the rounding does, for narrow passages.
        voxel: spacing of the grid, m.

    Raises:
        ResourceError: the shapes spread over more blocks than can be worked through.
    """
    origin = np.min([shape.low for shape in shapes], axis=0) - 2.0 * HALO * voxel
    in_block = _shapes_by_block(shapes, origin, voxel)
    if len(in_block) > MAX_BLOCKS:
        raise ResourceError(
            f"The cave fills {len(in_block):,} blocks of {BLOCK * voxel:.3g} m, more than {MAX_BLOCKS:,}. Give a voxel "
            f"of {voxel * (len(in_block) / MAX_BLOCKS) ** 0.5:.2g} m or more."
        )
    kept_in_block = _shapes_by_block(kept, origin, voxel)
    corners, keys, faces, count = [], [], [], 0
    for block, members in in_block.items():
        field = _field(block, members, origin, voxel)
        for shape in kept_in_block.get(block, []):
            _carve(field, shape, _low_corner(block, origin, voxel), voxel)
        for vertices, triangles in _triangles(field[HALO:-HALO, HALO:-HALO, HALO:-HALO]):
            at = vertices + BLOCK * np.array(block)
            corners.append(at)
            keys.append(_edge_keys(at, count))
            faces.append(triangles + count)
            count += len(vertices)
    _, first, which = np.unique(np.concatenate(keys), axis=0, return_index=True, return_inverse=True)
    vertices = origin + voxel * np.concatenate(corners)[first]
    return Mesh(vertices, which.reshape(-1)[np.concatenate(faces)].astype(np.int64))


def _shapes_by_block(shapes: Sequence[Shape], origin: Array, voxel: float) -> dict[tuple[int, int, int], list[Shape]]:
    """Return the shapes that reach into each block or its halo."""
    found: dict[tuple[int, int, int], list[Shape]] = {}
    for shape in shapes:
        low = np.floor(((shape.low - origin) / voxel - HALO - BAND) / BLOCK).astype(int)
        high = np.floor(((shape.high - origin) / voxel + HALO + BAND) / BLOCK).astype(int)
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                for k in range(low[2], high[2] + 1):
                    found.setdefault((i, j, k), []).append(shape)
    return found


def _low_corner(block: tuple[int, int, int], origin: Array, voxel: float) -> Array:
    corner: Array = origin + voxel * (BLOCK * np.array(block) - HALO)
    return corner


def _field(block: tuple[int, int, int], shapes: list[Shape], origin: Array, voxel: float) -> Array:
    """Return a block's smoothed distances to the union, voxels, negative inside, with its halo."""
    from scipy.ndimage import gaussian_filter

    field = np.full((BLOCK + 1 + 2 * HALO,) * 3, BAND)
    low = _low_corner(block, origin, voxel)
    for shape in shapes:
        _carve(field, shape, low, voxel)
    smooth: Array = gaussian_filter(field, SMOOTHING, mode="nearest", truncate=HALO / SMOOTHING)
    return smooth


def _carve(field: Array, shape: Shape, low: Array, voxel: float) -> None:
    """Lower a field's samples to their distance from a shape, voxels."""
    first = np.clip(np.floor((shape.low - low) / voxel - BAND).astype(int), 0, field.shape)
    last = np.clip(np.ceil((shape.high - low) / voxel + BAND).astype(int) + 1, 0, field.shape)
    if (last <= first).any():
        return
    part = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    axes = [np.arange(a, b) for a, b in zip(first, last, strict=True)]
    samples = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    distance = shape.distance(low + voxel * samples) / voxel
    field[part] = np.minimum(field[part], np.maximum(distance, -BAND).reshape(field[part].shape))


def _triangles(field: Array) -> Iterator[tuple[Array, IntArray]]:
    """Yield the corners, in cells, and triangles of the zero level, if the field has one."""
    from skimage.measure import marching_cubes

    field = np.where(np.abs(field) < NUDGE, np.where(field < 0.0, -NUDGE, NUDGE), field)
    if field.min() < 0.0 < field.max():
        vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
        yield vertices.astype(np.float64), faces.astype(np.int64)


def _edge_keys(vertices: Array, first: int) -> IntArray:
    """Return (V, 4) keys that are the same for one corner seen from two blocks: cell and direction of its grid edge.

    A corner inside a cell is on no edge; it belongs to one block and gets a key of its own.
    """
    nearest = np.rint(vertices).astype(np.int64)
    is_between = np.abs(vertices - nearest) > 0.1 * NUDGE / BAND
    axis = is_between.argmax(axis=1)
    keys = np.column_stack([np.where(is_between, np.floor(vertices).astype(np.int64), nearest), axis])
    is_inside = is_between.sum(axis=1) != 1
    keys[is_inside] = np.column_stack([np.full((is_inside.sum(), 3), -1), first + np.flatnonzero(is_inside)])
    return keys
