"""The closed surface of a plan's water, made block by block: time and memory grow with the walls, not with the box."""

from __future__ import annotations

import numpy as np

from aquanav_tools.errors import MeshError
from aquanav_tools.synthetic.styles import rock
from aquanav_tools.synthetic.styles.plan import Plan
from aquanav_tools.types import Array, IntArray, Mesh

CELLS = 24
"""Cells along the edge of a block."""
BLOCK_FACES = 9
"""Faces that every fallen block is given."""
NEAREST, FARTHEST = 0.04, 2.5
"""Samples keep at least and at most so many voxels from the level: no vertex comes near a sample, no sliver is made."""
OUTSIDE = 1e6
"""Value of the rock beyond the two portals: it puts them into the plane of the last samples."""
AXES = np.array([1, 0, 0]), np.array([0, 1, 0]), np.array([0, 0, 1])


def water_surface(plan: Plan, voxel: float, seed: int) -> Mesh:
    """Return the closed surface of a plan's water, wall and two flat lids, normals out of the water, m.

    Stray pockets of water and floating rock are left out: the largest surface is the cave's.

    Args:
        plan: of the cave; its extent is a multiple of the voxel.
        voxel: distance between the samples of the field, m.
        seed: picks the relief.
    """
    stations = rock.station_table(plan.passages)
    places, members = _blocks_near(stations, voxel)
    tables = rock.block_table(plan.blocks, BLOCK_FACES), rock.column_table(plan.columns)
    relief, edge = rock.relief_table(plan), CELLS * voxel
    rooms = np.empty((5, *(CELLS + 1,) * 3))
    field = rooms[0]
    last = round(plan.extent / voxel)
    pieces = _Pieces()
    for place, near in zip(places, members, strict=True):
        low = edge * place
        blocks = _touching(tables[0], low, edge)
        rock.fill_block(low, voxel, stations, near, blocks, tables[1], relief, seed, rooms)
        first = CELLS * place
        ends = first[0] + np.arange(CELLS + 1)
        near_level = np.clip(np.abs(field), NEAREST * voxel, FARTHEST * voxel)
        signed = np.where(field < 0.0, -near_level, near_level)
        signed[(ends < 0) | (ends > last)] = OUTSIDE
        if signed.min() < 0.0 < signed.max():
            pieces.add(signed, first)
    mesh = pieces.joined(voxel, last)
    return _largest(mesh)


def _blocks_near(stations: Array, voxel: float) -> tuple[IntArray, list[IntArray]]:
    """Return the (B, 3) places of the blocks that any station reaches, and the stations that reach each, in order."""
    edge = CELLS * voxel
    reach = stations[:, -1:]
    low = np.floor((stations[:, :3] - reach) / edge).astype(np.int64)
    high = np.floor((stations[:, :3] + reach) / edge).astype(np.int64)
    found: dict[tuple[int, int, int], list[int]] = {}
    for n, (a, b) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        for i in range(a[0], b[0] + 1):
            for j in range(a[1], b[1] + 1):
                for k in range(a[2], b[2] + 1):
                    found.setdefault((i, j, k), []).append(n)
    places = sorted(found)
    return np.array(places), [np.array(found[place]) for place in places]


def _touching(blocks: Array, low: Array, edge: float) -> Array:
    """Return the rows of a block table whose balls touch a cube."""
    gap = np.maximum(np.maximum(low - blocks[:, :3], blocks[:, :3] - low - edge), 0.0)
    return np.ascontiguousarray(blocks[(gap**2).sum(axis=1) <= blocks[:, 3] ** 2])


class _Pieces:
    """Surfaces of blocks, joined where they meet: a vertex is known by the edge of the grid that it lies on."""

    def __init__(self) -> None:
        self._keys: list[IntArray] = []
        self._points: list[Array] = []
        self._faces: list[IntArray] = []
        self._count = 0

    def add(self, field: Array, first: IntArray) -> None:
        """Add the surface of one block of samples; `first` is the grid index of its first sample."""
        from skimage.measure import marching_cubes

        points, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
        points = points.astype(np.float64)
        lattice = np.rint(points).astype(np.int64)
        is_off = np.abs(points - lattice) > 0.25 * NEAREST / (NEAREST + FARTHEST)
        base = np.where(is_off, np.floor(points).astype(np.int64), lattice)
        axis = np.where(is_off.sum(axis=1) == 1, is_off.argmax(axis=1), 3)  # 3: within a cell, where no other meets it
        for a in range(3):
            on = axis == a
            here = base[on]
            there = here + AXES[a]
            one, other = field[tuple(here.T)], field[tuple(there.T)]
            points[on, a] = here[:, a] + one / (one - other)
            for b in range(3):
                if b != a:
                    points[on, b] = here[:, b]
        self._keys.append(np.column_stack([base + first, axis]))
        self._points.append(points + first)
        self._faces.append(faces.astype(np.int64) + self._count)
        self._count += len(points)

    def joined(self, voxel: float, last: int) -> Mesh:
        """Return all surfaces as one mesh, m; what lies within a millionth of the two ends is put onto them."""
        if not self._keys:
            raise MeshError("The plan has no water. Choose another seed.")
        keys = np.concatenate(self._keys)
        keys -= keys.min(axis=0)
        sizes = keys.max(axis=0) + 1
        flat = np.ravel_multi_index(tuple(keys.T), tuple(sizes))
        _, index, inverse = np.unique(flat, return_index=True, return_inverse=True)
        points = np.concatenate(self._points)[index]
        for end in (0, last):
            points[np.abs(points[:, 0] - end) < 1e-4, 0] = end
        return Mesh(voxel * points, inverse.ravel()[np.concatenate(self._faces)])


def _largest(mesh: Mesh) -> Mesh:
    """Return the component of a mesh that encloses most."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    faces, count = mesh.faces, len(mesh.vertices)
    ones = np.ones(len(faces), dtype=np.int8)
    links = coo_array(
        (np.r_[ones, ones], (np.r_[faces[:, 0], faces[:, 1]], np.r_[faces[:, 1], faces[:, 2]])), (count,) * 2
    )
    number, part = connected_components(links, directed=False)
    if number == 1:
        return mesh
    a, b, c = (mesh.vertices[faces[:, n]] for n in range(3))
    volumes = np.bincount(part[faces[:, 0]], np.einsum("ij,ij->i", a, np.cross(b, c)), number)
    kept = faces[part[faces[:, 0]] == volumes.argmax()]
    used, inverse = np.unique(kept, return_inverse=True)
    return Mesh(mesh.vertices[used], inverse.reshape(-1, 3))
