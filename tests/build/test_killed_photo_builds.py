"""A build from photos that is killed, or runs out of disk, in the stages of the photos, ends as one left alone.

The photos end in the finding that they show no cave (the rule is made stricter for it), with their cloud and cameras
beside it.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.photograph.dive import photograph
from aquanav_tools.photograph.options import CameraOptions
from aquanav_tools.provenance import file_hash
from tests.build.killed import RECIPE, Build, kill_and_repeat, moments, results, undisturbed
from tests.disks import fill, small_disk
from tests.reconstruct.scenes import SMALL_DIVE, small_cave

pytestmark = pytest.mark.slow
DIVE = replace(SMALL_DIVE, camera=CameraOptions(width=320, height=240))
STRICT = "from aquanav_tools.cave.closing import ambient_occlusion; ambient_occlusion.MIN_FACING = 1.0; "
"""Walls that face each other do not make a cave then, so that builds end after the stages of the photos."""
BUILD = ["-c", f"{STRICT}from aquanav_tools.cli.build_cave import main; main()"]


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Build:
    photos = tmp_path_factory.mktemp("dive") / "photos"
    photograph(small_cave(), photos, DIVE)
    build = undisturbed(BUILD, photos, exit_code=4)
    assert {"cloud.ply", "cameras.json"} <= set(build.results)
    return build


@pytest.mark.parametrize("share", moments(np.random.default_rng(0), 0.0, 0.75))
def test_photo_stages_killed_at_a_random_moment_end_the_same(share: float, dive: Build, tmp_path: Path) -> None:
    kill_and_repeat(dive, share, tmp_path / "out")


def test_a_changed_fusion_option_fuses_again_and_does_nothing_else(dive: Build) -> None:
    recipe, work = dive.photos.parent / "recipe.toml", dive.out / "work"
    before = {path.name: (path / "done.json").stat().st_mtime_ns for path in work.glob("*-*")}
    recipe.write_text(RECIPE + "[photos.fusion]\nmin_photos = 3\n")
    dive.repeat(dive.out)
    recipe.write_text(RECIPE)
    after = {path.name: (path / "done.json").stat().st_mtime_ns for path in work.glob("*-*")}
    assert before.items() <= after.items()
    assert {name.partition("-")[0] for name in after.keys() - before.keys()} == {"fused"}
    assert file_hash(dive.out / "cloud.ply") != dive.results["cloud.ply"]
    dive.repeat(dive.out)
    assert results(dive.out) == dive.results


def test_a_disk_that_fills_up_stops_a_build_and_room_lets_it_end_the_same(dive: Build, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 400) as disk:
        out = disk / "out"
        process = dive.start(out)
        while not list(out.glob("work/matches-*/round-0.txt")):
            assert process.poll() is None, out.with_suffix(".log").read_text()[-2000:]
            time.sleep(0.02)
        filler = fill(disk, leave_megabytes=50)
        assert process.wait() == 6
        told = out.with_suffix(".log").read_text()
        assert "is full: " in told
        assert "run the same command again: it goes on where it stopped" in told
        assert "Traceback" not in told
        filler.unlink()
        dive.repeat(out)
        assert results(out) == dive.results
