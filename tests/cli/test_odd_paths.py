"""Whole commands where input, cache and output lie below a folder with spaces, umlauts and another script."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from aquanav_tools.machine import CACHE_VARIABLE
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.synthetic.caves import tube

ODD = "Höhle 洞 2"


def run(folder: Path, *words: object) -> str:
    """Return what a command prints that runs in a folder, with its cache there; paths are relative to it."""
    command = [sys.executable, "-c", "from aquanav_tools.cli.info import main; main()", *map(str, words)]
    python_path = os.pathsep.join(sys.path)
    environment = os.environ | {CACHE_VARIABLE: str(folder / "cache"), "PYTHONPATH": python_path}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode()


@pytest.mark.slow
def test_commands_work_below_a_folder_of_any_name(tmp_path: Path) -> None:
    folder = tmp_path / ODD
    folder.mkdir()
    scan, cave = folder / f"scan {ODD}.stl", folder / "Höhle"
    tube(1.0, 12.0, sections=32, rings=31).mesh.to_trimesh().export(scan)
    run(folder, "build", scan, "-o", cave, "--starts.count", 20)
    assert read_scenario(cave).name == "Höhle"
    drawn = Path(run(folder, "generate", "--style", "maze", "--seed", 17).strip())
    assert drawn.parent.parent == folder / "cache"
    run(folder, "train", "--scenario", cave, "--steps", 256, "--final-episodes", 1, "-o", folder / "Lauf 洞")
    policy = folder / "Lauf 洞" / "policy.zip"
    run(folder, "eval", policy, "--scenario", cave, "generated/maze/17", "--episodes", 2, "-o", folder / "eval 洞")
    assert (folder / "eval 洞" / "results.json").is_file() and (folder / "eval 洞" / "report.html").is_file()
    run(folder, "eval", "replay", folder / "eval 洞", "--episode", 1, "-o", folder / "noch einmal 洞")
