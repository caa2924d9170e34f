"""Which way is up: what a phone felt, and a level floor."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.errors import InputError
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.reconstruct.georeference.floor import floor_clue
from aquanav_tools.reconstruct.georeference.gravity import apple_acceleration, read_gravity, up_in_camera
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.types import Array
from tests.reconstruct.test_scale_sources import NAMES, photos_at


@pytest.mark.parametrize(
    ("felt", "up"),
    [
        ([-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]),  # held across, its top to the left: the picture is upright as stored
        ([0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]),  # held upright: the picture's left edge is the phone's top
        ([0.0, 0.0, -1.0], [0.0, 0.0, -1.0]),  # lying on its back: the lens looks down, up is behind it
    ],
)
def test_a_phones_acceleration_tells_up_in_the_picture(felt: list[float], up: list[float]) -> None:
    np.testing.assert_allclose(up_in_camera(np.array(felt)), up)


def apple_note(acceleration: tuple[float, float, float]) -> bytes:
    """A maker note with two entries, as Apple's phones write them."""
    entries = struct.pack(">HHII", 1, 9, 1, 14) + struct.pack(">HHII", 8, 10, 3, 14 + 2 + 24 + 4)
    numbers = [part for value in acceleration for part in (round(value * 10_000), 10_000)]
    return b"Apple iOS\0\0\x01MM" + struct.pack(">H", 2) + entries + bytes(4) + struct.pack(">6i", *numbers)


def test_the_acceleration_is_read_from_a_maker_note() -> None:
    np.testing.assert_allclose(apple_acceleration(apple_note((-0.6, -0.8, 0.01))), [-0.6, -0.8, 0.01])


def test_a_maker_note_that_was_cut_short_tells_nothing() -> None:
    assert apple_acceleration(apple_note((0.0, -1.0, 0.0))[:40]) is None


def phone_photos(folder: Path, felt: tuple[float, float, float], orientation: int) -> PhotoSet:
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif.get_ifd(0x8769)[0x927C] = apple_note(felt)
    for name in NAMES[:3]:
        Image.new("RGB", (64, 48)).save(folder / name, exif=exif)
    return photos_at([None] * 3, folder)


@pytest.mark.parametrize(
    ("felt", "orientation"), [((-1.0, 0.0, 0.0), 1), ((0.0, -1.0, 0.0), 6), ((1.0, 0.0, 0.0), 3), ((0.0, 1.0, 0.0), 8)]
)
def test_up_is_up_in_photos_that_were_set_upright(
    tmp_path: Path, felt: tuple[float, float, float], orientation: int
) -> None:
    gravity = read_gravity(phone_photos(tmp_path, felt, orientation))
    assert gravity is not None
    for up in gravity.ups.values():
        np.testing.assert_allclose(up, [0.0, -1.0, 0.0], atol=1e-9)


def test_a_phone_that_was_shaken_tells_nothing(tmp_path: Path) -> None:
    assert read_gravity(phone_photos(tmp_path, (-1.3, 0.0, 0.0), 1)) is None


def cave_floor(rng: np.random.Generator, roughness: float) -> tuple[Array, Array, Array]:
    """Points of a gallery, cameras in it and their rotations, all leaning by 10 degrees as the cameras were held."""
    along, across = rng.uniform(0, 12, 1500), rng.uniform(-1.5, 1.5, 1500)
    floor = np.stack([along, across, rng.normal(-1.5, roughness, 1500)], axis=1)
    walls = np.stack([rng.uniform(0, 12, 2000), 1.5 * rng.choice([-1, 1], 2000), rng.uniform(-1.5, 1.5, 2000)], axis=1)
    centres = np.stack([np.linspace(1, 11, 9), rng.normal(0, 0.1, 9), rng.normal(0, 0.1, 9)], axis=1)
    lean = look(0.0, 0.0) @ look(0.0, 0.0, np.deg2rad(10.0)).T
    cameras = np.array([lean @ look(yaw, 0.0) for yaw in rng.uniform(-0.5, 0.5, 9)])
    return np.concatenate([floor, walls]), centres, cameras


def test_a_level_floor_tells_up_where_cameras_leaned(rng: np.random.Generator) -> None:
    clue = floor_clue(*cave_floor(rng, 0.02), seed=0)
    off = np.arccos(clue.sfm[0, 2])
    assert off < 1.96 * clue.error < np.deg2rad(4.0)


def test_a_heap_of_boulders_is_no_level_floor(rng: np.random.Generator) -> None:
    points, centres, rotations = cave_floor(rng, 0.02)
    below = points[:, 2] < -0.5
    points[below] += rng.normal(0.0, 0.8, (below.sum(), 3))
    with pytest.raises(InputError, match=r"points below the cameras no \d+ lie on a plane.*--level-floor"):
        floor_clue(points, centres, rotations, seed=0)


# All of them.
