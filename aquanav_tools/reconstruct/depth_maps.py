"""The depth maps of a workspace with their cameras, read when they are needed and kept while memory allows."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from aquanav_tools.cave.scan.sight import make_sight
from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.agreement import Map, Pair, Tolerance
from aquanav_tools.reconstruct.depth import depth_path, load_depth
from aquanav_tools.reconstruct.views import View
from aquanav_tools.types import Array

MEMORY_GB = 0.75
"""Of maps that are kept; one of 480 x 360 px takes 3.3 MB."""
BYTES_PER_PIXEL = 19
"""Depth, normal and colour."""
COARSE_STEP = 8
"""Every so many-th pixel of a map is asked which other photos show the same wall."""
COARSE_ERROR = 0.1
"""A photo shows it when it sees wall at that distance, within this share."""
MIN_OVERLAP = 0.01
"""Photos that share less of their pixels than this say nothing about each other."""
MAX_NEIGHBOURS = 32
"""Photos that each one is compared with: those that share most."""


class DepthMaps:
    """The depth maps of some views, without pixels whose matching cost is too large."""

    def __init__(self, folder: Path, views: list[View], max_cost: float) -> None:
        self.views = views
        self._folder, self._max_cost = folder, max_cost
        largest = max((view.width * view.height for view in views), default=1)
        self.read = functools.lru_cache(maxsize=max(int(MEMORY_GB * 1e9 / (BYTES_PER_PIXEL * largest)), 2))(self._read)
        self._coarse, self._pinholes = [], []
        for index, view in enumerate(views):
            depth = self.read(index).depth
            self._coarse.append(depth[COARSE_STEP // 2 :: COARSE_STEP, COARSE_STEP // 2 :: COARSE_STEP])
            self._pinholes.append(_pinhole(view, depth.shape))

    def __len__(self) -> int:
        return len(self.views)

    @property
    def poses(self) -> Array:
        """(C, 3, 4) `cam_from_world`, m."""
        return np.array([np.column_stack([view.rotation, view.translation]) for view in self.views])

    @property
    def pinholes(self) -> Array:
        """(C, 4) fx, fy, cx, cy of the maps, whose size may differ from that of their photos, px."""
        return np.array(self._pinholes)

    def pair(self, first: int, other: int, tolerance: Tolerance) -> Pair:
        """Return two cameras and when their maps agree."""
        one, two = self.views[first], self.views[other]
        turn = two.rotation @ one.rotation.T
        shift = two.translation - turn @ one.translation
        return Pair(self._pinholes[first], self._pinholes[other], np.ascontiguousarray(turn), shift, *tolerance)

    def neighbours(self) -> list[list[int]]:
        """Return for every map the others that show the same wall, those that share most of it first."""
        coarse = make_sight(self.poses, self.pinholes / COARSE_STEP, self._coarse)
        found = []
        for index, (view, depth) in enumerate(zip(self.views, self._coarse, strict=True)):
            rows, columns = np.nonzero(depth > 0.0)
            fx, fy, cx, cy = self._pinholes[index] / COARSE_STEP
            rays = np.column_stack([(columns + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy, np.ones(len(rows))])
            points = (rays * depth[rows, columns][:, None] - view.translation) @ view.rotation
            ahead, seen = coarse.look(points)
            shares = (np.abs(ahead - seen) <= COARSE_ERROR * seen).sum(axis=0) / max(len(points), 1)
            shares[index] = 0.0
            order = np.argsort(-shares, kind="stable")[:MAX_NEIGHBOURS]
            found.append([int(other) for other in order if shares[other] >= MIN_OVERLAP])
        return found

    def _read(self, index: int) -> Map:
        import cv2

        name = self.views[index].name
        stored = load_depth(depth_path(self._folder, name))
        depth = np.where(stored.cost <= self._max_cost, stored.depth, np.float32(0.0)).astype(np.float32)
        picture = cv2.imread(str(self._folder / "images" / name), cv2.IMREAD_COLOR)
        if picture is None:
            raise ReconstructionError(
                f"The undistorted photo {name} cannot be read again. The workspace is damaged: delete it and run again."
            )
        if picture.shape[:2] != depth.shape:
            picture = cv2.resize(picture, depth.shape[::-1], interpolation=cv2.INTER_AREA)
        return Map(depth, np.ascontiguousarray(stored.normals, np.float32), np.ascontiguousarray(picture[..., ::-1]))


def _pinhole(view: View, shape: tuple[int, ...]) -> Array:
    """Return (4,) fx, fy, cx, cy of a view's depth map of a shape, px."""
    across, down, matrix = shape[1] / view.width, shape[0] / view.height, view.matrix
    return np.array([across * matrix[0, 0], down * matrix[1, 1], across * matrix[0, 2], down * matrix[1, 2]])
