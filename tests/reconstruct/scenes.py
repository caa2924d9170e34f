"""A small photographed cave, and scores of a cloud against the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.photograph.options import CameraOptions, CaptureOptions, DiveOptions
from aquanav_tools.synthetic.caves import CaveOptions, SyntheticCave, demo_cave
from aquanav_tools.types import Array
from eval.photos.score import distances_to, read_true_cameras, score_cloud, seen_wall

SMALL_CAVE = CaveOptions(length=5.0, radius=1.2, winding=0.3, voxel=0.06)
SMALL_RENDER = CameraOptions(width=480, height=360)
SMALL_DIVE = DiveOptions(
    camera=SMALL_RENDER,
    capture=CaptureOptions(
        photos=12,
        start_margin=0.5,
        end_margin=3.5,
        shots=((16, 10), (-16, 10), (-16, -10), (16, -10)),
        unsteady_m=0.12,
    ),
)


def small_cave() -> SyntheticCave:
    """A passage of 5 m for a dozen photos."""
    return demo_cave(SMALL_CAVE)


def true_centres(folder: Path, names: tuple[str, ...]) -> Array:
    """Return the (N, 3) true camera centres of some rendered photos."""
    cameras = read_true_cameras(folder)
    return cameras.centres[[cameras.names.index(name) for name in names]]


def scores(cave: SyntheticCave, folder: Path, points: Array, tolerance: float = 0.05) -> dict[str, float]:
    """Return median distance to the wall (m), precision, recall over the seen wall and F-score at a tolerance."""
    (score,) = score_cloud(points, cave.mesh, seen_wall(cave.mesh, read_true_cameras(folder)), (tolerance,))
    median = float(np.median(distances_to(cave.mesh, points)))
    return {"median": median, "precision": score.precision, "recall": score.recall, "f": score.f_score}
