"""What cameras saw: how far each looked along its pixels, and so which space is water.

Between a camera and the wall that it saw lies water. Nothing is painted into a grid: a point is projected into every
camera, and its distance compared with the one that was seen there. So memory is that of coarse depth maps, no gaps open
between rays far from a camera, and whoever asks pays only for the places asked about.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array, BoolArray, IntArray, Sim3

DepthImage = npt.NDArray[np.float32]

NO_WALL = np.float32(0.0)
"""Depth of a cell that looked and found no wall."""
UNSURE = np.float32(1e-9)
"""Depth of a cell that is neither sure of a wall nor of none: right before the lens, it claims no water."""
OUTSIDE = np.float32(-1.0)
"""Depth beside a photo, where maps of different sizes are padded."""
MIN_WALL_SHARE = 0.5
"""A cell shows wall when at least this share of its pixels do ..."""
MAX_WALL_SHARE = 0.1
"""... and none when at most this share do."""
RELATIVE_MARGIN = 0.02
"""Depths that photos agree on differ by no more than this share; what lies farther before the wall is water."""
NEAREST = 1e-3
"""What is nearer to a lens is not looked at, m."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Coarse depth maps of C photos, with their cameras (undistorted, so pinholes)."""

    poses: Array
    """(C, 3, 4) `cam_from_world`, rotation and translation, m."""
    pinholes: Array
    """(C, 4) fx, fy, cx, cy of the maps, in their cells; cell centres lie at 0.5."""
    depth: DepthImage
    """(C, H, W) along the camera's axis, m, of wall that several photos agree on; or NO_WALL, UNSURE, OUTSIDE."""

    @property
    def centres(self) -> Array:
        """(C, 3) where the cameras were, m."""
        centres: Array = -np.einsum("cji,cj->ci", self.poses[:, :, :3], self.poses[:, :, 3])
        return centres

    def moved(self, b_from_a: Sim3) -> Sight:
        """Return the same in another frame."""
        turns = self.poses[:, :, :3] @ b_from_a.rotation.T
        shifts = b_from_a.scale * self.poses[:, :, 3] - turns @ b_from_a.translation
        depth = np.where(self.depth > UNSURE, np.float32(b_from_a.scale) * self.depth, self.depth)
        return Sight(np.concatenate([turns, shifts[..., None]], axis=2), self.pinholes, depth)

    def near(self, low: Array, high: Array) -> Sight:
        """Return the sight of the cameras that may have seen something in the box from (3,) low to (3,) high, m."""
        fx, fy, cx, cy = self.pinholes.T
        across, down = np.maximum(cx, self.depth.shape[2] - cx) / fx, np.maximum(cy, self.depth.shape[1] - cy) / fy
        reach = self.depth.max(axis=(1, 2), initial=0.0) * np.sqrt(1.0 + across**2 + down**2)
        centres = self.centres
        distance = np.linalg.norm(np.maximum(np.maximum(low - centres, centres - high), 0.0), axis=1)
        is_near = distance <= reach
        return Sight(self.poses[is_near], self.pinholes[is_near], self.depth[is_near])

    def votes(self, points: Array, margin: float) -> IntArray:
        """Return (N, 2) how many cameras looked through each of (N, 3) points at wall behind it, and show wall there.

        Args:
            points: world, m.
            margin: beside RELATIVE_MARGIN of the distance, how far wall lies before or behind a point, along the
                camera's axis, to be wall there and not elsewhere, m.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        return _votes(points, self.poses, self.pinholes, self.depth, margin)

    def look(self, points: Array) -> tuple[Array, DepthImage]:
        """Return the (N, C) distances of (N, 3) points along each camera's axis, m, and the depths seen there.

        Depth is that of the cell that a point falls in; OUTSIDE when it is not in the frame.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        return _look(points, self.poses, self.pinholes, self.depth)


def believed(sight: Sight, is_wall: Callable[[Array], BoolArray]) -> Sight:
    """Return the same without wall that is none: cells that show it claim no water.

    Args:
        sight: what cameras saw.
        is_wall: tells of (N, 3) places, m, which lie on wall.
    """
    depth = sight.depth.copy()
    for pose, (fx, fy, cx, cy), seen in zip(sight.poses, sight.pinholes, depth, strict=True):
        rows, columns = np.nonzero(seen > UNSURE)
        ahead = seen[rows, columns].astype(np.float64)
        rays = np.stack([(columns + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy, np.ones(len(rows))], axis=1)
        is_none = ~is_wall((ahead[:, None] * rays - pose[:, 3]) @ pose[:, :3])
        seen[rows[is_none], columns[is_none]] = UNSURE
    return Sight(sight.poses, sight.pinholes, depth)


def coarse_depth(depth: DepthImage, step: int) -> DepthImage:
    """Return an (H, W) depth map (0: no wall found) `step` times as coarse that claims no more water than it did.

    A cell shows the nearest wall of its pixels.
    """
    height, width = depth.shape[0] // step, depth.shape[1] // step
    cells = depth[: height * step, : width * step].reshape(height, step, width, step)
    share = (cells > 0.0).mean(axis=(1, 3))
    nearest = np.where(cells > 0.0, cells, np.inf).min(axis=(1, 3))
    coarse = np.where(share >= MIN_WALL_SHARE, nearest, np.where(share <= MAX_WALL_SHARE, NO_WALL, UNSURE))
    return coarse.astype(np.float32)


def make_sight(poses: Array, pinholes: Array, maps: list[DepthImage]) -> Sight:
    """Return the sight of cameras (see `Sight`), whose C maps may differ in size."""
    height, width = np.max([one.shape for one in maps], axis=0)
    depth = np.full((len(maps), height, width), OUTSIDE, dtype=np.float32)
    for padded, one in zip(depth, maps, strict=True):
        padded[: one.shape[0], : one.shape[1]] = one
    return Sight(np.ascontiguousarray(poses, np.float64), np.ascontiguousarray(pinholes, np.float64), depth)


@numba.njit(cache=True, error_model="numpy")
def _look_up(x, y, z, pose, pinhole, depth):  # type: ignore[no-untyped-def]
    """Return a point's distance along a camera's axis, and the depth seen there."""
    ahead = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
    if ahead < NEAREST:
        return ahead, OUTSIDE
    right = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
    u = pinhole[0] * right / ahead + pinhole[2]
    if not 0.0 <= u < depth.shape[1]:
        return ahead, OUTSIDE
    down = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
    v = pinhole[1] * down / ahead + pinhole[3]
    if not 0.0 <= v < depth.shape[0]:
        return ahead, OUTSIDE
    return ahead, depth[int(v), int(u)]


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _votes(points, poses, pinholes, depth, margin):  # type: ignore[no-untyped-def]
    votes = np.zeros((len(points), 2), np.int64)
    for n in numba.prange(len(points)):
        for camera in range(len(poses)):
            x, y, z = points[n]
            ahead, seen = _look_up(x, y, z, poses[camera], pinholes[camera], depth[camera])
            if seen > 0.0:
                excess, accuracy = seen - ahead, ahead * RELATIVE_MARGIN + margin
                if excess > accuracy:
                    votes[n, 0] += 1
                elif excess >= -accuracy:
                    votes[n, 1] += 1
    return votes


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _look(points, poses, pinholes, depth):  # type: ignore[no-untyped-def]
    ahead = np.empty((len(points), len(poses)))
    seen = np.empty((len(points), len(poses)), np.float32)
    for n in numba.prange(len(points)):
        for camera in range(len(poses)):
            x, y, z = points[n]
            ahead[n, camera], seen[n, camera] = _look_up(x, y, z, poses[camera], pinholes[camera], depth[camera])
    return ahead, seen
