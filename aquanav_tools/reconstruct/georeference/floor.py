"""Which way is up by a floor that is known to be level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.clues import Ups
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array, BoolArray

MAX_TILT = np.deg2rad(35.0)
"""Of the floor against the cameras' mean up direction."""
MIN_SHARE = 0.1
"""Of the points below the cameras that lie on the plane; a floor with fewer is none."""
TRIES = 400
THICKNESS = 0.05
"""Of the plane, in mean distances of the points from the cameras: what counts as lying on it."""
MIN_ERROR = np.deg2rad(1.0)
"""Standard deviation of how level a level floor is; chosen: floors of mines drain."""


@dataclass(frozen=True)
class LevelFloor:
    """The largest plane below the cameras is level."""

    seed: int = 0
    """Of the search."""

    def clue(self, sparse: SparseModel) -> Ups:
        """Return the upward normal of the largest plane below the cameras.

        Raises:
            InputError: there is no plane to speak of.
        """
        points = np.array([point.xyz for point in sparse.model.points3D.values()]).reshape(-1, 3)
        return floor_clue(points, sparse.centres, sparse.rotations, self.seed)


def floor_clue(points: Array, centres: Array, rotations: Array, seed: int) -> Ups:
    """Return the upward normal of the largest plane among (P, 3) points below (N, 3) cameras, as LevelFloor.clue."""
    from scipy.spatial import cKDTree

    up = -rotations[:, 1].mean(axis=0)
    up /= np.linalg.norm(up)
    distances, nearest = cKDTree(centres).query(points)
    is_below = ((points - centres[nearest]) @ up) < -np.sin(np.deg2rad(30.0)) * distances
    below, thickness = points[is_below], THICKNESS * float(np.median(distances))
    on_plane = _largest_plane(below, up, thickness, np.random.default_rng(seed))
    needed = max(20.0, MIN_SHARE * len(below))
    if on_plane.sum() < needed:
        raise InputError(
            f"Of {len(below)} points below the cameras no {needed:.0f} lie on a plane within "
            f"{np.rad2deg(MAX_TILT):.0f} degrees of level: the floor is not flat, or was not photographed. Leave "
            "--level-floor out."
        )
    floor = below[on_plane] - below[on_plane].mean(axis=0)
    _, spread, axes = np.linalg.svd(floor, full_matrices=False)
    # A narrow floor tells its cross slope badly: roughness over half its width.
    error = float(np.hypot(MIN_ERROR, spread[2] / max(spread[1], 1e-12) / np.sqrt(0.1 * len(floor))))
    normal = axes[2] * np.sign(axes[2] @ up)
    return Ups("level floor", ("floor",), normal[None], error)


def _largest_plane(points: Array, up: Array, thickness: float, rng: np.random.Generator) -> BoolArray:
    """Return the (P,) flags of the points on the plane with most of them, of planes near level through three."""
    best: BoolArray = np.zeros(len(points), dtype=bool)
    if len(points) < 3:
        return best
    for _ in range(TRIES):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length <= 0.0 or abs(normal @ up) < np.cos(MAX_TILT) * length:
            continue
        on_plane: BoolArray = np.abs((points - a) @ normal) < 0.5 * thickness * length
        if on_plane.sum() > best.sum():
            best = on_plane
    return best
