"""One cloud from many depth maps: the points that several photos agree on, and which space the cameras looked through.

A pixel is sure when another photo's pixel agrees with it in depth, place and normal. Photo by photo, every sure pixel
that is not part of a point yet becomes one: its depth is the mean of what all photos that agree say about its ray,
weighted by how precise each is. It is dropped where as many photos saw wall behind it. The result is the same for any
number of threads, and memory is that of the maps that overlap, not of all.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.scan.sight import Sight, coarse_depth, make_sight
from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.agreement import SURE, UNSURE, USED, Map, Tolerance, confirm, gather, mark
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.depth import depth_path
from aquanav_tools.reconstruct.depth_maps import DepthMaps
from aquanav_tools.reconstruct.views import read_views
from aquanav_tools.types import Array, BoolArray, PointCloud, Progress, ignore_progress

SIGHT_WIDTH = 240
"""Maps are made coarse to about this width for what they tell about free space, px: 1.5 cm at 2 m."""


@dataclass(frozen=True)
class FusionOptions:
    """When depth maps agree."""

    max_cost: float = 0.5
    """Pixels with a larger matching cost (1 - NCC) are dropped first."""
    min_photos: int = 2
    """Photos that must agree on a point, its own included."""
    max_reprojection_px: float = 3.0
    """Largest offset between their pixels."""
    max_depth_error: float = 0.02
    """Largest relative difference of their depths."""
    max_normal_deg: float = 60.0
    """Largest angle between their normals."""
    step: int = 2
    """Every so many-th pixel along rows and columns may become a point; the others only confirm."""

    def __post_init__(self) -> None:
        if not 0 < self.max_cost <= 2 or self.min_photos < 2:
            raise ValueError(f"FusionOptions needs max_cost in (0, 2] and min_photos >= 2, got {self}.")
        if min(self.max_reprojection_px, self.max_depth_error, self.max_normal_deg) <= 0:
            raise ValueError(f"FusionOptions needs positive tolerances, got {self}.")

    @property
    def tolerance(self) -> Tolerance:
        """The same for the inner loops."""
        return Tolerance(self.max_reprojection_px, self.max_depth_error, float(np.cos(np.deg2rad(self.max_normal_deg))))


@dataclass(frozen=True, eq=False)
class _Cells:
    """What is known of the cells of a map."""

    state: npt.NDArray[np.uint8]
    """(h, w) UNSURE, SURE or USED."""
    sure: npt.NDArray[np.float32]
    """(h, w) depth, m; 0 where unsure."""


@dataclass(frozen=True, eq=False)
class FusedDepth:
    """What the depth maps of all photos say together."""

    cloud: PointCloud
    """Points on the wall, with normals towards the cameras, colours, and how many photos agree on each."""
    sight: Sight
    """How far each camera looked: wall that is sure only."""


def fuse_depth(
    folder: Path, depth_paths: list[Path], options: FusionOptions, progress: Progress = ignore_progress
) -> FusedDepth:
    """Return the points that the depth maps of an undistorted workspace agree on, and what was seen through.

    Raises:
        ReconstructionError: no point is confirmed by a second photo.
    """
    views = read_views(load_pycolmap().Reconstruction(folder / "sparse"))
    kept = set(depth_paths)
    maps = DepthMaps(folder, [view for view in views if depth_path(folder, view.name) in kept], options.max_cost)
    fused = fuse_maps(maps, options, progress)
    if not len(fused.cloud.points):
        raise ReconstructionError(
            f"The depth maps of {len(depth_paths)} photos agree on no point. The rock lacks texture or the poses are "
            "wrong. Take sharper, better lit photos closer to each other."
        )
    return fused


def fuse_maps(maps: DepthMaps, options: FusionOptions, progress: Progress = ignore_progress) -> FusedDepth:
    """Return the points that depth maps agree on, perhaps none, and what was seen through."""
    neighbours = maps.neighbours()
    cells = []
    for index in range(len(maps)):
        cells.append(_confirm(maps, index, neighbours[index], options))
        progress(index + 1, 2 * len(maps))
    clouds = []
    for index in range(len(maps)):
        clouds.append(_fuse_one(maps, index, neighbours[index], cells, options))
        progress(len(maps) + index + 1, 2 * len(maps))
    step = max(round(max(one.sure.shape[1] for one in cells) / SIGHT_WIDTH), 1)
    coarse = [coarse_depth(one.sure, step) for one in cells]
    return FusedDepth(_joined(clouds), make_sight(maps.poses, maps.pinholes / (step * options.step), coarse))


def _confirm(maps: DepthMaps, index: int, neighbours: list[int], options: FusionOptions) -> _Cells:
    """Return the cells of a map, those SURE with which enough others agree."""
    first, wanted = maps.read(index), options.min_photos - 1
    depth = first.depth[options.step // 2 :: options.step, options.step // 2 :: options.step]
    count = np.zeros(depth.shape, np.int32)
    for other in neighbours:
        confirm(first, maps.read(other), maps.pair(index, other, options.tolerance), options.step, wanted, count)
    is_sure = count >= wanted
    return _Cells(np.where(is_sure, SURE, UNSURE).astype(np.uint8), np.where(is_sure, depth, np.float32(0.0)))


def _fuse_one(
    maps: DepthMaps, index: int, neighbours: list[int], cells: list[_Cells], options: FusionOptions
) -> PointCloud:
    """Return the points on the rays of one photo's unused cells, and mark the cells of others that show them."""
    first, state, step = maps.read(index), cells[index].state, options.step
    sums, count, against = _own_sums(first, step), np.ones(state.shape, np.int32), np.zeros(state.shape, np.int32)
    pairs = [(other, maps.pair(index, other, options.tolerance)) for other in neighbours]
    for other, pair in pairs:
        gather(first, maps.read(other), pair, step, state, cells[other].sure, sums, count, against)
    is_point = (state == SURE) & (count >= options.min_photos) & (against < count)
    means = sums / sums[..., :1]
    fused = np.where(is_point, means[..., 1], 0.0)
    for other, pair in pairs:
        mark(fused, cells[other].sure, pair, step, cells[other].state)
    state[is_point] = USED
    return _points(maps, index, is_point, means, count, step)


def _own_sums(one: Map, step: int) -> npt.NDArray[np.float64]:
    """Return the (h, w, NUM_SUMS) sums over a map itself."""
    middle = np.s_[step // 2 :: step, step // 2 :: step]
    depth = np.where(one.depth[middle] > 0.0, one.depth[middle], 1.0).astype(np.float64)
    powers = np.stack([np.ones_like(depth), depth, depth**2], axis=2)
    parts: list[Any] = [powers, one.normals[middle], one.colours[middle]]
    return np.asarray(np.concatenate(parts, axis=2) / depth[..., None] ** 4)


def _points(
    maps: DepthMaps, index: int, is_point: BoolArray, means: Array, count: npt.NDArray[np.int32], step: int
) -> PointCloud:
    """Return the points at some cells of a map, from the (h, w, NUM_SUMS) means over the photos that agree there."""
    view, (fx, fy, cx, cy) = maps.views[index], maps.pinholes[index]
    i, j = np.nonzero(is_point)
    means = means[i, j]
    right, down = step * j + step // 2 + 0.5 - cx, step * i + step // 2 + 0.5 - cy
    rays = np.column_stack([right / fx, down / fy, np.ones(len(i))])
    normals = means[:, 3:6] @ view.rotation
    return PointCloud(
        (rays * means[:, 1:2] - view.translation) @ view.rotation,
        normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9),
        np.rint(means[:, 6:9]).astype(np.uint8),
        count[i, j].astype(np.int64),
        np.linalg.norm(rays, axis=1) * np.sqrt(np.maximum(means[:, 2] - means[:, 1] ** 2, 0.0)),
    )


def _joined(clouds: list[PointCloud]) -> PointCloud:
    def joined(field: str) -> Any:
        return np.concatenate([getattr(cloud, field) for cloud in clouds])

    return PointCloud(*(joined(field) for field in ("points", "normals", "colours", "num_photos", "spread")))
