"""Undistorted photos with their poses, and which of them see the same rock from usefully different places."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.types import Array, IntArray

BEST_ANGLE_DEG = 10.0
"""Angle between two rays at which depth is both precise and matchable (measured)."""
WORST_ANGLE_DEG = 45.0
_CANDIDATES = 5
"""Times the sources asked for: views that share most points are often too close."""


@dataclass(frozen=True, eq=False)
class View:
    """An undistorted photo in the world."""

    image_id: int
    name: str
    matrix: Array
    """(3, 3) pinhole camera matrix; pixel centres lie at 0.5."""
    rotation: Array
    """(3, 3) `cam_from_world`."""
    translation: Array
    """(3,) `cam_from_world`, m."""
    width: int
    """px."""
    height: int
    """px."""
    point_ids: IntArray
    """(P,) sorted ids of the sparse points it sees."""
    points: Array
    """(P, 3) those points in the camera's frame, m."""

    @property
    def centre(self) -> Array:
        """(3,) camera centre, world, m."""
        centre: Array = -self.rotation.T @ self.translation
        return centre

    def depth_range(self) -> tuple[float, float]:
        """Return the nearest and farthest depth worth searching, m: that of the sparse points with room to spare."""
        low, high = np.percentile(self.points[:, 2], [1.0, 99.0])
        return 0.5 * float(low), 1.5 * float(high)


def read_views(model: Any) -> list[View]:
    """Return the views of an undistorted pycolmap reconstruction that see at least 4 sparse points."""
    points = {point_id: point.xyz for point_id, point in model.points3D.items()}
    views = []
    for image_id in sorted(model.reg_image_ids()):
        image = model.images[image_id]
        ids = np.unique([p.point3D_id for p in image.points2D if p.has_point3D()]).astype(np.int64)
        if len(ids) < 4:
            continue
        pose = image.cam_from_world().matrix()
        camera = model.cameras[image.camera_id]
        seen = np.array([points[point_id] for point_id in ids.tolist()]) @ pose[:, :3].T + pose[:, 3]
        matrix = camera.calibration_matrix()
        size = (int(camera.width), int(camera.height))
        views.append(View(image_id, image.name, matrix, pose[:, :3], pose[:, 3], *size, ids, seen))
    return views


def rank_sources(views: list[View], num_sources: int) -> list[list[int]]:
    """Return for every view the indices of its best sources, the best first.

    Two views suit each other by the number of points they share, each weighted by the angle between its rays (best
    at BEST_ANGLE_DEG, worthless from WORST_ANGLE_DEG) and by how equal its distances are. Only the views that share
    most points with one are looked at closer, so that many photos take no more time each than few.
    """
    shared = _shared_points(views)
    ranked = []
    for index, view in enumerate(views):
        candidates = np.argsort(-shared[index], kind="stable")[: _CANDIDATES * num_sources]
        scores = {int(j): _suitability(view, views[j]) for j in candidates if shared[index, j] > 0}
        order = sorted(scores, key=lambda j: (-scores[j], j))
        ranked.append([j for j in order if scores[j] > 0.0][:num_sources])
    return ranked


def _shared_points(views: list[View]) -> IntArray:
    """Return (V, V) how many points two views share; none with itself."""
    from scipy.sparse import csr_array

    ids = np.concatenate([view.point_ids for view in views])
    rows = np.repeat(np.arange(len(views)), [len(view.point_ids) for view in views])
    _, columns = np.unique(ids, return_inverse=True)
    sees = csr_array((np.ones(len(ids), np.int64), (rows, columns)))
    shared: IntArray = (sees @ sees.T).toarray()
    np.fill_diagonal(shared, 0)
    return shared


def _suitability(first: View, second: View) -> float:
    _, in_first, in_second = np.intersect1d(first.point_ids, second.point_ids, assume_unique=True, return_indices=True)
    if not len(in_first):
        return 0.0
    one = first.points[in_first] @ first.rotation  # rays in world axes
    two = second.points[in_second] @ second.rotation
    lengths = np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=1)
    angle = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", one, two) / (lengths[0] * lengths[1]), -1.0, 1.0)))
    width = np.where(angle < BEST_ANGLE_DEG, 5.0, 12.0)
    weight = np.exp(-0.5 * ((angle - BEST_ANGLE_DEG) / width) ** 2) * (angle < WORST_ANGLE_DEG)
    return float(np.sum(weight * np.minimum(lengths[0] / lengths[1], lengths[1] / lengths[0])))
