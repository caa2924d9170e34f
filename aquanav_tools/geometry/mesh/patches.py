"""The topology of a triangle soup: consistently wound patches, their borders, and vertices where they merely touch."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from aquanav_tools.types import BoolArray, IntArray, Mesh


@dataclass(frozen=True, eq=False)
class Patches:
    """A mesh cut into pieces that are each wound consistently."""

    mesh: Mesh
    """The same triangles, some wound the other way."""
    ids: IntArray
    """(F,) patch of every face, from 0."""

    @property
    def count(self) -> int:
        """Number of patches."""
        return int(self.ids.max()) + 1 if len(self.ids) else 0


def find_patches(mesh: Mesh) -> Patches:
    """Return the mesh's faces wound consistently within each patch.

    A patch goes on across every edge that exactly two faces share. It ends at borders, at edges of three and more
    faces, and where going on would turn it inside out (as on a Moebius strip).
    """
    neighbours, is_same_way = _neighbours(mesh.faces)
    ids, is_flipped = _grow(neighbours, is_same_way)
    faces = mesh.faces.copy()
    faces[is_flipped] = faces[is_flipped][:, ::-1]
    return Patches(Mesh(mesh.vertices, faces), ids)


def crowded_faces(faces: IntArray) -> BoolArray:
    """Return the (F,) flags of faces at an edge that three or more faces share."""
    order, _, counts = _edges(faces)
    is_crowded = np.zeros(3 * len(faces), dtype=bool)
    is_crowded[order] = np.repeat(counts > 2, counts)
    return np.asarray(is_crowded.reshape(3, -1).any(axis=0))


def split_touching(mesh: Mesh) -> Mesh:
    """Return the mesh with a vertex of its own for every fan of faces around a vertex.

    Where two parts of a surface touch in a single vertex, the border around it is not one simple loop; with a copy for
    each part it is.
    """
    corners = np.arange(mesh.faces.size).reshape(-1, 3)
    order, first, counts = _edges(mesh.faces)
    shared = counts == 2
    one, other = order[first[shared]], order[first[shared] + 1]
    pairs = _corner_pairs(mesh.faces, corners, one, other)
    fans = _joined(pairs, mesh.faces.size)
    unique, new_ids = np.unique(fans, return_inverse=True)
    vertices = mesh.vertices[mesh.faces.ravel()[unique]]
    return Mesh(vertices, new_ids.reshape(-1, 3).astype(np.int64))


def boundary_loops(mesh: Mesh) -> list[IntArray]:
    """Return the vertex indices around every hole, in the winding of the lid that would close it.

    The mesh must be wound consistently, its vertices split where parts merely touch (`split_touching`).
    """
    directed = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    size = len(mesh.vertices)
    is_border = ~np.isin(directed[:, 1] * size + directed[:, 0], directed[:, 0] * size + directed[:, 1])
    successor = {int(b): int(a) for a, b in directed[is_border]}
    loops = []
    while successor:
        loop = [next(iter(successor))]
        while (following := successor.pop(loop[-1])) != loop[0]:
            loop.append(following)
        loops.append(np.array(loop, dtype=np.int64))
    return loops


def _edges(faces: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the half edges (ab of all faces, then bc, ca) ordered by edge, the first of each edge, and its number.

    An edge's half edges are in ascending order.
    """
    tails, heads = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    keys = np.minimum(tails, heads) * (faces.max(initial=0) + 1) + np.maximum(tails, heads)
    order = np.argsort(keys)
    keys = keys[order]
    first = np.flatnonzero(np.diff(keys, prepend=-1))
    counts = np.diff(first, append=len(keys))
    # Where two faces share an edge, sorting may have swapped them.
    pairs = first[counts == 2]
    one, other = order[pairs], order[pairs + 1]
    order[pairs], order[pairs + 1] = np.minimum(one, other), np.maximum(one, other)
    return order, first, counts


def _neighbours(faces: IntArray) -> tuple[IntArray, BoolArray]:
    """Return the (F, 3) face across every edge, -1 at borders, and whether it is wound the same way."""
    count = len(faces)
    order, first, counts = _edges(faces)
    shared = counts == 2
    one, other = order[first[shared]], order[first[shared] + 1]
    begins = np.concatenate([faces[:, 0], faces[:, 1], faces[:, 2]])
    same_way = begins[one] != begins[other]
    across = np.full((count, 3), -1, dtype=np.int64)
    is_same_way = np.zeros((count, 3), dtype=bool)
    for here, there in ((one, other), (other, one)):
        across[here % count, here // count] = there % count
        is_same_way[here % count, here // count] = same_way
    return across, is_same_way


@numba.njit(cache=True)
def _grow(neighbours, is_same_way):  # type: ignore[no-untyped-def]
    """Return the patch of every face and whether it must be turned over, by growing patches face by face."""
    count = len(neighbours)
    ids = np.full(count, -1, np.int64)
    is_flipped = np.zeros(count, np.bool_)
    stack = np.empty(count, np.int64)
    patch = 0
    for seed in range(count):
        if ids[seed] >= 0:
            continue
        ids[seed], stack[0], height = patch, seed, 1
        while height:
            height -= 1
            face = stack[height]
            for side in range(3):
                other = neighbours[face, side]
                if other >= 0 and ids[other] < 0:
                    ids[other] = patch
                    is_flipped[other] = is_flipped[face] if is_same_way[face, side] else not is_flipped[face]
                    stack[height] = other
                    height += 1
        patch += 1
    return ids, is_flipped


def _corner_pairs(faces: IntArray, corners: IntArray, one: IntArray, other: IntArray) -> IntArray:
    """Return the pairs of face corners that two faces share along their common edge."""
    count = len(faces)
    pairs = []
    for end in (0, 1):
        mine = corners[one % count, (one // count + end) % 3]
        begin, finish = (corners[other % count, (other // count + shift) % 3] for shift in (0, 1))
        flat = faces.ravel()
        pairs.append(np.stack([mine, np.where(flat[begin] == flat[mine], begin, finish)], axis=1))
    return np.concatenate(pairs)


def _joined(pairs: IntArray, count: int) -> IntArray:
    """Return a representative of the group that every one of `count` items belongs to."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    links = coo_matrix((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, group = connected_components(links, directed=False)
    _, first = np.unique(group, return_index=True)
    representative: IntArray = first[group]
    return representative
