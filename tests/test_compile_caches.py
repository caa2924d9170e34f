"""Compiled code has a place on machines where the usual ones cannot be written to."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from aquanav_tools import compile_caches
from aquanav_tools.compile_caches import MARK_VARIABLE, NUMBA_VARIABLE, WARP_VARIABLE, can_write, ensure_compile_caches
from aquanav_tools.errors import InputError
from aquanav_tools.machine import user_cache
from aquanav_tools.scenario.shipped import CACHE_VARIABLE, cache_dir

NO_PLACE = """
import atexit, os, sys
import aquanav_tools.compile_caches as caches
caches.can_write = lambda place: False
caches.ensure_compile_caches()
import numba
@numba.njit(cache=True)
def twice(x):
    return 2 * x
twice(1.0)
kept = os.environ["NUMBA_CACHE_DIR"]
print(kept, any(name.endswith(".nbc") for _, _, names in os.walk(kept) for name in names))
"""


@pytest.fixture
def unnamed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take away what the variables say, and put it back at the end."""
    for variable in (NUMBA_VARIABLE, WARP_VARIABLE, MARK_VARIABLE):
        monkeypatch.setenv(variable, "")


def test_where_nothing_can_be_written_code_is_compiled_into_a_folder_that_goes(tmp_path: Path) -> None:
    script = tmp_path / "program.py"  # numba's cache wants a file
    script.write_text(NO_PLACE, encoding="utf-8")
    environment = {name: value for name, value in os.environ.items() if name not in (NUMBA_VARIABLE, WARP_VARIABLE)}
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, env=environment)
    folder, was_written = run.stdout.split()
    assert was_written == "True" and not Path(folder).parent.exists()
    assert f"Set {NUMBA_VARIABLE} and {WARP_VARIABLE} to a folder that lasts." in run.stderr


def test_nobody_else_can_put_code_there(
    unnamed: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compile_caches, "can_write", lambda _: False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ensure_compile_caches()
    (folder,) = tmp_path.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert os.environ[WARP_VARIABLE] == str(folder / "warp")
    assert "every run compiles anew" in capsys.readouterr().err


def test_where_there_is_not_even_a_temporary_folder_a_sentence_says_what_will_fail(
    unnamed: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compile_caches, "can_write", lambda _: False)
    (tmp_path / "file").touch()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))  # nobody may write below a file, root included
    ensure_compile_caches()
    assert not os.environ[WARP_VARIABLE]
    told = capsys.readouterr().err
    assert told.startswith("There is no place for compiled code") and "(Not a directory)" in told
    assert f"Set {NUMBA_VARIABLE} and {WARP_VARIABLE}, and TMPDIR, to folders that can." in told


def test_a_place_that_the_user_names_stays(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(compile_caches, "can_write", lambda _: False)
    monkeypatch.setenv(NUMBA_VARIABLE, "/mine")
    monkeypatch.setenv(WARP_VARIABLE, "/mine-too")
    ensure_compile_caches()
    assert os.environ[NUMBA_VARIABLE] == "/mine" and not capsys.readouterr().err


def test_usual_places_are_left_to_the_libraries(unnamed: None, capsys: pytest.CaptureFixture[str]) -> None:
    ensure_compile_caches()
    assert not os.environ[NUMBA_VARIABLE] and not capsys.readouterr().err


def test_a_folder_can_be_written_to_where_it_can_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert can_write(tmp_path) and can_write(tmp_path / "new" / "newer")
    assert not can_write(tmp_path / "file" / "below") and not can_write(None)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_within_one_of_others_cannot(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir(mode=0o000)
    assert not can_write(tmp_path / "theirs" / "new")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_of_others_cannot(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    assert not can_write(tmp_path / "new")


@pytest.mark.parametrize(
    ("platform", "expected"),
    [("linux", ".cache"), ("darwin", "Library/Caches"), ("win32", "AppData/Local")],
)
def test_each_system_has_its_folder_for_caches(platform: str, expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(sys, "platform", platform)
    assert user_cache() == Path.home() / expected


def test_a_user_without_a_home_is_asked_for_a_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", no_home)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    with pytest.raises(InputError, match=r"this user has no home\. Set AQUANAV_CACHE to a folder"):
        cache_dir()
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    assert cache_dir() == tmp_path
