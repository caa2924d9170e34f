"""What stages made is kept under what it rests on, whole or not at all, and a full disk is told in a sentence."""

from __future__ import annotations

import ast
import contextlib
import errno
import subprocess
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools import store as store_module
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.provenance import digest
from aquanav_tools.store import (
    LOCK_FILE,
    StageStore,
    check_room,
    copied,
    is_finished,
    locked,
    told_when_full,
    watched,
    write_whole,
)
from aquanav_tools.types import Array, Mesh, PointCloud, silent
from aquanav_tools.values import kept_value, read_value, write_value
from tests.disks import small_disk

PACKAGE = Path(store_module.__file__).parent


@dataclass(frozen=True)
class Setting:
    width: int = 3


def folders(store: StageStore) -> set[str]:
    return {path.name for path in store.folder.iterdir() if path.is_dir()}


def make(store: StageStore, *inputs: object) -> Path:
    with store.open("depth", write_whole, *inputs) as folder:
        (folder / "result").write_text(str(inputs))
    return folder


def test_the_same_inputs_lead_to_the_same_folder_and_others_to_another(tmp_path: Path) -> None:
    store = StageStore(tmp_path)
    first = make(store, Setting(3), np.arange(3.0))
    assert make(store, Setting(3), np.arange(3.0)) == first
    assert len({first, make(store, Setting(4), np.arange(3.0)), make(store, Setting(3), np.arange(4.0))}) == 3


def test_a_stage_that_fails_is_not_finished_and_finds_what_it_left(tmp_path: Path) -> None:
    store = StageStore(tmp_path)
    with pytest.raises(ValueError, match="stop"), store.open("depth", write_whole, 1) as folder:
        (folder / "half").touch()
        raise ValueError("stop")
    assert not is_finished(folder)
    with store.open("depth", write_whole, 1) as again:
        assert (again / "half").exists()
    assert is_finished(folder)


def test_two_results_are_kept_of_each_stage_and_the_longest_unused_goes_first(tmp_path: Path) -> None:
    store = StageStore(tmp_path)
    with store.open("models", write_whole, 0) as other:
        pass
    first, second = make(store, 1), make(store, 2)
    make(store, 1)
    third = make(store, 3)
    assert folders(store) == {other.name, first.name, third.name}
    assert second.name not in folders(store)


def test_no_module_takes_more_than_the_version_from_the_front() -> None:
    taken = {
        alias.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module == PACKAGE.name
        for alias in node.names
    }
    assert taken == {"__version__"}


def test_what_has_no_content_cannot_be_an_input() -> None:
    with pytest.raises(TypeError, match="no plain value"):
        digest(object())


def test_a_copy_is_made_once(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("one")
    copied(tmp_path / "a", tmp_path / "b")
    (tmp_path / "a").write_text("two")
    assert copied(tmp_path / "a", tmp_path / "b").read_text() == "one"


def test_two_processes_do_not_work_in_one_folder(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(InputError, match="Another process is at work"), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_work_stops_before_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_room(tmp_path)
    monkeypatch.setattr(store_module, "MIN_FREE", 1 << 60)
    with pytest.raises(ResourceError, match=r"is full: \d+ MB are free.*goes on where it stopped"):
        check_room(tmp_path)
    with watched(silent, tmp_path)("a stage") as progress, pytest.raises(ResourceError, match=str(tmp_path)):
        progress(1, 2)


def test_a_torn_file_of_a_library_that_ignores_a_full_disk_finishes_no_stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = StageStore(tmp_path)
    with pytest.raises(ResourceError), store.open("depth", write_whole, 1) as folder:
        monkeypatch.setattr(store_module, "MIN_FREE", 1 << 60)
    assert not is_finished(folder)


def test_what_libraries_say_about_a_full_disk_becomes_a_sentence(tmp_path: Path) -> None:
    full = OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "x.npz"))
    with pytest.raises(ResourceError, match=r"disk under .*x\.npz is full") as told, told_when_full(tmp_path):
        raise full
    assert told.value.__cause__ is full
    with pytest.raises(OSError, match="else"), told_when_full(tmp_path):
        raise OSError("something else")


def test_a_disk_that_is_really_full_ends_in_a_sentence_and_the_stage_can_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_module, "MIN_FREE", 0)  # so that the write itself fails
    with small_disk(tmp_path / "disk", 2) as disk:
        store, cloud = StageStore(disk / "work"), PointCloud(np.zeros((100_000, 3)))

        def build() -> PointCloud:
            with store.open("fused", write_whole, 1) as folder:
                return kept_value(PointCloud, folder / "cloud.npz", lambda: cloud)

        with pytest.raises(ResourceError, match=r"disk under .*disk.* is full: [01] MB are free") as told:
            build()
        assert isinstance(told.value.__cause__, OSError)
        assert told.value.exit_code == 6
        subprocess.run(["mount", "-o", "remount,size=8m", str(disk)], check=True)
        assert len(build().points) == 100_000


def test_values_come_back_as_they_were(tmp_path: Path, rng: np.random.Generator) -> None:
    @dataclass(frozen=True)
    class Cave:
        name: str
        mesh: Mesh
        clouds: tuple[PointCloud, ...]
        sizes: tuple[int, float]
        facts: dict[str, float]
        path: Path | None = None

    Cave.__annotations__.update(mesh=Mesh, clouds=tuple[PointCloud, ...], path=Path | None)
    cloud = PointCloud(rng.random((4, 3)), None, rng.integers(0, 255, (4, 3), dtype=np.uint8))
    cave = Cave("a", Mesh(rng.random((5, 3)), rng.integers(0, 4, (2, 3))), (cloud, cloud), (1, 0.1), {"v": 1.5})
    write_value(cave, tmp_path / "cave.npz")
    again = read_value(Cave, tmp_path / "cave.npz")
    np.testing.assert_array_equal(again.mesh.vertices, cave.mesh.vertices)
    np.testing.assert_array_equal(again.clouds[1].colours, cloud.colours)
    assert again.clouds[0].normals is None
    assert again.clouds[0].colours is not None
    assert again.clouds[0].colours.dtype == np.uint8
    assert (again.name, again.sizes, again.facts, again.path) == ("a", (1, 0.1), {"v": 1.5}, None)


def test_a_kept_value_is_made_once_and_a_file_with_code_in_it_is_refused(tmp_path: Path) -> None:
    made: list[Array] = []

    def make_cloud() -> PointCloud:
        made.append(np.zeros((1, 3)))
        return PointCloud(made[-1])

    for _ in range(2):
        kept_value(PointCloud, tmp_path / "cloud.npz", make_cloud)
    assert len(made) == 1
    np.savez(tmp_path / "evil.npz", values=np.array([print], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
        read_value(PointCloud, tmp_path / "evil.npz")


def test_a_folder_in_use_is_refused_or_waited_for(tmp_path: Path) -> None:
    entered = threading.Event()

    def wait() -> None:
        with locked(tmp_path, waits=True):
            entered.set()

    thread = threading.Thread(target=wait)
    with locked(tmp_path):
        with pytest.raises(InputError, match="Another process is at work"), locked(tmp_path):
            pass
        thread.start()
        assert not entered.wait(0.2)
    assert entered.wait(10.0)
    thread.join()


def test_who_waited_for_a_lock_that_was_removed_waits_for_the_one_in_its_place(tmp_path: Path) -> None:
    entered = threading.Event()

    def wait() -> None:
        with locked(tmp_path / "work", waits=True):
            entered.set()

    thread = threading.Thread(target=wait)
    with contextlib.ExitStack() as again:
        with locked(tmp_path / "work"):
            thread.start()
            assert not entered.wait(0.2)
            (tmp_path / "work" / LOCK_FILE).unlink()
            again.enter_context(locked(tmp_path / "work"))
        assert not entered.wait(0.2)
    assert entered.wait(10.0)
    thread.join()


def test_a_folder_without_the_right_to_write_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refused)
    with (
        pytest.raises(ResourceError, match=r"new cannot be written to: Permission denied\. Its owner"),
        locked(tmp_path / "new"),
    ):
        pass


def test_a_folder_where_a_file_lies_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "cache"):
        with pytest.raises(InputError, match=r"file.* cannot be written to: .*A file lies"), locked(folder):
            pass
