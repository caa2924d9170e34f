"""Depth maps: undistort the photos, then find depth and normal of every pixel by PatchMatch on the CPU."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.reconstruct.views import View, rank_sources, read_views
from aquanav_tools.types import Progress, ignore_progress

FloatImage = npt.NDArray[np.float32]
DepthQuality = Literal["draft", "standard", "high"]


@dataclass(frozen=True)
class DepthOptions:
    """The dense step. The defaults are the fast setting: about 2 s per photo on two cores."""

    width: int = 480
    """Photos are shrunk to this width (their larger side), px; 640 is finer and takes 4 times as long with the rest."""
    sources: int = 6
    """Photos each one is compared with."""
    radius: int = 3
    """Half the width of the window that is compared, px."""
    iterations: int = 2
    """Rounds of spreading and varying planes."""
    seed: int = 0
    """Of the random planes; the same seed gives the same depth."""

    def __post_init__(self) -> None:
        if self.width < 64 or self.radius < 1 or self.iterations < 1:
            raise ValueError(f"DepthOptions needs width >= 64, radius >= 1 and iterations >= 1, got {self}.")
        if self.sources < 2:
            raise ValueError(f"sources = {self.sources} is below 2: each pixel needs two photos that confirm it.")

    @classmethod
    def at(cls, quality: DepthQuality) -> DepthOptions:
        """Return the settings of a quality: a draft to look at, the standard, or what more time buys."""
        if quality == "draft":
            return cls(width=320, sources=4)
        if quality == "high":
            return cls(width=640, sources=8, radius=5, iterations=3)
        return cls()


@dataclass(frozen=True, eq=False)
class DepthMap:
    """What PatchMatch found for one photo."""

    depth: FloatImage
    """(H, W) along the camera's axis, m."""
    normals: FloatImage
    """(H, W, 3) unit, camera frame, towards the camera."""
    cost: FloatImage
    """(H, W) 1 - NCC, in [0, 2]; small is sure."""


def undistort(photos: PhotoSet, sparse: SparseModel, folder: Path, options: DepthOptions) -> None:
    """Write COLMAP's dense workspace: shrunk pinhole photos and the model that fits them. Kept when it is complete."""
    if folder.is_dir():
        return
    pycolmap = load_pycolmap()
    unfinished = folder.with_name(folder.name + ".unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    model_dir = unfinished / "distorted"
    model_dir.mkdir(parents=True)
    sparse.model.write(model_dir)
    shrink = pycolmap.UndistortCameraOptions(max_image_size=options.width)
    pycolmap.undistort_images(unfinished, model_dir, photos.folder, undistort_options=shrink)
    unfinished.rename(folder)


def estimate_depth(folder: Path, options: DepthOptions, progress: Progress = ignore_progress) -> list[Path]:
    """Return one file per photo of an undistorted workspace, with the depth map it holds.

    Files that exist are kept, so a killed run loses one photo's work.

    Raises:
        ReconstructionError: no photo has two others to be compared with.
    """
    views = read_views(load_pycolmap().Reconstruction(folder / "sparse"))
    chosen = [(view, ranked) for view, ranked in zip(views, rank_sources(views, options.sources), strict=True)]
    chosen = [(view, ranked) for view, ranked in chosen if len(ranked) >= 2]
    if not chosen:
        raise ReconstructionError(
            f"None of the {len(views)} registered photos shares rock with two others at a useful angle, so no depth "
            "can be found. The camera turned on the spot or moved too far. Take photos from places side by side."
        )
    paths = []
    for index, (view, ranked) in enumerate(chosen):
        path = depth_path(folder, view.name)
        if not path.is_file():
            _save(path, _depth_of(view, [views[source] for source in ranked], folder / "images", options))
        paths.append(path)
        progress(index + 1, len(chosen))
    return paths


def depth_path(folder: Path, name: str) -> Path:
    """Return where the depth map of a photo is kept in a workspace."""
    return folder / "depth" / f"{name}.npz"


def load_depth(path: Path) -> DepthMap:
    """Return a depth map that `estimate_depth` kept."""
    with np.load(path, allow_pickle=False) as stored:
        return DepthMap(stored["depth"], stored["normals"].astype(np.float32), stored["cost"].astype(np.float32))


def _save(path: Path, result: DepthMap) -> None:
    path.parent.mkdir(exist_ok=True)
    unfinished = path.with_suffix(".unfinished")
    with unfinished.open("wb") as stream:
        np.savez(
            stream,
            depth=result.depth,
            normals=result.normals.astype(np.float16),
            cost=result.cost.astype(np.float16),
        )
    unfinished.rename(path)


def _depth_of(view: View, others: list[View], images_dir: Path, options: DepthOptions) -> DepthMap:
    from aquanav_tools.reconstruct.patchmatch import Reference, Search, match_patches

    rng = np.random.default_rng([options.seed, view.image_id])
    reference = Reference(view.grey(images_dir), _inverse_intrinsics(view))
    depth, normals = guess_planes(view, rng)
    nearest, farthest = view.depth_range()
    seed = int(rng.integers(1 << 30))
    search = Search(options.radius, 2, min(2, len(others)), nearest, farthest, seed)
    cost = match_patches(reference, _sources(view, others, images_dir), depth, normals, search, options.iterations)
    return DepthMap(depth, normals, cost)


def _inverse_intrinsics(view: View) -> npt.NDArray[np.float32]:
    fx, fy, cx, cy = view.matrix[0, 0], view.matrix[1, 1], view.matrix[0, 2], view.matrix[1, 2]
    return np.array([1.0 / fx, 1.0 / fy, -cx / fx, -cy / fy], np.float32)


def _sources(view: View, others: list[View], images_dir: Path):  # type: ignore[no-untyped-def]  # numba's room
    from aquanav_tools.reconstruct.patchmatch import Sources

    greys = [other.grey(images_dir) for other in others]
    sizes = np.array([grey.shape for grey in greys], np.int64)
    images = np.zeros((len(greys), *sizes.max(axis=0)), np.float32)
    for image, grey in zip(images, greys, strict=True):
        image[: grey.shape[0], : grey.shape[1]] = grey
    from_view = [other.rotation @ view.rotation.T for other in others]
    inverse = np.linalg.inv(view.matrix)
    turns = [other.matrix @ turn @ inverse for other, turn in zip(others, from_view, strict=True)]
    shifts = [
        other.matrix @ (other.translation - turn @ view.translation)
        for other, turn in zip(others, from_view, strict=True)
    ]
    return Sources(images, sizes, np.array(turns, np.float32).reshape(-1, 9), np.array(shifts, np.float32))


def guess_planes(view: View, rng: np.random.Generator) -> tuple[FloatImage, FloatImage]:
    """Return (H, W) depth and (H, W, 3) normals to start from.

    Most pixels lie on the triangulation of the sparse points, with some noise; the rest are random.
    """
    from scipy.spatial import Delaunay

    nearest, farthest = view.depth_range()
    height, width = view.height, view.width
    inverse = rng.uniform(1.0 / farthest, 1.0 / nearest, height * width)
    depth = 1.0 / inverse
    normals = np.column_stack([rng.uniform(-0.8, 0.8, (height * width, 2)), np.full(height * width, -0.7)])
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1).reshape(-1, 2)
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(view.matrix).T
    projected = view.points @ view.matrix.T
    mesh = Delaunay(projected[:, :2] / projected[:, 2:])
    triangle = mesh.find_simplex(pixels)
    corners = view.points[mesh.simplices]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-12
    offset = np.einsum("ij,ij->i", across, corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        on_plane = offset[triangle] / np.einsum("ij,ij->i", across[triangle], rays)
    is_used = (triangle >= 0) & (on_plane > nearest) & (on_plane < farthest) & (rng.random(len(pixels)) < 0.8)
    depth[is_used] = on_plane[is_used] * (1.0 + rng.normal(0.0, 0.02, is_used.sum()))
    normals[is_used] = across[triangle[is_used]]
    normals += rng.normal(0.0, 0.1, normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[np.einsum("ij,ij->i", normals, rays) > 0.0] *= -1.0
    depth = np.clip(depth, 1.001 * nearest, 0.999 * farthest)
    return depth.reshape(height, width).astype(np.float32), normals.reshape(height, width, 3).astype(np.float32)
