"""A build from photos that is killed in the stages of the cave ends as one left alone; a finished one is left so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.build.killed import Build, kill_and_repeat, killed_when, moments, results, undisturbed

pytestmark = pytest.mark.slow
BUILD_A_TUBE = ["-m", "tests.build.tube_build"]


def stages(out: Path) -> set[str]:
    return {stage["title"] for stage in json.loads((out / "build.json").read_text())["stages"]}


@pytest.fixture(scope="module")
def tube_dive(tmp_path_factory: pytest.TempPathFactory) -> Build:
    photos = tmp_path_factory.mktemp("tube") / "photos"
    photos.mkdir()
    for n in range(4):
        noise = np.random.default_rng(n).integers(0, 255, (60, 80, 3), dtype=np.uint8)
        Image.fromarray(noise).save(photos / f"p{n}.png")
    build = undisturbed(BUILD_A_TUBE, photos, exit_code=0)
    assert {"scenario.toml", "cave.ply", "field.npz", "cloud.ply", "cameras.json", "cave.png"} <= set(build.results)
    return build


@pytest.mark.parametrize("share", moments(np.random.default_rng(1), 0.3, 0.85))
def test_cave_stages_killed_at_a_random_moment_end_the_same(share: float, tube_dive: Build, tmp_path: Path) -> None:
    kill_and_repeat(tube_dive, share, tmp_path / "out")


def test_a_finished_build_is_recognised_and_what_is_deleted_of_it_made_again(tube_dive: Build) -> None:
    built = (tube_dive.out / "build.json").stat().st_mtime_ns
    assert "is already what these photos and options lead to; nothing was done" in tube_dive.repeat(tube_dive.out)
    assert (tube_dive.out / "build.json").stat().st_mtime_ns == built
    assert "Closing the cavity" in stages(tube_dive.out)
    for name in ("report.html", "build.rrd", "cave.png"):
        (tube_dive.out / name).unlink()
    tube_dive.repeat(tube_dive.out)
    assert "Closing the cavity" not in stages(tube_dive.out)
    assert (tube_dive.out / "report.html").exists()
    assert (tube_dive.out / "build.rrd").exists()
    assert results(tube_dive.out) == tube_dive.results


def test_a_changed_file_or_option_is_not_overwritten_unasked(tube_dive: Build) -> None:
    log = tube_dive.out.with_suffix(".log")
    assert tube_dive.start(tube_dive.out, "--starts.count", "12").wait() == 2
    assert "already holds a scenario. Name another folder with -o, or add --overwrite" in log.read_text()
    picture = tube_dive.out / "cave.png"
    original = picture.read_bytes()
    picture.write_bytes(b"mine")
    assert tube_dive.start(tube_dive.out).wait() == 2
    picture.write_bytes(original)
    assert "already holds a scenario, of which cave.png changed since it was built" in log.read_text()


def test_a_build_killed_while_it_moves_its_files_into_place_can_be_repeated(tube_dive: Build, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = tube_dive.start(out)
    assert killed_when(process, lambda: (out / "build.json").exists())
    assert not (out / "scenario.toml").exists() or results(out) == tube_dive.results
    tube_dive.repeat(out)
    assert results(out) == tube_dive.results
