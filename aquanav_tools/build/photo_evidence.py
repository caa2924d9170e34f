"""What photos tell about the water: where the cameras were, the ways between them, and how far each looked."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.closing.evidence import Evidence
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.types import Array, BoolArray

NUM_PLACES = 32
"""Places on a way from camera to camera at which is asked whether it leads through water."""
NEAR_SHARE = 0.25
"""Of a way, at both ends: nobody sees the water right around a camera."""


def photo_evidence(reconstruction: Reconstruction, is_inside: BoolArray) -> Evidence:
    """Return what is known to be water.

    Args:
        reconstruction: world, m.
        is_inside: (N,) which cameras had walls around them; others may have stood outside before the entrance.
    """
    centres, sight = reconstruction.camera_centres, reconstruction.sight
    if sight is None:
        return Evidence(centres[is_inside])
    return Evidence(centres[is_inside], _legs(reconstruction, is_inside), sight)


def _legs(reconstruction: Reconstruction, is_inside: BoolArray) -> Array:
    """Return the (M, 2, 3) straight ways from photo to photo, in the order they were taken, that some photo shows free.

    Between two dives, or where photos are missing, the straight way may lead through rock.
    """
    assert reconstruction.sight is not None
    ends = reconstruction.camera_centres
    legs = np.stack([ends[:-1], ends[1:]], axis=1)[is_inside[:-1] & is_inside[1:]]
    shares = np.linspace(NEAR_SHARE, 1.0 - NEAR_SHARE, NUM_PLACES)[:, None, None]
    places = (1.0 - shares) * legs[:, 0] + shares * legs[:, 1]
    is_free = reconstruction.sight.num_through(places.reshape(-1, 3), 0.0, 1).reshape(NUM_PLACES, -1) > 0
    chosen: Array = legs[is_free.all(axis=0)]
    return chosen
