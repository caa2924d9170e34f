"""What a depth camera saw beside the photos: a reference for real rooms, as points on their walls and as free space.

A depth camera sees a part of the room and sees it with centimetres of noise, so what it did not look at judges nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools.cave.scan.sight import Sight, coarse_depth, make_sight
from aquanav_tools.types import Array, BoolArray, IntArray, Sim3
from eval.photos.score import TOLERANCES, CloudScore, similarity

CELL = 0.02
"""The reference has one point per cell of this size, m ..."""
MIN_MAPS = 3
"""... where this many depth maps or more have one."""
PIXEL_STEP, SIGHT_STEP = 2, 4
"""Every second pixel becomes a point; lines of sight are those of a map a quarter as wide and high."""
MAX_DEPTH = 4.0
"""Beyond this a Kinect errs by more than 4 cm (Khoshelham and Elberink, 2012: 1.4e-3 /m * distance^2 twice over), m."""
MARGIN = 0.05
"""How far before a wall that a map shows space is surely free, beside 2 % of the distance, m."""
FREE_SPACING = 0.05
"""Of the lattice on which free space is measured, m."""
MIN_FREE_MAPS = 2
"""A place is free when this many maps look through it, and more than show wall there."""
ICP_ROUNDS, ICP_REACH, ICP_SAMPLES = 30, 0.15, 20_000


@dataclass(frozen=True, eq=False)
class DepthReference:
    """A room as its depth camera saw it."""

    points: Array
    """(N, 3) on its walls, one per cell, m."""
    centres: dict[str, Array]
    """(3,) where each photo was taken, by its name, m."""
    sight: Sight
    """How far each map looks."""


def depth_centres(folder: Path) -> dict[str, Array]:
    """Return where the depth camera was at each photo, by the photo's name, m; see `read_depth_reference`."""
    return {
        f"{path.name.removesuffix('.pose.txt')}.color.jpg": np.loadtxt(path)[:3, 3]
        for path in sorted((folder / "truth").glob("*.pose.txt"))
    }


def read_depth_reference(folder: Path) -> DepthReference:
    """Return the reference of a folder with `truth/`: camera-intrinsics.txt, and per photo a pose and a depth map.

    Poses are `world_from_cam` of the depth camera, depths millimetres in 16 bits, 0 for none (7-Scenes' format).
    """
    from PIL import Image

    truth = folder / "truth"
    fx, _, cx, _, fy, cy, *_ = np.loadtxt(truth / "camera-intrinsics.txt").ravel()
    cells, centres, poses, maps = [], {}, [], []
    for path in sorted(truth.glob("*.depth.png")):
        name = path.name.removesuffix(".depth.png")
        pose = np.loadtxt(truth / f"{name}.pose.txt")
        depth = np.asarray(Image.open(path), np.float32) / 1000.0
        depth[depth > MAX_DEPTH] = 0.0
        v, u = np.nonzero(depth[::PIXEL_STEP, ::PIXEL_STEP])
        z = depth[::PIXEL_STEP, ::PIXEL_STEP][v, u].astype(np.float64)
        rays = np.column_stack([(PIXEL_STEP * u + 0.5 - cx) / fx, (PIXEL_STEP * v + 0.5 - cy) / fy, np.ones(len(z))])
        seen = (rays * z[:, None]) @ pose[:3, :3].T + pose[:3, 3]
        cells.append(_means_by_cell(seen)[0])
        centres[f"{name}.color.jpg"] = pose[:3, 3]  # of the depth camera, some centimetres beside the colour camera
        poses.append(np.column_stack([pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]]))
        maps.append(coarse_depth(depth, SIGHT_STEP))
    points, counts = _means_by_cell(np.concatenate(cells))
    pinhole = np.array([fx, fy, cx, cy]) / SIGHT_STEP
    sight = make_sight(np.array(poses), np.tile(pinhole, (len(poses), 1)), maps)
    return DepthReference(points[counts >= MIN_MAPS], centres, sight)


def _means_by_cell(points: Array) -> tuple[Array, IntArray]:
    """Return the (C, 3) mean points of the cells that (N, 3) points lie in, and how many each cell has."""
    places = np.floor(points / CELL).astype(np.int64)
    places -= places.min(axis=0)
    keys = np.ravel_multi_index(tuple(places.T), tuple(places.max(axis=0) + 1))  # sorts faster than rows
    _, cell, counts = np.unique(keys, return_inverse=True, return_counts=True)
    sums = np.column_stack([np.bincount(cell, weights=axis) for axis in points.T])
    return sums / counts[:, None], counts


def refined(points: Array, reference: Array, start: Sim3) -> Sim3:
    """Return the Sim3 that lays a cloud onto reference points, from one that nearly does (iterated closest points).

    Args:
        points: (N, 3) in any frame.
        reference: (M, 3) m.
        start: from the points' frame, right to ICP_REACH.
    """
    tree, found = cKDTree(reference), start
    sample = points[:: max(1, len(points) // ICP_SAMPLES)]
    for _ in range(ICP_ROUNDS):
        distance, nearest = tree.query(found.apply(sample), distance_upper_bound=ICP_REACH)
        is_near = np.isfinite(distance)
        found = similarity(sample[is_near], reference[nearest[is_near]])
    return found


def is_judged(reference: DepthReference, points: Array) -> BoolArray:
    """Return (N,) which of (N, 3) points lie where enough depth maps for the reference show wall or look through, m."""
    return np.asarray(reference.sight.votes(points, MARGIN).sum(axis=1) >= MIN_MAPS, dtype=bool)


def score_against(
    reference: DepthReference, points: Array, tolerances: tuple[float, ...] = TOLERANCES
) -> list[CloudScore]:
    """Return how (N, 3) points fit the reference, those of them that the depth camera can judge, m."""
    judged = points[is_judged(reference, points)]
    to_wall, _ = cKDTree(reference.points).query(judged)
    to_cloud, _ = cKDTree(points).query(reference.points)
    return [
        CloudScore(tolerance, float(np.mean(to_wall <= tolerance)), float(np.mean(to_cloud <= tolerance)))
        for tolerance in tolerances
    ]


def is_free(reference: DepthReference, places: Array) -> BoolArray:
    """Return (N,) which of (N, 3) places the depth camera looked through, m."""
    through, at = reference.sight.votes(places, MARGIN).T
    return np.asarray((through >= MIN_FREE_MAPS) & (through > at), dtype=bool)


def lattice(low: Array, high: Array) -> Array:
    """Return the (N, 3) places of a lattice of FREE_SPACING in the box from (3,) low to (3,) high, m."""
    axes = [np.arange(start, stop, FREE_SPACING) for start, stop in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
