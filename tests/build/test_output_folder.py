"""An output folder is recognised as finished, as unfinished, or as somebody else's, whenever its build was killed."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from aquanav_tools.build import output_folder
from aquanav_tools.build.options import BuildOptions, PhotoScaleOptions
from aquanav_tools.build.output_folder import build_key, check_output, is_finished, publish
from aquanav_tools.cave.options import StartOptions
from aquanav_tools.errors import InputError
from aquanav_tools.store import locked

FILES = {"cave.ply": "walls", "report.html": "page", "drawings/plan.svg": "plan", "scenario.toml": "[scenario]"}


@pytest.fixture
def options(tmp_path: Path) -> BuildOptions:
    photos = tmp_path / "photos"
    (photos / "masks").mkdir(parents=True)
    Image.new("L", (80, 60)).save(photos / "a.png")
    Image.new("L", (80, 60)).save(photos / "masks" / "a.png")
    (photos / "positions.csv").write_text("name,x,y,z\n")
    return BuildOptions(photos, tmp_path / "out", scale=PhotoScaleOptions(positions=photos / "positions.csv"))


def write_partial(options: BuildOptions) -> Path:
    partial = options.output.with_name("out.partial")
    (partial / "drawings").mkdir(parents=True, exist_ok=True)
    for name, text in FILES.items():
        (partial / name).write_text(text)
    (partial / "build.json").write_text(json.dumps({"aquanav": "0"}))
    return partial


def build(options: BuildOptions) -> None:
    key = build_key(options)
    check_output(options, key)
    publish(write_partial(options), options.output, key)


def test_a_finished_build_is_recognised_until_anything_that_counts_changes(options: BuildOptions) -> None:
    assert not is_finished(options)
    build(options)
    assert is_finished(options)
    assert is_finished(replace(options, overwrite=True))
    assert not is_finished(replace(options, quality="draft"))
    assert not is_finished(replace(options, starts=StartOptions(count=3)))
    (options.input / "notes.txt").write_text("not a photo")
    assert is_finished(options)
    for path in ("positions.csv", "a.png", "masks/a.png"):
        original = (options.input / path).read_bytes()
        (options.input / path).write_bytes(original + b"\n")
        assert not is_finished(options), path
        (options.input / path).write_bytes(original)
    assert is_finished(options)


def test_the_scenario_s_name_counts_where_it_comes_from_the_folder(options: BuildOptions) -> None:
    build(options)
    moved = options.output.rename(options.output.with_name("moved"))
    assert not is_finished(replace(options, output=moved))
    assert is_finished(replace(options, output=moved, name="out"))


@pytest.mark.parametrize("name", ["report.html", "drawings/plan.svg"])
def test_a_deleted_file_may_be_made_again_and_a_changed_one_not(name: str, options: BuildOptions) -> None:
    build(options)
    (options.output / name).unlink()
    assert not is_finished(options)
    build(options)
    assert is_finished(options)
    (options.output / name).write_text("edited")
    assert not is_finished(options)
    with pytest.raises(InputError, match=rf"already holds a scenario, of which {name} changed since it was built"):
        build(options)
    build(replace(options, overwrite=True))
    assert is_finished(options)


def test_another_scenario_is_not_overwritten(options: BuildOptions) -> None:
    build(options)
    with pytest.raises(InputError, match=r"already holds a scenario\. Name another folder"):
        build(replace(options, seed=1))


def test_a_folder_of_other_things_is_not_written_to(options: BuildOptions) -> None:
    options.output.mkdir()
    (options.output / "build.json").write_text('{"name": "of somebody else"}')
    with pytest.raises(InputError, match=r"holds other files \(build\.json\)"):
        build(options)


def test_a_folder_that_a_killed_build_has_begun_to_fill_is_its_own(options: BuildOptions) -> None:
    with locked(options.output / "work"):
        pass
    (options.output / "cloud.ply").write_text("points")
    build(options)
    assert is_finished(options)


@pytest.mark.parametrize("moved", range(len(FILES) + 1))
def test_a_build_killed_while_its_files_are_moved_can_be_repeated(
    moved: int, options: BuildOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = moved

    def replace_some(source: Path, target: Path) -> None:
        nonlocal left
        if not left:
            raise SystemExit("killed")
        left -= 1
        os.rename(source, target)

    (options.output / "work").mkdir(parents=True)
    monkeypatch.setattr(output_folder.os, "replace", replace_some)
    with pytest.raises(SystemExit):
        build(options)
    assert not (options.output / "scenario.toml").exists()
    assert not is_finished(options)
    monkeypatch.undo()
    build(options)
    assert is_finished(options)
