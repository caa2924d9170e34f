"""What photos tell about the water: where the cameras were, the ways between them, and how far each looked."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.closing.free_space import FreeSpace
from aquanav_tools.cave.scan.sight import NO_WALL, OUTSIDE, UNSURE, Sight
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.types import Array, BoolArray

NUM_PLACES = 32
"""Places on a way from camera to camera at which is asked whether it leads through water."""
AHEAD = 0.5
"""Share of the way to the wall in the middle of a photo that is surely water; chosen."""
MAX_LEGS = 3.0
"""A way longer than this many typical ones is no way that was swum: photos are missing, or another dive began."""


def photo_free_space(reconstruction: Reconstruction, is_inside: BoolArray, *, accept_open: bool = False) -> FreeSpace:
    """Return what is known to be water.

    Args:
        reconstruction: world, m.
        is_inside: (N,) which cameras had walls around them; others may have stood outside before the entrance.
        accept_open: where walls are missing, the surface walls in cameras that nothing behind them shows: the ways
            straight ahead of them count too.
    """
    centres, sight = reconstruction.camera_centres, reconstruction.sight
    if sight is None:
        return FreeSpace(centres[is_inside])
    legs = _legs(reconstruction, is_inside, sight)
    if accept_open:
        legs = np.concatenate([legs, ways_ahead(sight)])
    return FreeSpace(centres[is_inside], legs, sight)


def ways_ahead(sight: Sight) -> Array:
    """Return the (M, 2, 3) ways from cameras straight ahead, half as far as the wall that they show there."""
    height, width = sight.depth.shape[1:]
    middle = sight.depth[:, height // 3 : height - height // 3, width // 3 : width - width // 3].reshape(
        len(sight.depth), -1
    )
    is_wall = middle > UNSURE
    seeing = is_wall.any(axis=1)
    reach = np.array([np.median(depth[wall]) for depth, wall in zip(middle[seeing], is_wall[seeing], strict=True)])
    starts, ahead = sight.centres[seeing], sight.poses[seeing, 2, :3]
    ways: Array = np.stack([starts, starts + AHEAD * reach[:, None] * ahead], axis=1)
    return ways


def _legs(reconstruction: Reconstruction, is_inside: BoolArray, sight: Sight) -> Array:
    """Return the (M, 2, 3) straight ways from photo to photo, in the order they were taken, that lead through water.

    At every place some photo looks through it, or at it without finding wall: far down a passage there is only dark.
    """
    ends = reconstruction.camera_centres
    legs = np.stack([ends[:-1], ends[1:]], axis=1)[is_inside[:-1] & is_inside[1:]]
    lengths = np.linalg.norm(legs[:, 1] - legs[:, 0], axis=1)
    legs = legs[lengths <= MAX_LEGS * np.median(lengths)] if len(legs) else legs
    shares = ((np.arange(NUM_PLACES) + 0.5) / NUM_PLACES)[:, None, None]
    ahead, seen = sight.look(((1.0 - shares) * legs[:, 0] + shares * legs[:, 1]).reshape(-1, 3))
    is_free = ((seen > ahead) | (seen == NO_WALL)) & (seen != OUTSIDE)
    chosen: Array = legs[is_free.any(axis=1).reshape(NUM_PLACES, -1).all(axis=0)]
    return chosen
