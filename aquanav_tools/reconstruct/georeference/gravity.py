"""Which way is up by the accelerometer of the camera: in the maker notes of Apple's phones and tablets.

No other maker's records are read: Exif 2.32 has only the size of the acceleration (0x9404) and the elevation of the
lens (0x9405), which leave the roll open, and few cameras write them.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.clues import Ups
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array

EXIF_IFD, MAKER_NOTE, ORIENTATION = 0x8769, 0x927C, 0x0112
UPRIGHT_FROM_STORED = {
    1: np.eye(3),
    3: np.diag([-1.0, -1.0, 1.0]),
    6: np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    8: np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
"""How the camera frame turns with a photo that is set upright, by EXIF orientation; no camera writes mirrored ones."""
APPLE = b"Apple iOS\0"
APPLE_IFD = 14
"""Where its directory begins, after the name, a version and the byte order; offsets count from the note's start."""
ACCELERATION = 0x0008
SIGNED_RATIONAL = 10
HAND_ERROR = np.deg2rad(2.0)
"""Standard deviation of up by one photo taken from the hand, which accelerates; chosen."""
RESTING = (0.9, 1.1)
"""Accelerations in g outside of these are a moving hand's."""
MIN_PHOTOS = 3


@dataclass(frozen=True, eq=False)
class CameraGravity:
    """Up as the cameras felt it."""

    ups: Mapping[str, Array]
    """(3,) unit vectors in the camera frame (x right, y down, z ahead), by photo."""

    def clue(self, sparse: SparseModel) -> Ups:
        """Return up in the model by every registered photo that knows.

        Raises:
            InputError: fewer than MIN_PHOTOS do.
        """
        turns = dict(zip(sparse.names, sparse.rotations, strict=True))
        known = tuple(name for name in self.ups if name in turns)
        if len(known) < MIN_PHOTOS:
            raise InputError(
                f"Only {len(known)} registered photos know which way was down; {MIN_PHOTOS} are needed. Up is taken "
                "from the cameras' mean up direction instead."
            )
        ups = np.array([self.ups[name] @ turns[name] for name in known])
        return Ups("phone accelerometers", known, ups, HAND_ERROR)


def read_gravity(photos: PhotoSet) -> CameraGravity | None:
    """Return up by the photos' own records; None where fewer than MIN_PHOTOS have one."""
    ups = {name: up for name in photos.names if (up := _read_up(photos.path(name))) is not None}
    return CameraGravity(ups) if len(ups) >= MIN_PHOTOS else None


def up_in_camera(acceleration: Array) -> Array:
    """Return the (3,) up direction in the camera frame of the stored picture.

    Args:
        acceleration: (3,) of Apple's AccelerationVector, g. As in Core Motion it points down at rest, in the axes of
            the device: x to its right, y to its top, z out of its face. The picture's columns run from the right of
            the device to its left, its rows from the top to the bottom.

    Source: ExifTool's table of Apple's tags, which gives the axes as those of the force that holds the phone up.
    """
    x, y, z = acceleration / np.linalg.norm(acceleration)
    return np.array([y, x, z])


def _read_up(path: Path) -> Array | None:
    with Image.open(path) as image:
        record = image.getexif()
        orientation, note = record.get(ORIENTATION, 1), record.get_ifd(EXIF_IFD).get(MAKER_NOTE)
    acceleration = apple_acceleration(note) if isinstance(note, bytes) and note.startswith(APPLE) else None
    if acceleration is None or not RESTING[0] < np.linalg.norm(acceleration) < RESTING[1]:
        return None
    turn = UPRIGHT_FROM_STORED.get(orientation)
    return None if turn is None else turn @ up_in_camera(acceleration)


def apple_acceleration(note: bytes) -> Array | None:
    """Return the (3,) AccelerationVector in a maker note, g; None where it has none."""
    try:
        order = {b"MM": ">", b"II": "<"}[note[12:14]]
        (count,) = struct.unpack_from(f"{order}H", note, APPLE_IFD)
        for entry in range(count):
            tag, kind, number, offset = struct.unpack_from(f"{order}HHII", note, APPLE_IFD + 2 + 12 * entry)
            if (tag, kind, number) == (ACCELERATION, SIGNED_RATIONAL, 3):
                parts = np.array(struct.unpack_from(f"{order}6i", note, offset), dtype=np.float64).reshape(3, 2)
                return None if np.any(parts[:, 1] == 0.0) else parts[:, 0] / parts[:, 1]
    except (KeyError, struct.error):  # cut short by a program that copied it
        return None
    return None
