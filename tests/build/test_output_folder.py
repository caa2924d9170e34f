"""An output folder is recognised as finished, as unfinished, or as somebody else's, whenever its build was killed."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.build.options import BuildOptions, PhotoScaleOptions
from aquanav_tools.build.output_folder import (
    build_key,
    check_output,
    held_output,
    is_finished,
    publish,
    publish_failure,
)
from aquanav_tools.cave.options import StartOptions
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.scenario import replacing
from aquanav_tools.scenario.replacing import finish_replacing
from aquanav_tools.store import locked
from tests.disks import fill, small_disk

FILES = {"cave.ply": "walls", "report.html": "page", "drawings/plan.svg": "plan", "scenario.toml": "[scenario]"}


@pytest.fixture
def options(tmp_path: Path) -> BuildOptions:
    photos = tmp_path / "photos"
    (photos / "masks").mkdir(parents=True)
    Image.new("L", (80, 60)).save(photos / "a.png")
    Image.new("L", (80, 60)).save(photos / "masks" / "a.png")
    (photos / "positions.csv").write_text("name,x,y,z\n")
    return BuildOptions(photos, tmp_path / "out", scale=PhotoScaleOptions(positions=photos / "positions.csv"))


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    (folder / "build.json").write_text(json.dumps({"aquanav": "0"}))


def build(options: BuildOptions, files: dict[str, str] = FILES) -> None:
    key = build_key(options)
    check_output(options, key)
    with held_output(options.output) as staged:
        write(staged, files)
        publish(staged, options.output, key)


def content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


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


OLD = {"cave.ply": "old walls", "flow.npz": "old flow", "drawings/old.svg": "rose", "scenario.toml": "[old]"}


@pytest.mark.parametrize("files", [FILES, OLD])
def test_a_build_takes_the_place_of_an_older_one_and_of_nothing_else(
    files: dict[str, str], options: BuildOptions
) -> None:
    build(options, OLD)
    (options.output / "notes.txt").write_text("mine")
    build(replace(options, overwrite=True, seed=1), files)
    found = content(options.output)
    assert found.pop("notes.txt") == b"mine"
    assert json.loads(found.pop("build.json"))["outputs"].keys() == files.keys()
    assert found == {name: text.encode() for name, text in files.items()}


def test_a_build_that_fails_leaves_the_scenario_that_was_there_and_its_report_beside(options: BuildOptions) -> None:
    build(options)
    before = content(options.output)
    for sentence in ("no cave", "two caves"):
        with pytest.raises(InputError, match=sentence), held_output(options.output) as staged:
            write(staged, {"report.html": sentence, "cloud.ply": "points"})
            assert publish_failure(staged, options.output) == options.output / "failed"
            raise InputError(sentence)
        found = content(options.output)
        assert found.pop("failed/report.html") == sentence.encode()
        assert {name: found[name] for name in before} == before
    assert is_finished(options)
    build(replace(options, overwrite=True))
    assert content(options.output) == before  # what failed before is of no interest any more


def test_a_report_of_a_failure_is_gone_once_a_build_succeeds(options: BuildOptions) -> None:
    with held_output(options.output) as staged:
        write(staged, {"report.html": "no cave", "faults.png": "where"})
        assert publish_failure(staged, options.output) == options.output
    assert (options.output / "faults.png").exists()
    build(options)
    assert content(options.output).keys() == {*FILES, "build.json"}


def test_a_list_of_files_cannot_name_others_than_those_of_its_folder(options: BuildOptions, tmp_path: Path) -> None:
    build(options)
    (tmp_path / "thesis.tex").write_text("years of work")
    record = json.loads((options.output / "build.json").read_text())
    record["outputs"] |= {"../thesis.tex": "", str(tmp_path / "thesis.tex"): ""}
    (options.output / "build.json").write_text(json.dumps(record))
    build(replace(options, overwrite=True))
    assert (tmp_path / "thesis.tex").exists()


@pytest.mark.parametrize("step", range(12))
@pytest.mark.parametrize("is_first", [True, False])
def test_a_build_killed_at_any_step_of_taking_the_place_leaves_one_of_the_two_whole(
    step: int, is_first: bool, options: BuildOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not is_first:
        build(options, OLD)
    before = content(options.output)
    left = step

    def counted(function: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **more: object) -> object:
            nonlocal left
            if not left:
                raise KeyboardInterrupt
            left -= 1
            return function(*arguments, **more)

        return call

    for owner, name in ((replacing.os, "replace"), (replacing.shutil, "rmtree"), (Path, "unlink"), (Path, "rmdir")):
        monkeypatch.setattr(owner, name, counted(getattr(owner, name)))
    with contextlib.suppress(KeyboardInterrupt):
        build(replace(options, overwrite=True, seed=1))
    monkeypatch.undo()
    finish_replacing(options.output)
    found = content(options.output)
    left_over = {name for name in found if name.startswith((".new/", "work/"))}
    found = {name: found[name] for name in found.keys() - left_over}
    if found != before:
        assert found.pop("build.json")
        assert found == {name: text.encode() for name, text in FILES.items()}
    build(replace(options, overwrite=True, seed=1))
    assert is_finished(replace(options, seed=1))
    assert {path.name for path in options.output.iterdir()} == {*(name.split("/")[0] for name in FILES), "build.json"}


def in_a_process(work: Callable[[Callable[[], None]], None]) -> tuple[BaseProcess, Connection]:
    """Start work in a process of its own; it gets a function that tells the one here so. Return once it told it."""
    forked = get_context("fork")  # a new interpreter would import for seconds
    here, there = forked.Pipe(duplex=False)
    process = forked.Process(target=work, args=(lambda: there.send(None),))
    process.start()
    here.recv()
    return process, here


def test_a_process_killed_at_random_moments_never_loses_a_scenario(tmp_path: Path, rng: np.random.Generator) -> None:
    folder, number = tmp_path / "out", 0

    def replace_forever(tell: Callable[[], None]) -> None:
        for n in itertools.count(number + 1):
            with held_output(folder) as staged:
                write(staged, dict.fromkeys(("a", "b", f"only-{n % 3}", "drawings/c", "scenario.toml"), str(n)))
                publish(staged, folder, str(n))
            tell()

    for _ in range(20):
        process, _ = in_a_process(replace_forever)
        time.sleep(rng.uniform(0.0, 0.05))
        os.kill(process.pid or 0, signal.SIGKILL)
        process.join()
        finish_replacing(folder)
        found = {name: text for name, text in content(folder).items() if not name.startswith((".new/", "work/"))}
        number = int(json.loads(found.pop("build.json"))["key"])
        whole = {"a", "b", f"only-{number % 3}", "drawings/c", "scenario.toml"}
        assert found == dict.fromkeys(whole, str(number).encode())
    assert number >= 20


def test_two_builds_into_one_folder_the_second_is_told_who_holds_it(options: BuildOptions) -> None:
    def hold(tell: Callable[[], None]) -> None:
        with held_output(options.output):
            tell()
            signal.pause()

    process, _ = in_a_process(hold)
    with pytest.raises(InputError, match=rf"at work in {options.output}/work: process {process.pid} on .* since \d"):
        build(options)
    process.kill()  # what it held is no obstacle
    process.join()
    build(options)
    assert is_finished(options)


def test_a_folder_that_holds_nothing_of_the_build_is_removed_again(tmp_path: Path) -> None:
    with pytest.raises(InputError), held_output(tmp_path / "a" / "b"):
        raise InputError("The scan is damaged.")
    assert not list(tmp_path.iterdir())
    (tmp_path / "mine").mkdir()
    with pytest.raises(InputError), held_output(tmp_path / "mine"):
        raise InputError("The scan is damaged.")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert not list((tmp_path / "mine").iterdir())


@contextlib.contextmanager
def as_nobody() -> Iterator[None]:
    if os.geteuid() == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(os.getuid())


@pytest.fixture
def public() -> Iterator[Path]:
    """A folder that every user can enter, which pytest's own is not."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


def test_a_folder_without_the_right_to_write_is_told_as_such(public: Path) -> None:
    (public / "locked").mkdir(mode=0o555)
    (public / "secret").mkdir(mode=0o000)
    for name, place in (("locked", "locked"), ("locked/mine", "locked"), ("secret/mine", "secret")):
        options = BuildOptions(public / "scan.stl", public / name)
        with as_nobody(), pytest.raises(InputError, match=rf"you have no right to write in .*{place}\. Name another"):
            check_output(options, "")
            with held_output(options.output):
                raise AssertionError("It was written to.")
    (public / "secret").chmod(0o700)


def test_a_read_only_and_a_full_disk_are_told_as_such(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 120) as disk:
        with pytest.raises(ResourceError, match=r"is full: \d+ MB are free"):
            fill(disk, leave_megabytes=50)
            with held_output(disk / "mine"):
                raise AssertionError("It was written to.")
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        with pytest.raises(InputError, match=f"the disk under {disk} is read-only"), held_output(disk / "mine"):
            raise AssertionError("It was written to.")


@pytest.mark.parametrize(
    ("output", "reason"),
    [
        ("file/mine", r"file is a file"),
        ("dangling", r"dangling is a link to nowhere, which does not exist"),
        ("/proc/mine", r"/proc is no place for files"),
        ("n" * 300, r"File name too long"),
    ],
)
def test_a_place_for_no_folder_is_told_as_such(output: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to("nowhere")
    with pytest.raises(InputError, match=rf"Nothing can be written to the output folder .*: .*{reason}"):
        check_output(BuildOptions(tmp_path / "scan.stl", tmp_path / output), "")
        with held_output(tmp_path / output):
            raise AssertionError("It was written to.")
    assert {path.name for path in tmp_path.iterdir()} == {"file", "dangling"}


@pytest.mark.parametrize("output", [".", "./", "../here", "new/../also/", "link"])
def test_any_way_to_name_a_folder_will_do(output: str, options: BuildOptions, monkeypatch: pytest.MonkeyPatch) -> None:
    here = options.output.with_name("here")
    for name in ("here", "here/new", "here/target"):
        (options.output.parent / name).mkdir()
    (here / "link").symlink_to("target")
    if output in (".", "./", "../here"):
        here = here.rename(here.with_name("was-here"))
        here.with_name("here").mkdir()
        here = here.with_name("here")
    monkeypatch.chdir(here)
    named = replace(options, output=Path(output))
    build(named)
    assert is_finished(named)
    build(replace(named, overwrite=True, seed=1))
    assert is_finished(replace(named, seed=1))
