"""A build from photos that is killed, or runs out of disk, ends after the same command as one that was left alone.

The stages of the photos and those of the cave are killed apart: photos that show a cave all around are too many for a
test. Those here end in the finding that they show no cave (the rule is made stricter for it), with their cloud and
cameras beside it.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.photograph.dive import photograph
from aquanav_tools.photograph.options import CameraOptions
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.folder import read_scenario
from tests.disks import fill, small_disk
from tests.reconstruct.scenes import SMALL_DIVE, small_cave

pytestmark = pytest.mark.slow
DIVE = replace(SMALL_DIVE, camera=CameraOptions(width=320, height=240))
RECIPE = 'quality = "draft"\n[photos.features]\nmax_features = 1000\n[photos.depth]\nwidth = 160\n'
STRICT = "from aquanav_tools.cave.closing import enclosure; enclosure.MIN_FACING = 1.0; "
"""Walls that face each other do not make a cave then, so that builds end after the stages of the photos."""
BUILD = ["-c", f"{STRICT}from aquanav_tools.cli.build_cave import main; main()"]
BUILD_A_TUBE = ["-m", "tests.build.tube_build"]
HEIGHT = ("--passage-height", "2")
TIMED = {"build.json", "report.html", "report.json", "stages.png"}
"""Files that tell when and how long; recordings and drawings hold the same that the others do."""


@dataclass(frozen=True)
class Build:
    """A command, and what it left when nobody disturbed it."""

    command: list[str]
    photos: Path
    exit_code: int
    out: Path
    cpu_seconds: float
    results: dict[str, str]

    def start(self, out: Path, *more: str) -> subprocess.Popen[bytes]:
        """Start the command with another output."""
        return start(self.command, self.photos, out, *more)

    def repeat(self, out: Path, *more: str) -> str:
        """Run the command with another output, and return what it says."""
        log = out.with_suffix(".log")
        log.unlink(missing_ok=True)
        assert self.start(out, *more).wait() == self.exit_code, log.read_text()[-2000:]
        return log.read_text()


def start(command: list[str], photos: Path, out: Path, *more: str) -> subprocess.Popen[bytes]:
    # One thread: the CPU time at which a run is killed is then the same place in its work every time.
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    options = ["-o", str(out), "--recipe", str(photos.parent / "recipe.toml"), "--name", "cave", *HEIGHT, *more]
    with out.with_suffix(".log").open("ab") as log:
        arguments = [sys.executable, *command, str(photos), *options]
        return subprocess.Popen(arguments, env=environment, stdout=log, stderr=subprocess.STDOUT)


def undisturbed(command: list[str], photos: Path, exit_code: int) -> Build:
    out = photos.parent / "out"
    (photos.parent / "recipe.toml").write_text(RECIPE)
    # What numba compiles is kept: the first run takes longer than all later ones.
    warm = photos.parent / "warm" / "out"
    warm.parent.mkdir()
    assert start(command, photos, warm).wait() == exit_code
    process, cost = start(command, photos, out), 0.0
    while process.poll() is None:
        cost = cpu_seconds(process.pid)
        time.sleep(0.02)
    assert process.wait() == exit_code, out.with_suffix(".log").read_text()[-2000:]
    found = results(out)
    assert found == results(warm)
    return Build(command, photos, exit_code, out, cost, found)


def cpu_seconds(pid: int) -> float:
    """Return the CPU time of a process so far: fields 14 and 15 of /proc/PID/stat (proc(5)), after its name."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def killed_when(process: subprocess.Popen[bytes], is_due: Callable[[], bool]) -> bool:
    """Kill a process as soon as a condition holds; False when it ended before."""
    while not is_due():
        if process.poll() is not None:
            return False
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


# Not in the last part of a run: the same work takes up to a fifth less CPU time once numba has kept what it compiled.


def kill_and_repeat(build: Build, share: float, out: Path) -> None:
    moment = share * build.cpu_seconds
    process = build.start(out)
    assert killed_when(process, lambda: cpu_seconds(process.pid) >= moment)
    left = sorted(path.name.partition("-")[0] for path in out.glob("work/*-*"))
    print(f"killed after {moment:.1f} of {build.cpu_seconds:.1f} CPU-s; work held {', '.join(left) or 'nothing'}")
    build.repeat(out)
    found = results(out)
    assert found.keys() == build.results.keys()
    assert {name for name in found if found[name] != build.results[name]} == set()


def results(out: Path) -> dict[str, str]:
    """Return hashes of all that a build leaves, but for records of time."""
    if (out / "scenario.toml").exists():
        read_scenario(out)  # checks every file of the scenario
    files = [path for path in out.rglob("*") if path.is_file() and "work" not in path.relative_to(out).parts]
    kept = [path for path in files if path.name not in TIMED and path.suffix not in (".rrd", ".svg")]
    return {path.relative_to(out).as_posix(): file_hash(path) for path in kept}


def stages(out: Path) -> set[str]:
    return {stage["title"] for stage in json.loads((out / "build.json").read_text())["stages"]}


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Build:
    photos = tmp_path_factory.mktemp("dive") / "photos"
    photograph(small_cave(), photos, DIVE)
    build = undisturbed(BUILD, photos, exit_code=4)
    assert {"cloud.ply", "cameras.json"} <= set(build.results)
    return build


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


def moments(rng: np.random.Generator, low: float, high: float) -> list[Any]:
    """Return ten shares of a build's processor time, one of them for `.ci/run` and the others nightly."""
    shares = rng.uniform(low, high, 10).round(3)
    return [pytest.param(share, marks=[pytest.mark.nightly] * (n >= 1)) for n, share in enumerate(shares)]


@pytest.mark.parametrize("share", moments(np.random.default_rng(0), 0.0, 0.75))
def test_photo_stages_killed_at_a_random_moment_end_the_same(share: float, dive: Build, tmp_path: Path) -> None:
    kill_and_repeat(dive, share, tmp_path / "out")


@pytest.mark.parametrize("share", moments(np.random.default_rng(1), 0.3, 0.85))
def test_cave_stages_killed_at_a_random_moment_end_the_same(share: float, tube_dive: Build, tmp_path: Path) -> None:
    kill_and_repeat(tube_dive, share, tmp_path / "out")


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
