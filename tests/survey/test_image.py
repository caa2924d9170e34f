"""Survex image files. Truth: bytes put together here by the format documents, and Survex's own dump."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.survey.image import read_3d
from aquanav_tools.survey.model import LegFlag, StationFlag
from aquanav_tools.survey.read import read_survey
from tests.survey.example import LOOPS, cavern


def place(x: int, y: int, z: int) -> bytes:
    return b"".join(value.to_bytes(4, "little", signed=True) for value in (x, y, z))


def version_8() -> bytes:
    """Return three stations a.1, a.2, a.10 in a row with one splay, sizes at two of them."""
    return b"".join(
        [
            b"Survex 3D Image File\nv8\nTry\0EPSG:32634\n@1371300355\n\0",
            b"\x00\x0f" + place(0, 0, 0),  # normal style; move
            b"\x40\x01a" + place(1000, 0, 0),  # line, label += "a"
            b"\x61" + place(1000, 500, -100),  # line above ground, label unchanged
            b"\x10\x0f" + place(1000, 0, 0) + b"\x64" + place(1000, 0, 250),  # no date; move; splay
            b"\x04\x0f" + place(0, 0, 0) + b"\x60" + place(7, 8, 9) + b"\x00",  # unsurveyed leg; normal style again
            b"\x86\x02.1" + place(0, 0, 0),  # entrance under ground
            b"\x82\x00\x01\x012" + place(1000, 0, 0),  # cut 1, add 1, written the long way
            b"\x81\x1210" + place(1000, 500, -100),  # cut 1, add 2
            b"\x30\x211" + (150).to_bytes(2, "little") + b"\xff\xff" + bytes(4),  # a.1
            b"\x33\x112" + (70000).to_bytes(4, "little") * 4,  # a.2, the last
            b"\x1f" + bytes(20),
            b"\x00",
        ]
    )


def version_3() -> bytes:
    return b"".join(
        [
            b"Survex 3D Image File\nv3\nOld\nSun,2002.03.17 14:01:07 GMT\n",
            b"\x0f" + place(0, 0, 0) + b"\x80\x01a" + place(1000, 0, 0),
            b"\x42\x02.1" + place(0, 0, 0),
            b"\x10\x42\x012" + place(1000, 0, 0),  # cut one letter, add "2"
            b"\x00\x00",  # empty label, end
        ]
    )


def write(tmp_path: Path, content: bytes) -> Path:
    path = tmp_path / "try.3d"
    path.write_bytes(content)
    return path


def test_version_8_is_read_item_by_item(tmp_path: Path) -> None:
    survey = read_3d(write(tmp_path, version_8()))
    assert (survey.title, survey.coordinate_system, survey.separator) == ("Try", "EPSG:32634", ".")
    assert {s.name: s.position.round(3).tolist() for s in survey.stations if s.name} == {
        "a.1": [0, 0, 0],
        "a.2": [10, 0, 0],
        "a.10": [10, 5, -1],
    }
    assert survey.find("a.1").flags == StationFlag.ENTRANCE | StationFlag.UNDERGROUND
    assert [leg.flags for leg in survey.legs] == [LegFlag.NONE, LegFlag.SURFACE, LegFlag.SPLAY, LegFlag.NOSURVEY]
    assert survey.length == pytest.approx(10.0)
    assert survey.segments(survey.splays)[0] == pytest.approx(np.array([[10, 0, 0], [10, 0, 2.5]]))
    (passage,) = survey.passages
    assert passage.lrud == pytest.approx(np.array([[1.5, np.nan, 0, 0], [700.0] * 4]), nan_ok=True)


def test_version_3_is_read(tmp_path: Path) -> None:
    survey = read_survey(write(tmp_path, version_3()))
    assert survey.title == "Old"
    assert survey.find("a.2").position == pytest.approx([10, 0, 0])
    assert survey.length == pytest.approx(10.0)


@pytest.mark.parametrize("version", [3, 4, 5, 6, 7, 8])
def test_every_version_that_cavern_writes_is_read_as_survex_reads_it(tmp_path: Path, version: int) -> None:
    (tmp_path / "loops.svx").write_text(LOOPS)
    positions, length = cavern(tmp_path / "loops.svx", tmp_path)
    old = tmp_path / "old"
    command = ["cavern", f"--3d-version={version}", "-o", str(old), str(tmp_path / "loops.svx")]
    subprocess.run(command, check=True, capture_output=True)
    survey = read_3d(tmp_path / "old.3d")
    named = {station.name: station.position for station in survey.stations if station.name}
    assert named.keys() == positions.keys()
    assert max(np.abs(named[name] - positions[name]).max() for name in named) < 1e-9
    if version < 8:  # older images do not say which legs are unsurveyed, so that these count
        length += float(np.linalg.norm(named["gone.a"] - named["gone.A"]))
    # Positions are rounded to centimetres, each leg's length so by 1.7 cm at most; 20 legs count.
    assert survey.length == pytest.approx(length, abs=20 * 0.0174)
    assert len(survey.passages) == (0 if version < 5 else 1)


def test_any_cut_is_noticed(tmp_path: Path) -> None:
    for content in (version_8(), version_3()):
        for end in range(len(content)):
            with pytest.raises(InputError):
                read_3d(write(tmp_path, content[:end]))


def test_garbage_gets_a_sentence_and_no_traceback(tmp_path: Path, rng: np.random.Generator) -> None:
    for content in (version_8(), version_3()):
        header = content.index(b"\x0f")
        for _ in range(300):
            spoilt = bytearray(content)
            spoilt[rng.integers(header, len(content))] = rng.integers(256)
            try:
                read_3d(write(tmp_path, bytes(spoilt)))
            except InputError as error:
                assert str(error).endswith(".")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"solid cave", "no Survex image file"),
        (version_8().replace(b"v8", b"v9"), "'v9'; 'v3' to 'v8' can be read"),
        (version_8().replace(b"@1371300355\n\0", b"@1371300355\n\x80"), "extended elevation"),
        (version_8()[:-1] + b"\x05", "no item of code 0x05"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_3d(write(tmp_path, content))


def test_an_unknown_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"surveys end in \.3d, \.svx"):
        read_survey(tmp_path / "cave.dat")
