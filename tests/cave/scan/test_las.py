"""LAS and LAZ files that announce more than they hold, and a decoder that dies."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.scan import laz
from aquanav_tools.cave.scan.las import read_las, read_layout
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array

POINT_COUNT, NUM_RECORDS, POINTS_AT, COUNT_1_4 = 107, 100, 96, 247
"""Places in a header, by the specification's table 3."""


def points_of(num: int) -> Array:
    return np.random.default_rng(0).uniform(-5.0, 5.0, (num, 3)).round(3)


def write(path: Path, points: Array, version: str = "1.2") -> Path:
    import laspy

    header = laspy.LasHeader(point_format=3 if version == "1.2" else 7, version=version)
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.xyz = points
    las.red = las.green = las.blue = np.full(len(points), 25700)
    las.write(path)
    return path


def patch(path: Path, place: int, form: str, value: int) -> Path:
    content = bytearray(path.read_bytes())
    struct.pack_into(form, content, place, value)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("version", ["1.2", "1.4"])
def test_laz_gives_the_points_and_colours_of_las(tmp_path: Path, version: str) -> None:
    points = points_of(300)
    plain, _ = read_las(write(tmp_path / "a.las", points, version))
    packed, _ = read_las(write(tmp_path / "a.laz", points, version))
    assert np.allclose(plain.points, points, atol=6e-4)
    assert np.array_equal(packed.points, plain.points)
    assert packed.colours is not None
    assert (packed.colours == 100).all()
    assert read_layout(tmp_path / "a.laz").is_packed


@pytest.mark.parametrize(
    ("place", "form", "value", "words"),
    [
        (POINT_COUNT, "<I", 301, "announces 301 points, and its .* bytes hold 300 at most"),
        (POINT_COUNT, "<I", 0xFFFFFFFF, "announces 4,294,967,295 points"),
        (NUM_RECORDS, "<I", 0xFFFFFFFF, "4,294,967,295 records before the points"),  # took hours to read
        (POINTS_AT, "<I", 0xFFFFFFFF, "begin at byte 4,294,967,295"),
        (25, "<B", 9, "do not begin with a header of LAS"),
    ],
)
def test_a_header_is_held_against_the_files_size(tmp_path: Path, place: int, form: str, value: int, words: str) -> None:
    path = patch(write(tmp_path / "a.las", points_of(300)), place, form, value)
    with pytest.raises(InputError, match=words):
        read_las(path)


def test_the_count_of_version_1_4_is_held_against_the_files_size_too(tmp_path: Path) -> None:
    path = patch(write(tmp_path / "a.laz", points_of(300), "1.4"), COUNT_1_4, "<Q", 1 << 60)
    with pytest.raises(InputError, match="1,152,921,504,606,846,976 points"):
        read_las(path)


def test_a_laz_file_that_makes_the_decoder_fail_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.laz", points_of(300))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match=r"a\.laz cannot be read as LAZ: .*after 0 of 300 points"):
        read_las(path)


DEATHS = {
    "abort": ("import os; os.abort()", "the decoder ended with SIGABRT"),
    "memory": ("x = bytearray(1 << 40)", "MemoryError"),
    "hang": ("while True: pass", "unpacking it took more than 1 s of processor time"),
    "exit": ("raise SystemExit(3)", "the decoder ended with code 3"),
}


@pytest.mark.parametrize("death", DEATHS)
def test_a_decoder_that_dies_becomes_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, death: str) -> None:
    code, words = DEATHS[death]
    (tmp_path / "laspy.py").write_text(f"def open(*_, **__):\n    {code}\nclass LazBackend: Lazrs = None\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(laz, "LEAST_SECONDS", 1)
    with pytest.raises(InputError, match=words):
        list(laz.unpacked_tables(tmp_path / "a.laz", (), 1000, 300))
