"""A world for Gazebo is read by Gazebo's own parser, where Debian's libsdformat is installed."""

from __future__ import annotations

import ctypes
import re
import subprocess
import sys
from pathlib import Path

import pytest

from aquanav_tools.export.formats import export_scenario
from tests.caves import tube_scenario

VERSIONS = range(9, 17)
CHECK = "import ctypes, sys; sys.exit(ctypes.CDLL(sys.argv[1]).cmdCheck(sys.argv[2].encode()) & 1)"
"""What `gz sdf --check` calls; in a process of its own, since what it says goes to the streams of C++."""
OF_BULLET = "XML Attribute[concave] in element[collision] not defined in SDF"


def _library() -> str:
    for version in VERSIONS:
        name = f"libsdformat{version}.so.{version}"
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return name
    pytest.skip("libsdformat is not installed: apt install libsdformat12-12 (Debian 12).")


def checked(world: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", CHECK, _library(), str(world)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_gazebos_parser_calls_a_world_valid(tmp_path: Path) -> None:
    export_scenario(tube_scenario(), "sdf", tmp_path / "out")
    done = checked(tmp_path / "out" / "world.sdf")
    assert done.returncode == 0 and "Valid." in done.stdout
    complaints = [line for line in re.split(r"\n(?=\x1b|Warning|Error)", done.stderr) if line.strip()]
    assert all(OF_BULLET in line for line in complaints), done.stderr


def test_gazebos_parser_refuses_a_world_whose_frames_have_one_name(tmp_path: Path) -> None:
    export_scenario(tube_scenario(), "sdf", tmp_path / "out")
    world = tmp_path / "out" / "world.sdf"
    text = world.read_text(encoding="utf-8")
    assert 'frame name="panel-1"' in text
    world.write_text(text.replace('frame name="panel-1"', 'frame name="panel-0"'), encoding="utf-8")
    assert checked(world).returncode == 1
