"""Models with known cameras, without photographs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.photograph.trajectory import look
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array

WIDTH, HEIGHT, FOCAL_PX = 480, 360, 400.0


@dataclass(frozen=True, eq=False)
class Posed:
    """Cameras as in the world, and a model of them that is `scale` times as small."""

    sparse: SparseModel
    centres: Array
    """(N, 3) world, m."""
    rotations: Array
    """(N, 3, 3) cam_from_world."""

    def pixels(self, index: int, points: Array) -> Array:
        """Return where (P, 3) points of the world are seen in a photo, px as COLMAP counts."""
        seen = (points - self.centres[index]) @ self.rotations[index].T
        return seen[:, :2] / seen[:, 2:] * FOCAL_PX + np.array([WIDTH, HEIGHT]) / 2.0


def posed_model(centres: Array, targets: Array, scale: float = 1.0) -> Posed:
    """Return cameras p0.png, p1.png, ... at (N, 3) centres that look at (N, 3) targets, m."""
    pycolmap = load_pycolmap()
    ahead = targets - centres
    yaws = np.arctan2(ahead[:, 1], ahead[:, 0])
    pitches = np.arctan2(ahead[:, 2], np.linalg.norm(ahead[:, :2], axis=1))
    rotations = np.array([look(yaw, pitch) for yaw, pitch in zip(yaws, pitches, strict=True)])
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_RADIAL", FOCAL_PX, WIDTH, HEIGHT)
    model.add_camera_with_trivial_rig(camera)
    for index, (centre, rotation) in enumerate(zip(centres / scale, rotations, strict=True)):
        image = pycolmap.Image(name=f"p{index}.png", camera_id=1, image_id=index + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ centre)
        model.add_image_with_trivial_frame(image, pose)
    return Posed(SparseModel(model), centres, rotations)


def matched_scene(folder: Path, num_photos: int) -> tuple[Path, Any]:
    """Return a new database with the matches of photos of 150 points, by one camera, and their true model."""
    pycolmap = load_pycolmap()
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs = options.num_cameras_per_rig = 1
    options.num_frames_per_rig, options.num_points3D = num_photos, 150
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(folder / "database.db") as store:
        return folder / "database.db", pycolmap.synthesize_dataset(options, store)
