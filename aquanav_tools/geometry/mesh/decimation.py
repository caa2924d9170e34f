"""Fewer triangles for the same surface, none of which cross."""

from __future__ import annotations

import logging

import numpy as np

from aquanav_tools.geometry.mesh.box_tree import boxes_of
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.geometry.mesh.proximity import are_within, surface_tree
from aquanav_tools.types import BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

MAX_ROUNDS = 4
PROTECTED_TOLERANCES = 10.0
"""Wall within this many tolerances of faces that cross is left as it is in the next round."""


def simplify(mesh: Mesh, tolerance: float, labels: IntArray | None = None) -> Mesh:
    """Return a closed mesh with triangles merged where that moves it by about `tolerance` (m), none crossing.

    A merger moves the surface by no more than the tolerance, and in one place they add up to more than that (measured:
    twice). Where merged faces would cross, the wall is left as it is and the rest merged anew. Coordinates are rounded
    to 32-bit floats, which is what a scenario keeps. Where faces have (F,) labels, the rims between these stay.
    """
    names = np.zeros(len(mesh.faces), dtype=np.int64) if labels is None else labels
    single = names.max() + 1 + np.arange(len(mesh.faces))
    is_protected = np.zeros(len(mesh.faces), dtype=np.bool_)
    for _ in range(MAX_ROUNDS):
        merged = merge_faces(mesh, np.where(is_protected, single, names), tolerance)
        crossing = np.unique(self_intersections(merged))
        if not len(crossing):
            return merged
        logger.info("%d merged faces cross; the wall around them is left as it is", len(crossing))
        is_protected |= faces_near(mesh, merged, crossing, PROTECTED_TOLERANCES * tolerance)
    return as_stored(mesh)


def merge_faces(mesh: Mesh, labels: IntArray, tolerance: float) -> Mesh:
    """Return the largest piece of a closed mesh with triangles of the same label merged, by up to `tolerance` (m).

    Rims between labels only lose vertices that lie on straight lines. All vertices are the mesh's own, rounded to 32
    bits.
    """
    import manifold3d

    order = np.argsort(labels, kind="stable")
    names, counts = np.unique(labels, return_counts=True)
    first = manifold3d.Manifold.reserve_ids(len(names))
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(mesh.vertices),
            tri_verts=mesh.faces[order].astype(np.uint64),
            run_index=np.concatenate([[0], 3 * np.cumsum(counts)]).astype(np.uint64),
            run_original_id=np.arange(first, first + len(names), dtype=np.uint32),
        )
    )
    merged = max(solid.simplify(tolerance).decompose(), key=lambda piece: piece.volume()).to_mesh64()
    return as_stored(Mesh(np.array(merged.vert_properties)[:, :3], np.array(merged.tri_verts, dtype=np.int64)))


def faces_near(mesh: Mesh, other: Mesh, faces: IntArray, distance: float) -> BoolArray:
    """Return the (F,) flags of a mesh's faces that lie at some faces of another mesh.

    That is those with a corner or their middle within `distance` (m), and the nearest one to each however large.
    """
    import igl

    is_near = np.zeros(len(mesh.faces), dtype=np.bool_)
    if not len(faces):
        return is_near
    corners, some = mesh.triangles, Mesh(other.vertices, other.faces[faces])
    tree = surface_tree(some)
    is_near |= are_within(tree, corners.mean(axis=1), distance)
    is_near |= are_within(tree, mesh.vertices, distance)[mesh.faces].any(axis=1)
    low, high = boxes_of(corners)
    around = some.triangles.reshape(-1, 3)
    may_be = ((low <= around.max(axis=0) + distance) & (high >= around.min(axis=0) - distance)).all(axis=1)
    candidates = np.flatnonzero(may_be) if may_be.any() else np.arange(len(mesh.faces))
    middles = some.triangles.mean(axis=1)
    _, nearest, _ = igl.point_mesh_squared_distance(middles, mesh.vertices, mesh.faces[candidates])
    is_near[candidates[nearest]] = True
    return is_near


def as_stored(mesh: Mesh) -> Mesh:
    """Return the mesh with the float32 coordinates that a scenario keeps: what is proven is what is read back."""
    return Mesh(mesh.vertices.astype(np.float32).astype(np.float64), mesh.faces)
