"""Builds from photos that are killed, or run out of disk: what they share.

The stages of the photos and those of the cave are killed apart, each in a file of its own: photos that show a cave all
around are too many for a test.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.folder import read_scenario

RECIPE = 'quality = "draft"\n[photos.features]\nmax_features = 1000\n[photos.depth]\nwidth = 160\n'
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


def moments(rng: np.random.Generator, low: float, high: float) -> list[Any]:
    """Return ten shares of a build's processor time, one of them for `.ci/run` and the others nightly."""
    shares = rng.uniform(low, high, 10).round(3)
    return [pytest.param(share, marks=[pytest.mark.nightly] * (n >= 1)) for n, share in enumerate(shares)]
