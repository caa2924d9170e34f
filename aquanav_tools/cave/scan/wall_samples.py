"""Samples of a scanned wall, and what they tell in any unit: how wide passages are, how much is floor and ceiling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array, Mesh, PointCloud

NUM_POINTS = 100_000
"""Points that stand for the wall."""
NUM_ASKED = 1_000
"""Points from which the opposite wall is looked for."""
NUM_NEIGHBOURS = 16
FIRST_STEP = 6.0
"""The look across begins this many spacings off, so that a wall that was scanned twice is passed."""
STEP = 1.15
"""Each step goes so many times as far as the one before."""
CONE = 0.15
"""Wall is met where a point lies this near, shares of the way."""
LEVEL = float(np.cos(np.deg2rad(35.0)))
"""Floor and ceiling are within 35 degrees of level."""


@dataclass(frozen=True, eq=False)
class WallSamples:
    """Points on a scanned wall, in lengths of the scan: numbers of any size would overflow."""

    points: Array
    """(N, 3)"""
    asked: Array
    """(M, 3) a choice of them."""
    normals: Array
    """(M, 3) unit normals there, of either sign."""
    spacing: float
    """Typical distance between neighbours."""
    length: float
    """Of the scan, in its own unit."""


def sample_wall(surface: Mesh | PointCloud) -> WallSamples | None:
    """Return samples of a scanned wall; None where it has hardly a point, no length, or one beyond all numbers."""
    from scipy.spatial import cKDTree

    given = surface.vertices if isinstance(surface, Mesh) else surface.points
    with np.errstate(over="ignore"):
        length = float(np.ptp(given, axis=0).max())
    if not 0.0 < length < np.inf:
        return None
    points = (given - given.min(axis=0)) / length
    points = _on_mesh(Mesh(points, surface.faces)) if isinstance(surface, Mesh) else points
    points = points[:: max(1, len(points) // NUM_POINTS)]
    if len(points) <= NUM_NEIGHBOURS:
        return None
    asked = points[:: max(1, len(points) // NUM_ASKED)]
    distances, neighbours = cKDTree(points).query(asked, k=NUM_NEIGHBOURS)
    around = points[neighbours] - points[neighbours].mean(axis=1, keepdims=True)
    normals = np.linalg.svd(around, full_matrices=False)[2][:, 2]
    return WallSamples(points, asked, normals, float(np.median(distances[:, 4])) / 2.0, length)


def _on_mesh(mesh: Mesh) -> Array:
    """Return (N, 3) points spread evenly over the triangles, always the same."""
    areas = mesh.areas
    if not areas.sum() > 0.0:
        return mesh.vertices
    rng = np.random.default_rng(0)
    faces = rng.choice(len(areas), NUM_POINTS, p=areas / areas.sum())
    weights = rng.dirichlet(np.ones(3), NUM_POINTS)
    points: Array = np.einsum("ni,nij->nj", weights, mesh.triangles[faces])
    return points


def passage_widths(wall: WallSamples) -> Array:
    """Return (N,) distances from wall to wall where one faces another, in the scan's unit; none of a facade."""
    from scipy.spatial import cKDTree

    tree = cKDTree(wall.points)
    starts = np.concatenate([wall.asked, wall.asked])
    ways = np.concatenate([wall.normals, -wall.normals])
    found = np.full(len(starts), np.inf)
    far = FIRST_STEP * wall.spacing
    while 0.0 < far < np.sqrt(3.0):
        waiting = np.flatnonzero(np.isinf(found))
        near = max(CONE * far, wall.spacing)
        nearest, _ = tree.query(starts[waiting] + far * ways[waiting], distance_upper_bound=near)
        found[waiting[np.isfinite(nearest)]] = far
        far *= STEP
    return wall.length * found[np.isfinite(found)]


def floor_shares(wall: WallSamples) -> Array:
    """Return the (3,) shares of the wall that would be floor or ceiling if x, y or z pointed up."""
    shares: Array = (np.abs(wall.normals) > LEVEL).mean(axis=0)
    return shares
