"""What the stages leave for the report, in plain arrays: matches, cameras and points, depth maps.

The report's rooms know neither pycolmap nor the folders of the workspace.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.depth import DepthMap, depth_path, load_depth
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.intake.names import name_of
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.reconstruct.matching import verified_matches
from aquanav_tools.types import Array, IntArray

Colours = npt.NDArray[np.uint8]
WIDEST_TRACK = 64
"""Photos of a point beyond this are not looked at for its angle: it is wide by then."""


@dataclass
class PhotoRecord:
    """Where the stages left what there is to show, filled as they end: a run that stops shows how far it came."""

    photos: PhotoSet | None = None
    """As prepared for the stages."""
    database: Path | None = None
    """Keypoints and matches, once all pairs are compared."""
    sparse: SparseModel | None = None
    dense_dir: Path | None = None
    """The undistorted photos with their model."""
    depth_paths: list[Path] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class SparseRecord:
    """Cameras and sparse points in frame sfm, which has no scale."""

    names: tuple[str, ...]
    """C registered photos, in the order they were placed in where that is known, else in the order of their ids."""
    is_order_known: bool
    centres: Array
    """(C, 3) of the cameras."""
    rotations: Array
    """(C, 3, 3) `cam_from_sfm`; camera x right, y down, z ahead."""
    points: Array
    """(P, 3)."""
    colours: Colours
    """(P, 3)."""
    observations: IntArray
    """(O, 2) rows of point and camera: who sees what."""
    residuals_px: Array
    """(O,) distance from where a point is seen to where it should be, px of the photo."""

    @property
    def track_lengths(self) -> IntArray:
        """(P,) photos that see each point."""
        return np.bincount(self.observations[:, 0], minlength=len(self.points))

    @property
    def point_errors_px(self) -> Array:
        """(P,) mean reprojection error of each point."""
        return self._means(0, len(self.points))

    @property
    def photo_errors_px(self) -> Array:
        """(C,) mean reprojection error in each photo."""
        return self._means(1, len(self.names))

    @property
    def angles_deg(self) -> Array:
        """(P,) the widest angle between two rays to each point."""
        order = np.argsort(self.observations[:, 0], kind="stable")
        point, camera = self.observations[order].T
        rays = self.points[point] - self.centres[camera]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        lengths = self.track_lengths
        first = np.concatenate([[0], np.cumsum(lengths)[:-1]])
        cosines = np.ones(len(self.points))
        for length in np.unique(lengths[lengths > 1]):
            rows = np.flatnonzero(lengths == length)
            tracks = rays[first[rows, None] + np.arange(min(length, WIDEST_TRACK))]
            cosines[rows] = np.einsum("tij,tkj->tik", tracks, tracks).min(axis=(1, 2))
        angles: Array = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
        return angles

    def _means(self, column: int, count: int) -> Array:
        rows = self.observations[:, column]
        sums = np.bincount(rows, weights=self.residuals_px, minlength=count)
        means: Array = sums / np.maximum(np.bincount(rows, minlength=count), 1)
        return means


@dataclass(frozen=True, eq=False)
class DenseView:
    """An undistorted photo, and its depth map where it has one."""

    name: str
    matrix: Array
    """(3, 3) pinhole camera matrix; pixel centres lie at 0.5."""
    rotation: Array
    """(3, 3) `cam_from_sfm`."""
    centre: Array
    """(3,) in frame sfm."""
    size: tuple[int, int]
    """Width and height, px."""
    photo_path: Path
    depth_path: Path | None

    def photo(self) -> Colours:
        """Return the (H, W, 3) picture."""
        import cv2

        picture: Any = cv2.imread(str(self.photo_path), cv2.IMREAD_COLOR)
        return np.ascontiguousarray(picture[..., ::-1])

    def depth(self) -> DepthMap | None:
        """Return the depth map, if there is one."""
        return None if self.depth_path is None else load_depth(self.depth_path)


def read_matches(record: PhotoRecord) -> IntArray | None:
    """Return (N, N) how many matches of two photos fit one rigid scene, photos in their order; None before that."""
    if record.photos is None or record.database is None:
        return None
    return verified_matches(record.database, [photo.file for photo in record.photos.photos])


def read_sparse(sparse: SparseModel) -> SparseRecord:
    """Return cameras and points of a model in plain arrays."""
    images = {name_of(image.name): image for image in sparse.model.images.values() if image.has_pose}
    names = sparse.order or tuple(sparse.names)
    points = sparse.model.points3D
    rows = {point_id: row for row, point_id in enumerate(sorted(points))}
    positions = np.array([points[point_id].xyz for point_id in rows]).reshape(-1, 3)
    seen = list(_observations(sparse.model, [images[name] for name in names], rows, positions))
    return SparseRecord(
        names=tuple(names),
        is_order_known=bool(sparse.order),
        centres=np.array([images[name].projection_center() for name in names]),
        rotations=np.array([images[name].cam_from_world().rotation.matrix() for name in names]),
        points=positions,
        colours=np.array([points[point_id].color for point_id in rows], np.uint8).reshape(-1, 3),
        observations=np.concatenate([pairs for pairs, _ in seen]),
        residuals_px=np.concatenate([residuals for _, residuals in seen]),
    )


def _observations(
    model: Any, images: list[Any], rows: dict[int, int], positions: Array
) -> Iterator[tuple[IntArray, Array]]:
    """Yield for each image its (K, 2) rows of point and camera, and the (K,) residuals, px."""
    for camera_row, image in enumerate(images):
        seen = image.get_observation_points2D()
        point_rows = np.array([rows[one.point3D_id] for one in seen], np.int64)
        pixels = np.array([one.xy for one in seen]).reshape(-1, 2)
        pose = image.cam_from_world().matrix()
        in_camera = positions[point_rows] @ pose[:, :3].T + pose[:, 3]
        expected = model.cameras[image.camera_id].img_from_cam(in_camera, check_cheirality=False)
        pairs = np.stack([point_rows, np.full(len(seen), camera_row)], axis=1)
        yield pairs, np.linalg.norm(np.reshape(expected, (-1, 2)) - pixels, axis=1)


def read_dense_views(record: PhotoRecord) -> list[DenseView]:
    """Return the undistorted photos in the order of their ids; none before depth is measured."""
    if record.dense_dir is None or not (record.dense_dir / "sparse").is_dir():
        return []
    model = load_pycolmap().Reconstruction(record.dense_dir / "sparse")
    views = []
    for image_id in sorted(model.reg_image_ids()):
        image = model.images[image_id]
        camera, path = model.cameras[image.camera_id], depth_path(record.dense_dir, image.name)
        views.append(
            DenseView(
                name_of(image.name),
                camera.calibration_matrix(),
                image.cam_from_world().rotation.matrix(),
                image.projection_center(),
                (int(camera.width), int(camera.height)),
                record.dense_dir / "images" / image.name,
                path if path in record.depth_paths else None,
            )
        )
    return views
