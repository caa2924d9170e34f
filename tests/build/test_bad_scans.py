"""The command aquanav-build-cave on scans that are no cave, or no scan: a sentence, an exit code, and nothing lost."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import trimesh

from aquanav_tools.synthetic.caves import tube
from tests.build.test_scan_build import run
from tests.cave.open_caves import wavy_sheet
from tests.lighter import lighten_builds


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    lighten_builds(monkeypatch)


def a_sheet(path: Path) -> None:
    wavy_sheet().to_trimesh().export(path)


def a_mesh_with_nan(path: Path) -> None:
    box = trimesh.creation.box()
    lines = box.export(file_type="obj").splitlines()
    first = next(n for n, line in enumerate(lines) if line.startswith("v "))
    path.write_text("\n".join([*lines[:first], "v nan 0 0", *lines[first + 1 :]]))


def a_thin_pipe(path: Path) -> None:
    tube(0.1, 8.0).mesh.to_trimesh().export(path)


def a_cave_in_millimetres(path: Path) -> None:
    mesh = tube(1.0, 8.0).mesh.to_trimesh()
    mesh.apply_scale(1000.0)
    mesh.export(path)


def a_header_of_fifty_million_points(path: Path) -> None:
    lines = ["ply", "format binary_little_endian 1.0", "element vertex 50000000", "property float x"]
    path.write_text("\n".join([*lines, "property float y", "property float z", "end_header", ""]))


def a_boulder(path: Path) -> None:
    trimesh.creation.icosphere(4, 2.0).export(path)


def two_caves(path: Path) -> None:
    one = tube(1.0, 8.0).mesh.to_trimesh()
    trimesh.util.concatenate([one, one.copy().apply_translation([0.0, 5.0, 0.0])]).export(path)


@pytest.mark.parametrize(
    ("name", "make", "flags", "message"),
    [
        ("sheet.ply", a_sheet, (), "no cave|encloses no space"),
        ("pipe.stl", a_thin_pipe, (), "choose a smaller vehicle"),
        ("boulder.stl", a_boulder, (), "This is a solid without an inside: .* as a boulder does"),
        ("two.stl", two_caves, (), r"two separate caves: .* choose one with --inside"),
        (
            "tube.stl",
            lambda path: tube(1.0, 8.0).mesh.to_trimesh().export(path),
            ("--cut", *"4 9 0 1 0 0".split()),
            "misses",
        ),
    ],
)
def test_a_scan_that_is_no_cave_ends_with_a_sentence_and_a_report(
    name: str, make: object, flags: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    make(tmp_path / name)  # type: ignore[operator]
    result = run(tmp_path / name, "-o", tmp_path / "out", *flags)
    assert result.returncode == 4, result.stderr
    assert re.search(message, result.stderr)
    assert "Traceback" not in result.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} <= {
        "report.html",
        "report.json",
        "build.json",
        "faults.png",
        "drawings",
        "work",
    }
    assert re.search(message, json.loads((tmp_path / "out" / "report.json").read_text())["error"])


@pytest.mark.parametrize(
    ("name", "make", "flags", "code", "message"),
    [
        ("missing.stl", None, (), 2, "There is no file or folder"),
        ("nan.obj", a_mesh_with_nan, (), 2, "1 of 8 points with coordinates that are not finite"),
        (
            "mm.stl",
            a_cave_in_millimetres,
            (),
            2,
            "m wide: are these millimetres? Then give --unit mm",
        ),
        (
            "mm.stl",
            a_cave_in_millimetres,
            ("--unit", "km"),
            2,
            "With --unit km the cave is 8,000,000 m long",
        ),
        ("far.ply", a_header_of_fifty_million_points, (), 2, "its header announces 50,000,000 of vertex"),
        ("sheet.ply", a_sheet, ("--vehicle", "bluerov"), 2, "Did you mean 'bluerov2'"),
        ("sheet.ply", a_sheet, ("--unit", "furlong"), 2, "furlong"),
        ("sheet.ply", a_sheet, ("--recipe", "none.toml"), 2, "There is no file none.toml"),
    ],
)
def test_bad_input_ends_with_a_sentence_and_writes_nothing(
    name: str, make: object, flags: tuple[str, ...], code: int, message: str, tmp_path: Path
) -> None:
    if make is not None:
        make(tmp_path / name)  # type: ignore[operator]
    result = run(tmp_path / name, "-o", tmp_path / "out", *flags)
    assert result.returncode == code, result.stderr
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / "out.partial").exists()
