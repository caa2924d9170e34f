"""A build from photos that is killed, or runs out of disk, ends after the same command as one that was left alone.

And what is finished is taken up: all of it, or all that a changed option or a deleted file leaves.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.synthetic.caves import CaveOptions, demo_cave
from aquanav_tools.photograph.dive import photograph
from aquanav_tools.photograph.options import CameraOptions, CaptureOptions, DiveOptions
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.folder import read_scenario
from tests.build.test_scan_build import run
from tests.disks import fill, small_disk

pytestmark = pytest.mark.slow
NUM_KILLS = 10
CAVE = CaveOptions(length=3.6, radius=1.0, winding=0.3, voxel=0.06)
DIVE = DiveOptions(
    camera=CameraOptions(width=480, height=360),
    capture=CaptureOptions(photos=20, start_margin=0.5, end_margin=0.5),
)
RECIPE = (
    'quality = "draft"\n[photos.features]\nmax_features = 2000\n[photos.depth]\nwidth = 240\n[starts]\ncount = 10\n'
)
COMMAND = "from aquanav_tools.cli.build_cave import main; main()"
TIMED = {"build.json", "report.html", "report.json"}
"""Files that tell when and how long."""


@dataclass(frozen=True)
class Built:
    """A build that nobody disturbed."""

    photos: Path
    out: Path
    cpu_seconds: float
    results: dict[str, str]


def arguments(photos: Path, out: Path) -> list[str]:
    recipe, positions = photos.parent / "recipe.toml", photos / "positions.csv"
    return [str(photos), "-o", str(out), "--recipe", str(recipe), "--positions", str(positions), "--name", "cave"]


def start(photos: Path, out: Path) -> subprocess.Popen[bytes]:
    # One thread: the CPU time at which a run is killed is then the same place in its work every time.
    environment = {**os.environ, "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with out.with_suffix(".log").open("ab") as log:
        command = [sys.executable, "-c", COMMAND, *arguments(photos, out)]
        return subprocess.Popen(command, env=environment, stdout=log, stderr=subprocess.STDOUT)


def finished(process: subprocess.Popen[bytes], out: Path) -> Path:
    assert process.wait() == 0, out.with_suffix(".log").read_text()[-2000:]
    return out


def cpu_seconds(pid: int) -> float:
    """Return the CPU time of a process so far: fields 14 and 15 of /proc/PID/stat (proc(5)), after its name."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ended_when(process: subprocess.Popen[bytes], is_due: Callable[[], bool]) -> bool:
    """Kill a process as soon as a condition holds; False when it ended before."""
    while not is_due():
        if process.poll() is not None:
            return False
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


def results(out: Path) -> dict[str, str]:
    """Return hashes of all that a build leaves, but for records of time and the recordings, which hold it too."""
    read_scenario(out)  # checks every file of the scenario
    files = [path for path in out.rglob("*") if path.is_file() and "work" not in path.relative_to(out).parts]
    kept = [path for path in files if path.name not in TIMED and path.suffix not in (".rrd", ".svg")]
    return {path.relative_to(out).as_posix(): file_hash(path) for path in kept}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Built:
    folder = tmp_path_factory.mktemp("dive")
    photos, out = folder / "photos", folder / "out"
    photograph(demo_cave(CAVE), photos, DIVE)
    (folder / "recipe.toml").write_text(RECIPE)
    process = start(photos, out)
    cost = 0.0
    while process.poll() is None:
        cost = cpu_seconds(process.pid)
        time.sleep(0.02)
    finished(process, out)
    return Built(photos, out, cost, results(out))


def test_a_build_leaves_all_its_files(undisturbed: Built) -> None:
    assert {"scenario.toml", "cave.ply", "field.npz", "cloud.ply", "cameras.json"} <= set(undisturbed.results)


@pytest.mark.parametrize("number", range(NUM_KILLS))
def test_a_build_killed_at_a_random_moment_ends_the_same(number: int, undisturbed: Built, tmp_path: Path) -> None:
    moments = np.random.default_rng(0).uniform(0.0, undisturbed.cpu_seconds, NUM_KILLS)
    moment, out = np.sort(moments)[number], tmp_path / "out"
    process = start(undisturbed.photos, out)
    was_killed = ended_when(process, lambda: cpu_seconds(process.pid) >= moment)
    left = sorted(path.name for path in out.glob("work/*"))
    print(f"killed after {moment:.1f} of {undisturbed.cpu_seconds:.1f} CPU-s: work held {', '.join(left) or 'nothing'}")
    assert was_killed
    found = results(finished(start(undisturbed.photos, out), out))
    assert found.keys() == undisturbed.results.keys()
    assert {name for name in found if found[name] != undisturbed.results[name]} == set()


def test_a_second_run_finds_that_nothing_is_left_to_do(undisturbed: Built, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aquanav_tools.build.recipe.build_cave", None)
    before = (undisturbed.out / "build.json").stat().st_mtime_ns
    again = run(*arguments(undisturbed.photos, undisturbed.out))
    assert again.returncode == 0, again.stderr
    assert "is already what these photos and options lead to; nothing was done" in again.stdout
    assert (undisturbed.out / "build.json").stat().st_mtime_ns == before


def stages(out: Path) -> list[str]:
    return [stage["title"] for stage in json.loads((out / "build.json").read_text())["stages"]]


def test_deleted_reports_are_made_again_without_closing_again(undisturbed: Built) -> None:
    assert "Closing the cavity" in stages(undisturbed.out)
    for name in ("report.html", "build.rrd", "cave.png"):
        (undisturbed.out / name).unlink()
    again = run(*arguments(undisturbed.photos, undisturbed.out))
    assert again.returncode == 0, again.stderr
    assert "Closing the cavity" not in stages(undisturbed.out)
    assert (undisturbed.out / "report.html").exists()
    assert (undisturbed.out / "build.rrd").exists()
    assert results(undisturbed.out) == undisturbed.results


def test_a_changed_file_or_option_is_not_overwritten_unasked(undisturbed: Built) -> None:
    result = run(*arguments(undisturbed.photos, undisturbed.out), "--starts.count", 12)
    assert result.returncode == 2
    assert "already holds a scenario. Name another folder with -o, or add --overwrite" in result.stderr
    picture = undisturbed.out / "cave.png"
    original = picture.read_bytes()
    picture.write_bytes(b"mine")
    result = run(*arguments(undisturbed.photos, undisturbed.out))
    picture.write_bytes(original)
    assert result.returncode == 2
    assert "already holds a scenario, of which cave.png changed since it was built" in result.stderr


def test_a_changed_fusion_option_measures_no_depth_again(undisturbed: Built, monkeypatch: pytest.MonkeyPatch) -> None:
    (undisturbed.photos.parent / "recipe.toml").write_text(RECIPE + "[photos.fusion]\nmin_photos = 3\n")
    work = undisturbed.out / "work"
    before = {path.name: (path / "done.json").stat().st_mtime_ns for path in work.glob("*-*")}
    again = run(*arguments(undisturbed.photos, undisturbed.out), "--overwrite")
    (undisturbed.photos.parent / "recipe.toml").write_text(RECIPE)
    assert again.returncode == 0, again.stderr
    after = {path.name: (path / "done.json").stat().st_mtime_ns for path in work.glob("*-*")}
    assert before.items() <= after.items()
    assert {name.split("-")[0] for name in after.keys() - before.keys()} == {"fused", "cave"}
    back = run(*arguments(undisturbed.photos, undisturbed.out), "--overwrite")
    assert back.returncode == 0, back.stderr
    assert results(undisturbed.out) == undisturbed.results


def test_a_disk_that_fills_up_stops_a_build_and_room_lets_it_end_the_same(undisturbed: Built, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 400) as disk:
        out = disk / "out"
        process = start(undisturbed.photos, out)
        while not list(out.glob("work/matches-*/round-0.txt")):
            assert process.poll() is None, out.with_suffix(".log").read_text()[-2000:]
            time.sleep(0.02)
        filler = fill(disk, leave_megabytes=50)
        assert process.wait() == 6
        told = out.with_suffix(".log").read_text()
        assert "is full: " in told
        assert "run the same command again: it goes on where it stopped" in told
        assert "Traceback" not in told
        assert not (out / "scenario.toml").exists()
        filler.unlink()
        assert results(finished(start(undisturbed.photos, out), out)) == undisturbed.results
