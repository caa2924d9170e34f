"""What cameras in a cave of known walls see."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.scan.sight import Sight, make_sight
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.types import Mesh

WIDTH, HEIGHT, FOCAL = 120, 90, 50.0


def sight_of(wall: Mesh, places: np.ndarray, yaw_deg: float, pitch_deg: float = 0.0) -> Sight:
    """What cameras at (N, 3) places in the true cave see; nothing where they look out of it."""
    scene, rotation = SmoothScene(wall), look(np.radians(yaw_deg), np.radians(pitch_deg))
    u, v = np.meshgrid((np.arange(WIDTH) + 0.5 - WIDTH / 2) / FOCAL, (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / FOCAL)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    depths = [scene.cast(place, rays @ rotation)[0].reshape(HEIGHT, WIDTH) for place in places]
    poses = np.array([np.column_stack([rotation, -rotation @ place]) for place in places])
    pinholes = np.tile([FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2], (len(places), 1))
    return make_sight(poses, pinholes, [np.nan_to_num(depth).astype(np.float32) for depth in depths])
