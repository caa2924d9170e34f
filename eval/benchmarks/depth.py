"""Measure the dense step: seconds per photo and error, on the processor and on a graphics card where there is one.

    python eval/benchmarks/depth.py [--photos 20] [--size 1280x960] [--widths 480 960 1280] [--devices cpu cuda]

Renders photos of the demo cave with their true depth, places the cameras where they were, and finds the depth of all
photos once per width and device. A first, uncounted photo warms up: numba compiles, or reads what it compiled before.
Seconds are the wall's and the processor's per photo, undistortion, reading and saving included; shares are those of the
pixels with rock within 5 m. Give it an idle machine. The table is printed, and kept with `--out table.md`.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from aquanav_tools.photograph.dive import photograph
from aquanav_tools.photograph.files import DEPTH_DIR
from aquanav_tools.photograph.options import CameraOptions, CaptureOptions, DiveOptions
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.dense.engine import cuda_obstacle
from aquanav_tools.reconstruct.depth import DepthOptions, estimate_depth, load_depth, undistort
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.synthetic.caves import CaveOptions, demo_cave
from aquanav_tools.types import Array, Mesh
from eval.photos.score import is_seen, read_true_cameras, read_wall
from eval.smoke import parser_of

STATION_M = 0.7
"""Between stations of five photos, as in the demo dive."""
SPARSE_POINTS = 8000
"""On the wall; a photo shows about as many as structure from motion leaves it, several hundred."""
FOUND = 0.5
"""Share of the points a photo shows that it is taken to have found."""
FAR_M = 5.0


@dataclass(frozen=True)
class Row:
    """One width on one device."""

    device: str
    width: int
    agreement: bool
    wall_s: float
    cpu_s: float
    within: tuple[float, float, float]
    """Share of pixels within 2 cm, 5 cm and 1 % of the true depth."""
    sure: float
    """Share of pixels of cost 0.5 or less."""
    sure_within: float
    """Share of those within 5 cm."""

    def __str__(self) -> str:
        shares = " | ".join(f"{100 * share:.1f}" for share in (*self.within, self.sure, self.sure_within))
        agreement = "yes" if self.agreement else "no"
        return f"| {self.device} | {self.width} | {agreement} | {self.wall_s:.2f} | {self.cpu_s:.2f} | {shares} |"


HEAD = """| device | width | agreement | wall s | CPU s | 2 cm % | 5 cm % | 1 % % | sure % | of these 5 cm % |
|---|---|---|---|---|---|---|---|---|---|"""


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--photos", type=int, default=20)
    parser.add_argument("--size", default="1280x960")
    parser.add_argument("--widths", type=int, nargs="+", default=[480, 960, 1280])
    parser.add_argument("--devices", nargs="+", choices=["cpu", "cuda"], default=["cpu", "cuda"])
    parser.add_argument("--agreement", action="store_true", help="also measure with agreement")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    if arguments.smoke:
        arguments.photos, arguments.size, arguments.widths = 5, "320x240", [160]
    obstacle = cuda_obstacle()
    if obstacle and "cuda" in arguments.devices:
        print(f"cuda is left out: {obstacle}")
    devices = [device for device in arguments.devices if device == "cpu" or not obstacle]
    lines = [_heading(arguments.photos, arguments.size, obstacle), "", HEAD]
    print("\n".join(lines), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        photos = render(Path(folder) / "photos", arguments.photos, arguments.size)
        model = true_model(photos)
        for device in devices:
            for width in arguments.widths:
                for agreement in (False, True)[: 1 + arguments.agreement]:
                    options = DepthOptions(width=width, device=device, agreement=agreement)
                    lines.append(str(measure(photos, model, Path(folder) / "dense", options)))
                    print(lines[-1], flush=True)
    if arguments.out:
        arguments.out.write_text("\n".join(lines) + "\n")


def _heading(count: int, size: str, obstacle: str) -> str:
    card = obstacle
    if not obstacle:
        from numba import cuda

        card = f"Card: {cuda.get_current_device().name.decode()}."
    return f"{count} photos of {size} px; {len(os.sched_getaffinity(0))} cores, numba {numba.__version__}. {card}"


def render(folder: Path, count: int, size: str) -> Path:
    """Write photos with their true depth; five per station."""
    width, height = (int(side) for side in size.split("x"))
    capture = CaptureOptions(photos=count)
    length = capture.start_margin + capture.end_margin + STATION_M * max(1, count // len(capture.shots) - 1)
    options = DiveOptions(camera=CameraOptions(width=width, height=height), capture=capture)
    photograph(demo_cave(CaveOptions(length=max(length, 2.0))), folder, options, with_depth=True)
    return folder


def true_model(folder: Path) -> Any:
    """Return a pycolmap.Reconstruction with the true cameras, and points of the wall where photos show them."""
    pycolmap = load_pycolmap()
    cameras, wall = read_true_cameras(folder), read_wall(folder)
    lens = cameras.lens
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model=lens.model, width=lens.width, height=lens.height, params=lens.parameters, camera_id=1)
    )
    points, found = _sparse_points(wall, cameras)
    rank = np.cumsum(found, axis=1) - 1  # of a point among those that a photo found
    for index, (name, centre, turn) in enumerate(
        zip(cameras.names, cameras.centres, cameras.cam_from_world, strict=True)
    ):
        pixels = lens.project((points[found[index]] - centre) @ turn.T)
        image = pycolmap.Image(name=name, keypoints=pixels, camera_id=1, image_id=index + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(turn), -turn @ centre))
    for column, point in enumerate(points):
        track = pycolmap.Track()
        for photo in np.flatnonzero(found[:, column]):
            track.add_element(int(photo) + 1, int(rank[photo, column]))
        model.add_point3D(point, track)
    return model


def _sparse_points(wall: Mesh, cameras: Any) -> tuple[Array, Any]:
    """Return (P, 3) points of the wall, off it by a third of a percent of their distance, and (N, P) who found them."""
    import trimesh

    rng = np.random.default_rng(0)
    points = np.asarray(trimesh.sample.sample_surface(wall.to_trimesh(), SPARSE_POINTS, seed=0)[0])
    scene = SmoothScene(wall)
    found = np.stack(
        [
            is_seen(scene, cameras.lens, centre, turn, points) & (rng.random(len(points)) < FOUND)
            for centre, turn in zip(cameras.centres, cameras.cam_from_world, strict=True)
        ]
    )
    is_used = found.sum(axis=0) >= 2
    distance = np.linalg.norm(points[None] - cameras.centres[:, None], axis=2).min(axis=0)
    points = points + rng.normal(size=points.shape) * distance[:, None] / 300.0
    return points[is_used], found[:, is_used]


def measure(photos: Path, model: Any, dense: Path, options: DepthOptions) -> Row:
    """Return what finding the depth of all photos takes and gives."""
    photo_set: Any = SimpleNamespace(folder=photos, masks_dir=None)
    shutil.rmtree(dense, ignore_errors=True)
    undistort(photo_set, SparseModel(model), dense, replace(options, width=64))
    estimate_depth(dense, replace(options, width=64))
    shutil.rmtree(dense)
    wall, cpu = time.perf_counter(), time.process_time()
    undistort(photo_set, SparseModel(model), dense, options)
    paths = estimate_depth(dense, options)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    errors = np.concatenate([_errors(path, photos) for path in paths], axis=1)
    error, distance, cost = errors
    is_sure = cost <= 0.5
    within = tuple(float(np.mean(error < limit)) for limit in (0.02, 0.05, 0.01 * distance))
    sure_within = float(np.mean(error[is_sure] < 0.05))
    device, count = options.device, len(paths)
    return Row(
        device,
        options.width,
        options.agreement,
        wall / count,
        cpu / count,
        within,  # type: ignore[arg-type]
        float(is_sure.mean()),
        sure_within,
    )


def _errors(path: Path, photos: Path) -> Array:
    """Return (3, P) error of depth, true depth and cost of the pixels with rock within FAR_M."""
    found = load_depth(path)
    with np.load(photos / DEPTH_DIR / f"{Path(path.name.removesuffix('.npz')).stem}.npz") as stored:
        truth = stored["depth"]
    height, width = found.depth.shape
    rows = ((np.arange(height) + 0.5) * truth.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * truth.shape[1] / width).astype(int)
    truth = truth[rows][:, columns]
    is_near = np.nan_to_num(truth, nan=np.inf) < FAR_M
    return np.stack([np.abs(found.depth - truth)[is_near], truth[is_near], found.cost[is_near]])


if __name__ == "__main__":
    main()
