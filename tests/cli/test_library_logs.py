from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.cli.command import stage_bar
from aquanav_tools.cli.library_logs import NATIVE_SETTINGS, library_logs
from tests.build.test_scan_build import run_as_a_process

NOISY = """
import logging, os, warnings
from dataclasses import dataclass
from aquanav_tools.cli.command import run_command

@dataclass(frozen=True)
class Options:
    pass

def command(options):
    for path in ("/x/site-packages/numba/np/ufunc/parallel.py", "/home/me/policy.py"):
        warnings.warn_explicit(f"warned in {path}", UserWarning, path, 1)
    logging.getLogger("trimesh").warning("trimesh logs")
    logging.getLogger("aquanav_tools.cave").warning("our warning")
    logging.getLogger("aquanav_tools.cave").info("our note")
    print("levels", *(os.environ.get(name) for name in ("OPENCV_LOG_LEVEL", "RUST_LOG")))

run_command(Options, command, "noisy", "A test.")
"""
ABORTING = NOISY.replace("command(options):", "command(options):\n    os.write(2, b'terminate called\\n'); os.abort()")


def run(program: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    environ = {name: value for name, value in os.environ.items() if name not in NATIVE_SETTINGS} | environment
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=environ)


def test_a_command_holds_back_what_libraries_say_and_nothing_else() -> None:
    result = run(NOISY)
    assert result.stderr.splitlines() == [
        "/home/me/policy.py:1: UserWarning: warned in /home/me/policy.py",
        "warning: our warning",
    ]
    assert result.stdout == "levels ERROR error\n"


def test_with_debug_libraries_are_heard_too() -> None:
    result = run(NOISY, "--debug")
    for said in ("warned in /x/site", "warned in /home", "trimesh: trimesh logs", "our warning", "our note"):
        assert said in result.stderr
    assert result.stdout == "levels None None\n"


def test_what_the_user_has_set_stays() -> None:
    assert run(NOISY, RUST_LOG="info").stdout == "levels ERROR info\n"


def test_the_last_words_of_a_process_that_aborts_are_seen() -> None:
    result = run(ABORTING)
    assert result.returncode == -6  # SIGABRT
    assert "terminate called" in result.stderr


def test_nothing_stays_set_after_a_command_in_the_same_process() -> None:
    before = dict(os.environ)
    with library_logs(shown=False):
        assert os.environ.keys() >= NATIVE_SETTINGS.keys()
    assert dict(os.environ) == before


def test_a_build_from_photos_writes_its_own_sentences_into_a_pipe_and_nothing_else(
    rng: np.random.Generator, tmp_path: Path
) -> None:
    (tmp_path / "photos").mkdir()
    for n in range(4):  # PNG, whose copies OpenCV warned of; noise, of which COLMAP says that it makes no model
        noise = rng.integers(0, 255, (60, 80, 3), dtype=np.uint8)
        Image.fromarray(noise).save(tmp_path / "photos" / f"p{n}.png")
    result = run_as_a_process(tmp_path / "photos", "-o", tmp_path / "out", "--passage-height", "2.5")
    assert result.returncode == 3
    look, forecast, error = result.stderr.splitlines()
    assert look.startswith("Look (little-overlap): ")
    assert forecast.startswith("4 photos, standard quality. On ")
    assert error.startswith("error: Only 0 of 4 photos registered")


def test_a_stage_shows_its_progress_on_a_terminal_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda is_terminal=is_terminal: is_terminal, raising=False)
        with stage_bar("Closing the cavity") as progress:
            progress(1, 2)
        shown = capsys.readouterr().err
        assert ("Closing the cavity" in shown and "100%" in shown) == is_terminal
        assert is_terminal or not shown
