"""Fairing: wall that nobody saw continues the curvature of the wall around it.

Across a hole in the wall the sampled surface runs straight from rim to rim. Rock does not: where a hole is wide, that
takes water from a round passage. Water is added until the surface bends least, and none is ever taken away, so that
whatever is known to be water stays water.
"""

from __future__ import annotations

import logging

import numpy as np

from aquanav_tools.cave.mesh.hole_filling import bending
from aquanav_tools.cave.mesh.intersections import self_intersections
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

BAND_VOXELS = 8.0
"""Width of the scanned wall around a hole whose shape is continued, voxels ..."""
NOISE_VOXELS = 2.5
"""... without what bends within this length, voxels: the noise of the scan."""
NUM_FAIRINGS = 4
"""The angles that weigh neighbours are those of the shape before."""
RIM_VOXELS = 2.0
"""Nearer to its rim, a hole moves less, voxels."""
MAX_ROUNDS = 4
HELD_VOXELS = 4.0
"""Around faces that would cross, a hole is left as it is within this distance in the next round, voxels."""


def fair_holes(mesh: Mesh, is_hole: BoolArray, voxel: float) -> Mesh:
    """Return a closed mesh whose holes in the wall bulge as the wall around them does.

    Args:
        mesh: normals out of the water, edges about as long as a voxel.
        is_hole: (F,) the faces that were invented across holes.
        voxel: resolution of the scan, m.
    """
    is_free = np.ones(len(mesh.vertices), dtype=np.bool_)
    is_free[mesh.faces[~is_hole]] = False
    for _ in range(MAX_ROUNDS):
        if not is_free.any():
            break
        faired = _fair(mesh, is_free, voxel)
        if not np.isfinite(faired.vertices).all():
            logger.warning("Wall around holes has faces without area; the holes stay straight from rim to rim")
            break
        crossing = np.unique(self_intersections(faired))
        if not len(crossing):
            return faired
        logger.info("%d faired faces cross wall; holes are left as they are around them", len(crossing))
        is_free &= ~_near(mesh.vertices, np.unique(mesh.faces[crossing]), HELD_VOXELS * voxel)
    return mesh


def _fair(mesh: Mesh, is_free: BoolArray, voxel: float) -> Mesh:
    """Return the mesh with its free vertices moved out of the water to where the surface bends least.

    The way there fades towards the rim, which stays: the surface is rounded off there.
    """
    from scipy.spatial import cKDTree

    moves = _least_bent(mesh, is_free, voxel) - mesh.vertices
    normals = np.asarray(mesh.to_trimesh().vertex_normals)
    inwards = np.minimum(np.einsum("ij,ij->i", moves, normals), 0.0)
    from_rim = np.zeros(len(mesh.vertices))
    from_rim[is_free] = cKDTree(mesh.vertices[~is_free]).query(mesh.vertices[is_free])[0]
    share = np.minimum(from_rim / (RIM_VOXELS * voxel), 1.0)
    return Mesh(mesh.vertices + share[:, None] * (moves - inwards[:, None] * normals), mesh.faces)


def _least_bent(mesh: Mesh, is_free: BoolArray, voxel: float) -> Array:
    """Return the (V, 3) vertices, the free ones where the surface bends least.

    The wall around them is held in its place as by springs, which give way to its bending within the length of noise.
    """
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    is_bent = _near(mesh.vertices, np.flatnonzero(is_free), BAND_VOXELS * voxel)
    used, local = np.unique(mesh.faces[is_bent[mesh.faces].any(axis=1)], return_inverse=True)
    part = Mesh(mesh.vertices[used], local.reshape(-1, 3).astype(np.int64))
    is_free, is_bent = is_free[used], is_bent[used]
    areas = np.bincount(part.faces.ravel(), np.repeat(part.areas / 3.0, 3), minlength=len(used))
    springs = np.where(is_free, 0.0, areas / (NOISE_VOXELS * voxel) ** 4)
    positions = part.vertices.copy()
    for _ in range(NUM_FAIRINGS):
        form = bending(Mesh(positions, part.faces), is_bent) + sparse.diags(springs)
        pull = (springs[:, None] * part.vertices)[is_bent] - form[is_bent][:, ~is_bent] @ part.vertices[~is_bent]
        positions[is_bent] = spsolve(form[is_bent][:, is_bent].tocsc(), pull)
    faired = mesh.vertices.copy()
    faired[used[is_free]] = positions[is_free]
    return faired


def _near(vertices: Array, chosen: IntArray, distance: float) -> BoolArray:
    """Return the (V,) flags of vertices within a distance (m) of chosen ones."""
    from scipy.spatial import cKDTree

    near: BoolArray = np.isfinite(cKDTree(vertices[chosen]).query(vertices, distance_upper_bound=distance)[0])
    return near
