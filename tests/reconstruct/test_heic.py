"""A HEIC photo as a telephone writes it is read like any other; runs where the library that decodes them is there."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.reconstruct.images import read_photos
from aquanav_tools.reconstruct.intake.prepare import prepare_photos
from tests.reconstruct.pictures import write_pan

pytest.importorskip("pi_heif", reason="HEIC needs the library pi-heif: pip install 'aquanav[heic]'")

CORNERS = np.array([[[200, 40, 40], [40, 200, 40]], [[40, 40, 200], [200, 200, 200]]], np.uint8)
"""Colours of the quarters of the upright picture, 96 x 64 px."""
FOCAL_35MM = 26.0
TURNED = base64.b64decode("""
AAAAHGZ0eXBoZWljAAAAAG1pZjFoZWljbWlhZgAAAaFtZXRhAAAAAAAAACFoZGxyAAAAAAAAAABwaWN0AAAAAAAAAAAAAAAAAAAAADRpbG9jAAAA
AERAAAIAAQAAAAABxQABAAAAAAAAAMwAAgAAAAACkQABAAAAAAAAAIoAAAA4aWluZgAAAAAAAgAAABVpbmZlAgAAAAABAABodmMxAAAAABVpbmZl
AgAAAQACAABFeGlmAAAAAA5waXRtAAAAAAABAAAA4GlwcnAAAADAaXBjbwAAAHhodmNDAQNwAAAAkAAAAAAAHvAA/P34+AAADwNgAAEAGEABDAH/
/wNwAAADAJAAAAMAAAMAHroCQGEAAQArQgEBA3AAAAMAkAAAAwAAAwAeoCCBhZbqSSmubgIaDAgAAAMAyAAAAwAIQGIAAQAHRAHBcrAiQAAAABNj
b2xybmNseAABAA0ABoAAAAAUaXNwZQAAAAAAAABAAAAAYAAAABBwaXhpAAAAAAMICAgAAAAJaXJvdAMAAAAYaXBtYQAAAAAAAAABAAEFgQIDBIUA
AAAaaXJlZgAAAAAAAAAOY2RzYwACAAEAAQAAAV5tZGF0AAAAyCgBrwngIzaiPvHZPX//J8l//2EV9Kcf4a1L7+APNv/DI2v0MH/7LogPIiXv9KpC
UHq3OFCVssvZWtYf7pq9WG1ry9WPrXh2rRLYUqfhLU74JFgv7ta27t7mesUsAFMvlx0I9OvW5/ptWwjSOJ3rayvlYyOaP/9LarPxxjvzXD+4kYpT
oFHDQyjqzLg4hzmuwfum+S53RhI1H4zMPKR1RTL4HjKWji0+WNpNlay9XbnbMpU1cJ2h12JXb7sWzzrkudMCzNrvdsDYAAAABkV4aWYAAE1NACoA
AAAIAAQBDwACAAAABgAAAD4BEAACAAAACgAAAEQBEgADAAAAAQAGAACHaQAEAAAAAQAAAE4AAAAAQXBwbGUAaVBob25lIDE1AAACkAMAAgAAABQA
AABspAUAAwAAAAEAGgAAAAAAADIwMjY6MTE6MjEgMTA6MDI6MDMA
""")
"""Those quarters, encoded by pillow-heif with x265. Stored turned by a quarter with the turn noted twice, for HEIF
decoders and in EXIF, as telephones do: who follows both turns it too far."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_pan(tmp_path, 3)
    (tmp_path / "IMG_1.HEIC").write_bytes(TURNED)
    return tmp_path


def test_a_heic_photo_is_upright_and_keeps_its_record(folder: Path) -> None:
    photo = next(one for one in read_photos(folder).photos if one.name == "IMG_1.HEIC")
    assert (photo.width, photo.height, photo.camera) == (96, 64, "Apple iPhone 15")
    assert photo.focal_px == pytest.approx(FOCAL_35MM * np.hypot(96, 64) / np.hypot(36, 24))
    assert photo.taken is not None
    assert photo.taken.isoformat() == "2026-11-21T10:02:03"
    assert not photo.is_plain


def test_a_heic_photo_is_prepared_as_the_picture_it_shows(folder: Path, tmp_path: Path) -> None:
    photos = prepare_photos(read_photos(folder), tmp_path / "work")
    with Image.open(photos.path("IMG_1.HEIC")) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    quarters = pixels.reshape(2, 32, 2, 48, 3)[:, 8:24, :, 8:40].mean(axis=(1, 3))
    np.testing.assert_allclose(quarters, CORNERS, atol=4)  # coded twice, with losses


def test_a_heic_photo_cut_short_is_left_out_by_name(folder: Path) -> None:
    (folder / "IMG_2.HEIC").write_bytes(TURNED[:500])
    photos = read_photos(folder)
    assert "IMG_1.HEIC" in photos.names
    (left_out,) = photos.left_out
    assert left_out.name == "IMG_2.HEIC"
    assert "damaged" in left_out.reason or "no picture" in left_out.reason
