"""Depth maps: undistort the photos, then find depth and normal of every pixel by comparing it with other photos.

PatchMatch from coarse to fine (dense/levels.py), then, where asked for, once more with what was found in the other
photos as a second witness, as Xu and Tao, Multi-Scale Geometric Consistency Guided Multi-View Stereo (2019), have it.

Memory does not grow with the number of photos: at a time, one photo per core with its sources and a few remembered ones
are held (`memory_bytes`). The largest side of a photo is bounded by `width`.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.dense.engine import Device, solver
from aquanav_tools.reconstruct.dense.levels import Level, Task, find_planes, make_agree
from aquanav_tools.reconstruct.dense.masks import write_masks
from aquanav_tools.reconstruct.dense.pictures import Picture, album
from aquanav_tools.reconstruct.dense.state import WORST_COST, Planes
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.reconstruct.views import View, rank_sources, read_views
from aquanav_tools.types import Array, Progress, ignore_progress

FloatImage = npt.NDArray[np.float32]
DepthQuality = Literal["draft", "standard", "high"]
_COARSEST = 60
"""Width of the smallest copies at least, px: smaller ones show nothing of the rock."""
_AGREEMENT = 0.3
"""What disagreeing with another photo's depth costs, where unlikeness costs up to 2."""
_SURE = 1.0
"""Cost up to which a depth is held against others."""
_REMEMBERED = 8
"""Photos held beyond those that one is compared with."""


@dataclass(frozen=True)
class DepthOptions:
    """The dense step. The defaults are the standard quality."""

    width: int = 480
    """Photos are shrunk to this width (their larger side), px; 960 is finer and takes 4 times as long."""
    sources: int = 8
    """Photos each one is compared with."""
    radius: int = 3
    """Half the width of the window that is compared, px."""
    iterations: int = 1
    """Rounds of spreading and varying planes at full size; smaller copies, where they cost little, get more."""
    agreement: bool = False
    """Go over every photo once more with the depth of the others as a second witness: fewer wrong points, half as much
    time again."""
    distinction: float = 0.0
    """How much worse (1 - NCC) the photos must fit at other depths than at the one that was found, or the pixel has
    none: plain wall looks alike at any depth."""
    seed: int = 0
    """Of the random planes; the same seed gives the same depth."""
    device: Device = "auto"
    """Where to compute: auto takes a CUDA graphics card where numba can use one, else the processor. Results differ by
    rounding."""

    def __post_init__(self) -> None:
        if self.width < 64 or not 1 <= self.radius <= 7 or self.iterations < 1:
            raise ValueError(f"DepthOptions needs width >= 64, radius from 1 to 7 and iterations >= 1, got {self}.")
        if not 0.0 <= self.distinction < 2.0:
            raise ValueError(f"distinction = {self.distinction} is not in [0, 2).")
        if not 2 <= self.sources <= 255:
            raise ValueError(f"sources = {self.sources} is not from 2 to 255: two photos must confirm each pixel.")

    @classmethod
    def at(cls, quality: DepthQuality) -> DepthOptions:
        """Return the settings of a quality: a draft to look at, the standard, or what more time buys."""
        if quality == "draft":
            return cls(width=320, sources=6)
        if quality == "high":
            return cls(width=640, agreement=True)  # 960 px take twice the time of 640 and find no more (measured)
        return cls()

    @property
    def levels(self) -> list[Level]:
        """The search from small copies of the photos to their full size."""
        halvings = min(2, int(np.log2(self.width / _COARSEST)))
        coarse = [Level(h, 3 if h == halvings else 2, 3, 0.5 ** (1 + halvings - h), self.radius) for h in (2, 1)]
        last = 0.0 if self.agreement else self.distinction  # what others found may tell what photos alone do not
        full = Level(0, self.iterations, 2 if halvings else 3, 0.1 if halvings else 0.5, self.radius, 0.0, last)
        return coarse[2 - halvings :] + [full]


@dataclass(frozen=True, eq=False)
class DepthMap:
    """What PatchMatch found for one photo."""

    depth: FloatImage
    """(H, W) along the camera's axis, m; 0 where nothing can be found: masked, black or without any texture."""
    normals: FloatImage
    """(H, W, 3) unit, camera frame, towards the camera; 0 where there is no depth."""
    cost: FloatImage
    """(H, W) 1 - NCC, in [0, 2]; small is sure. 2 where there is no depth."""


def undistort(photos: PhotoSet, sparse: SparseModel, folder: Path, options: DepthOptions) -> None:
    """Write COLMAP's dense workspace: shrunk pinhole photos, their masks, and the model. Kept when it is complete."""
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
    write_masks(sparse.model, pycolmap.Reconstruction(unfinished / "sparse"), photos.masks_dir, unfinished)
    unfinished.rename(folder)


def estimate_depth(folder: Path, options: DepthOptions, progress: Progress = ignore_progress) -> list[Path]:
    """Return one file per photo of an undistorted workspace, with the depth map it holds.

    Files that exist are kept, so a killed run loses one photo's work.

    Raises:
        ReconstructionError: no photo has two others to be compared with.
        ResourceError: a graphics card is asked for, and cannot be used.
    """
    views = read_views(load_pycolmap().Reconstruction(folder / "sparse"))
    sources = {view: [views[j] for j in ranked] for view, ranked in _ranked(views, options) if len(ranked) >= 2}
    if not sources:
        raise ReconstructionError(
            f"None of the {len(views)} registered photos shares rock with two others at a useful angle, so no depth "
            "can be found. The camera turned on the spot or moved too far. Take photos from places side by side."
        )
    _Estimation(folder, options, sources, progress).run()
    return [depth_path(folder, view.name) for view in sources]


def depth_path(folder: Path, name: str) -> Path:
    """Return where the depth map of a photo is kept in a workspace."""
    return folder / "depth" / f"{name}.npz"


def load_depth(path: Path) -> DepthMap:
    """Return a depth map that `estimate_depth` kept."""
    with np.load(path, allow_pickle=False) as stored:
        return DepthMap(stored["depth"], stored["normals"].astype(np.float32), stored["cost"].astype(np.float32))


def memory_bytes(width: int, height: int, options: DepthOptions, at_once: int) -> int:
    """Return how much memory the arrays of the dense step take at most, for undistorted photos of a size.

    Args:
        width: px.
        height: px.
        options: Of the step.
        at_once: Photos searched at the same time.
    """
    held = _num_held(options, at_once) * 10  # per pixel: grey, mask, packed grey, and all three in small
    searched = options.sources * (8 if options.agreement else 4) + 100  # sources, maps, planes, and what is saved
    return width * height * (held + at_once * searched)


def _num_held(options: DepthOptions, at_once: int) -> int:
    """Return how many photos are held, those that are searched at the same time included."""
    return at_once * (options.sources + 1) + _REMEMBERED


def _ranked(views: list[View], options: DepthOptions) -> list[tuple[View, list[int]]]:
    return list(zip(views, rank_sources(views, options.sources), strict=True))


class _Estimation:
    """The work on all photos of a workspace; what exists is kept."""

    def __init__(
        self, folder: Path, options: DepthOptions, sources: dict[View, list[View]], progress: Progress
    ) -> None:
        self._folder, self._options, self._sources, self._progress = folder, options, sources, progress
        self._solver = solver(options.device)
        self._picture: Callable[[View], Picture] = album(folder, _num_held(options, self._solver.at_once))

    def run(self) -> None:
        """Find depth for every photo, first alone; then, where asked for, in agreement."""
        left = [view for view in self._sources if not depth_path(self._folder, view.name).is_file()]
        if not self._options.agreement:
            self._pass(left, self._folder, self._find, 0, len(self._sources))
            return
        alone = self._folder / "alone"
        needed = {view for one in left for view in (one, *self._sources[one]) if view in self._sources}
        first = [view for view in self._sources if view in needed]
        self._pass(first, alone, self._find, 0, 2 * len(self._sources))
        self._pass(left, self._folder, self._agree, len(self._sources), 2 * len(self._sources))
        shutil.rmtree(alone, ignore_errors=True)

    def _pass(self, views: list[View], folder: Path, work: Callable[[View], DepthMap], done: int, total: int) -> None:
        done += len(self._sources) - len(views)
        self._progress(done, total)

        def keep(view: View) -> None:
            path = depth_path(folder, view.name)
            if not path.is_file():
                _save(path, work(view))

        with ThreadPoolExecutor(self._solver.at_once) as threads:
            try:
                for index, _ in enumerate(threads.map(keep, views)):
                    self._progress(done + index + 1, total)
            except BaseException:  # also when the user stops it: the photos in work are finished, no others begun
                threads.shutdown(cancel_futures=True)
                raise

    def _task(self, view: View) -> Task:
        others = [self._picture(other) for other in self._sources[view]]
        rng = np.random.default_rng([self._options.seed, view.image_id])
        return Task(self._picture(view), others, *view.depth_range(), int(rng.integers(1 << 30)))

    def _find(self, view: View) -> DepthMap:
        planes = find_planes(self._task(view), view.points, self._options.levels, self._solver.solve)
        return depth_map(planes, view.matrix)

    def _agree(self, view: View) -> DepthMap:
        alone = self._folder / "alone"
        own = load_depth(depth_path(alone, view.name))
        maps = [_inverse(depth_path(alone, other.name), (other.height, other.width)) for other in self._sources[view]]
        level = Level(0, 1, 2, 0.1, self._options.radius, _AGREEMENT, self._options.distinction)
        start = planes_of(own, view.matrix)
        return depth_map(make_agree(self._task(view), start, maps, level, self._solver.solve), view.matrix)


def _inverse(path: Path, size: tuple[int, int]) -> FloatImage:
    """Return the (H, W) inverse depth that a photo's map is sure of, 1/m, else 0."""
    if not path.is_file():
        return np.zeros(size, np.float32)
    found = load_depth(path)
    return np.divide(1.0, found.depth, out=np.zeros_like(found.depth), where=(found.cost < _SURE) & (found.depth > 0))


def _save(path: Path, result: DepthMap) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".unfinished")
    with unfinished.open("wb") as stream:
        np.savez(
            stream,
            depth=result.depth,
            normals=result.normals.astype(np.float16),
            cost=result.cost.astype(np.float16),
        )
    unfinished.rename(path)


def depth_map(planes: Planes, matrix: Array) -> DepthMap:
    """Return planes as depth and normals; a pixel that could be compared with nothing has neither."""
    is_found = planes.cost < WORST_COST
    depth = np.divide(1.0, planes.inverse, out=np.zeros_like(planes.inverse), where=is_found)
    x, y = _rays(matrix, planes.inverse.shape)
    # n . (ray z) = 1 on the plane, so n = (f_x dw/du, f_y dw/dv, w less what the first two give), turned round.
    n0, n1 = np.float32(matrix[0, 0]) * planes.slopes[..., 0], np.float32(matrix[1, 1]) * planes.slopes[..., 1]
    normals = -np.stack([n0, n1, planes.inverse - n0 * x - n1 * y], axis=-1)
    normals *= (is_found / np.sqrt(np.einsum("ijk,ijk->ij", normals, normals)))[..., None]
    return DepthMap(depth, normals.astype(np.float32), planes.cost)


def planes_of(found: DepthMap, matrix: Array) -> tuple[FloatImage, FloatImage]:
    """Return the (H, W) inverse depth and (H, W, 2) slopes of a depth map; any plane where it has none."""
    x, y = _rays(matrix, found.depth.shape)
    n = found.normals
    facing = n[..., 0] * x + n[..., 1] * y + n[..., 2]
    is_found = (found.depth > 0) & (facing < 0)
    inverse = np.divide(1.0, found.depth, out=np.zeros_like(found.depth), where=is_found)
    scale = np.divide(inverse, facing, out=np.zeros_like(facing), where=is_found)
    focal = np.array([matrix[0, 0], matrix[1, 1]], np.float32)
    return inverse, n[..., :2] / focal * scale[..., None]


def _rays(matrix: Array, size: tuple[int, ...]) -> tuple[FloatImage, FloatImage]:
    """Return the x of every column's rays, and the (H, 1) y of every row's, at depth 1."""
    x = (np.arange(size[1]) + 0.5 - matrix[0, 2]) / matrix[0, 0]
    y = (np.arange(size[0]) + 0.5 - matrix[1, 2]) / matrix[1, 1]
    return x.astype(np.float32), y.astype(np.float32)[:, None]
