"""Fairing: wall that nobody saw continues the curvature of the wall around it.

Across a hole in the wall the sampled surface runs straight from rim to rim. Rock does not: where a hole is wide, that
takes water from a round passage. Water is added until the surface bends least, and none is ever taken away, so that
whatever is known to be water stays water.
"""

from __future__ import annotations

import logging

import numpy as np

from aquanav_tools.geometry.mesh.hole_filling import bending
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

BAND_VOXELS = 8.0
"""Width of the scanned wall around a hole whose shape is continued, voxels ..."""
NOISE_VOXELS = 2.5
"""... without what bends within this length, voxels: the noise of the scan."""
NUM_FAIRINGS = 4
"""The angles that weigh neighbours are those of the shape before, as long as none of its faces vanishes."""
RIM_VOXELS = 2.0
"""Nearer to its rim, a hole moves less, voxels."""
MIN_AREA_SHARE = 1e-3
"""Where faces around a vertex shrink below this share of their area, its angles tell nothing any more. Measured: holes
in tubes and balls 0.06 and more; over a corridor without a ceiling, with doorways, 1e-8, and then no solution. The
volume that is added there is the same from 1e-2 to 1e-5, within 2 %."""
MAX_ROUNDS = 8
HELD_VOXELS = 4.0
"""Around faces that would cross or shrink to nothing, a hole is left as it is within this distance in the next round,
voxels."""


def fair_holes(mesh: Mesh, is_hole: BoolArray, voxel: float) -> Mesh:
    """Return a closed mesh whose holes in the wall bulge as the wall around them does.

    Args:
        mesh: normals out of the water, edges about as long as a voxel.
        is_hole: (F,) the faces that were invented across holes.
        voxel: resolution of the scan, m.
    """
    is_free = np.ones(len(mesh.vertices), dtype=np.bool_)
    is_free[mesh.faces[~is_hole]] = False
    is_held = np.zeros(len(mesh.vertices), dtype=np.bool_)
    for _ in range(MAX_ROUNDS):
        if not is_free.any():
            break
        faired, lost = _fair(mesh, is_free, is_held, voxel)
        if not len(lost):
            crossing = np.unique(self_intersections(faired))
            if not len(crossing):
                return faired
            logger.info("%d faired faces cross wall; holes are left as they are around them", len(crossing))
            lost = np.unique(mesh.faces[crossing])
        is_held |= _near(mesh.vertices, lost, HELD_VOXELS * voxel)
        is_free &= ~is_held
    return mesh


def _fair(mesh: Mesh, is_free: BoolArray, is_held: BoolArray, voxel: float) -> tuple[Mesh, IntArray]:
    """Return the mesh with its free vertices moved out of the water to where the surface bends least.

    The way there fades towards the rim, which stays: the surface is rounded off there. Second come the vertices around
    which faces shrink to nothing on the way; where there are any, the mesh is as it was.
    """
    from scipy.spatial import cKDTree

    bent, lost = _least_bent(mesh, is_free, is_held, voxel)
    if len(lost):
        return mesh, lost
    moves = bent - mesh.vertices
    normals = np.asarray(mesh.to_trimesh().vertex_normals)
    inwards = np.minimum(np.einsum("ij,ij->i", moves, normals), 0.0)
    from_rim = np.zeros(len(mesh.vertices))
    from_rim[is_free] = cKDTree(mesh.vertices[~is_free]).query(mesh.vertices[is_free])[0]
    share = np.minimum(from_rim / (RIM_VOXELS * voxel), 1.0)
    return Mesh(mesh.vertices + share[:, None] * (moves - inwards[:, None] * normals), mesh.faces), lost


def _least_bent(mesh: Mesh, is_free: BoolArray, is_held: BoolArray, voxel: float) -> tuple[Array, IntArray]:
    """Return the (V, 3) vertices, the free ones where the surface bends least, and those around which faces vanished.

    The wall around them is held in its place as by springs, which give way to its bending within the length of noise;
    where it is held altogether, it does not.
    """
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    is_bent = _near(mesh.vertices, np.flatnonzero(is_free), BAND_VOXELS * voxel) & ~is_held
    used, local = np.unique(mesh.faces[is_bent[mesh.faces].any(axis=1)], return_inverse=True)
    part = Mesh(mesh.vertices[used], local.reshape(-1, 3).astype(np.int64))
    is_free, is_bent = is_free[used], is_bent[used]
    areas = _areas_around(part)
    springs = np.where(is_free, 0.0, areas / (NOISE_VOXELS * voxel) ** 4)
    positions, lost = part.vertices, used[:0]
    for number in range(NUM_FAIRINGS):
        form = bending(Mesh(positions, part.faces), is_bent) + sparse.diags(springs)
        pull = (springs[:, None] * part.vertices)[is_bent] - form[is_bent][:, ~is_bent] @ part.vertices[~is_bent]
        moved = part.vertices.copy()
        moved[is_bent] = spsolve(form[is_bent][:, is_bent].tocsc(), pull)
        is_sound = _areas_around(Mesh(moved, part.faces)) >= MIN_AREA_SHARE * areas  # not where there is no solution
        vanished = used[is_bent & ~is_sound]
        if len(vanished):
            lost = lost if number else vanished
            break
        positions = moved
    faired = mesh.vertices.copy()
    faired[used[is_free]] = positions[is_free]
    return faired, lost


def _areas_around(mesh: Mesh) -> Array:
    """Return the (V,) thirds of the area of the faces around each vertex, m^2."""
    shares = np.repeat(mesh.areas / 3.0, 3)
    return np.asarray(np.bincount(mesh.faces.ravel(), shares, minlength=len(mesh.vertices)), dtype=np.float64)


def _near(vertices: Array, chosen: IntArray, distance: float) -> BoolArray:
    """Return the (V,) flags of vertices within a distance (m) of chosen ones."""
    from scipy.spatial import cKDTree

    near: BoolArray = np.isfinite(cKDTree(vertices[chosen]).query(vertices, distance_upper_bound=distance)[0])
    return near
