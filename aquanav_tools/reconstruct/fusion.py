"""One cloud from many depth maps: COLMAP's fusion keeps the points that several photos agree on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.libraries import load_open3d
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.depth import load_depth
from aquanav_tools.types import PointCloud, Progress, ignore_progress


@dataclass(frozen=True)
class FusionOptions:
    """When depth maps agree."""

    max_cost: float = 0.5
    """Pixels with a larger matching cost (1 - NCC) are dropped first."""
    min_photos: int = 2
    """Photos that must agree on a point, its own included."""
    max_reprojection_px: float = 1.5
    """Largest offset between their pixels."""
    max_depth_error: float = 0.01
    """Largest relative difference of their depths."""
    max_normal_deg: float = 40.0
    """Largest angle between their normals."""

    def __post_init__(self) -> None:
        if not 0 < self.max_cost <= 2 or self.min_photos < 2:
            raise ValueError(f"FusionOptions needs max_cost in (0, 2] and min_photos >= 2, got {self}.")
        if min(self.max_reprojection_px, self.max_depth_error, self.max_normal_deg) <= 0:
            raise ValueError(f"FusionOptions needs positive tolerances, got {self}.")


def fuse_depth(
    folder: Path, depth_paths: list[Path], options: FusionOptions, progress: Progress = ignore_progress
) -> PointCloud:
    """Return the points that the depth maps of an undistorted workspace agree on, with normals and colours.

    Normals point to the side the cameras are on.

    Raises:
        ReconstructionError: no point is confirmed by a second photo.
    """
    for index, path in enumerate(depth_paths):
        _write_maps(folder, path, options.max_cost)
        progress(index + 1, len(depth_paths) + 1)
    names = [path.name.removesuffix(".npz") for path in depth_paths]
    (folder / "stereo" / "fusion.cfg").write_text("".join(f"{name}\n" for name in names))
    cloud = _run_fusion(folder, options)
    progress(len(depth_paths) + 1, len(depth_paths) + 1)
    if not len(cloud.points):
        raise ReconstructionError(
            f"The depth maps of {len(depth_paths)} photos agree on no point. The rock lacks texture or the poses are "
            "wrong. Take sharper, better lit photos closer to each other."
        )
    return cloud


def _write_maps(folder: Path, path: Path, max_cost: float) -> None:
    """Write depth and normals of one photo in COLMAP's format; pixels without a sure depth are 0."""
    result = load_depth(path)
    is_sure = result.cost <= max_cost
    name = path.name.removesuffix(".npz") + ".geometric.bin"
    _write_map(folder / "stereo" / "depth_maps" / name, (result.depth * is_sure)[None])
    _write_map(folder / "stereo" / "normal_maps" / name, (result.normals * is_sure[..., None]).transpose(2, 0, 1))


def _write_map(path: Path, planes: npt.NDArray[np.float32]) -> None:
    """Write (C, H, W) floats as COLMAP reads them: plane by plane. pycolmap's own writer interleaves the planes."""
    channels, height, width = planes.shape
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(f"{width}&{height}&{channels}&".encode() + np.ascontiguousarray(planes, dtype="<f4").tobytes())


def _run_fusion(folder: Path, options: FusionOptions) -> PointCloud:
    pycolmap = load_pycolmap()
    fusion = pycolmap.StereoFusionOptions()
    fusion.num_threads = 1  # with more the order, and so the choice, of points varies
    fusion.min_num_pixels = options.min_photos
    fusion.max_reproj_error = options.max_reprojection_px
    fusion.max_depth_error = options.max_depth_error
    fusion.max_normal_error = options.max_normal_deg
    path = folder / "fused.ply"
    pycolmap.stereo_fusion(path, folder, input_type="geometric", options=fusion, output_type="ply")
    cloud = load_open3d().io.read_point_cloud(str(path))
    colours = np.rint(255.0 * np.asarray(cloud.colors)).astype(np.uint8)
    return PointCloud(np.array(cloud.points), np.array(cloud.normals), colours)
