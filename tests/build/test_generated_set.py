"""Sets of drawn caves: workers share them, and one that is killed costs a sentence, no cave."""

from __future__ import annotations

import os
import signal
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.build import generated_set
from aquanav_tools.build.generated_set import BuiltCave, CaveBuilder, CaveTask, build_set, built_by
from aquanav_tools.cli.generate import Generate, run_generate
from aquanav_tools.errors import InputError, MeshError, ResourceError
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.worker import WorkerSpec


class DyingBuilder(CaveBuilder):
    """Is killed over every third seed; over seed 3 the first time only."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def build(self, task: CaveTask) -> BuiltCave:
        """Stand for a build."""
        if task.fault:
            return super().build(task)
        mark = self._folder / str(task.seed)
        if task.seed % 3 == 0 and not (task.seed == 3 and mark.exists()):
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return BuiltCave(mark)


def make_dying_builder(folder: Path, _clock: Any) -> DyingBuilder:
    return DyingBuilder(folder)


def test_a_cave_whose_worker_dies_is_tried_once_more_and_then_told(tmp_path: Path) -> None:
    spec = WorkerSpec(partial(make_dying_builder, tmp_path), "cave builder", "caves were built", "Again.")
    tasks = [CaveTask("maze", seed) for seed in (1, 2, 3, 6, 7)]
    with WorkerPool(PipeTransport(), spec, 2) as pool:
        done = {task.seed: built for task, built in built_by(pool, iter(tasks))}
    assert {seed for seed, built in done.items() if built.folder} == {1, 2, 3, 7}
    assert done[6].is_lost and done[6].fault == "its process was ended by SIGKILL, twice"


def test_a_set_of_one_needs_no_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generated_set, "build_generated", lambda style, seed: tmp_path / f"{style}-{seed}")
    monkeypatch.setattr(generated_set, "builder_pool", lambda *_: pytest.fail("no worker is needed"))
    assert [built.folder for _, built in build_set([CaveTask("maze", 4)])] == [tmp_path / "maze-4"]


def test_caves_that_cannot_be_built_are_told_and_the_others_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def build(style: str, seed: int) -> Path:
        if seed == 5:
            raise MeshError("It has no way.")
        return tmp_path / f"{style}-{seed}"

    monkeypatch.setattr(generated_set, "build_generated", build)
    with pytest.raises(MeshError, match=r"1 of 3 caves could not be built\. seed 5: It has no way\."):
        run_generate(Generate("maze", 4, count=3, workers=1))
    told = capsys.readouterr()
    assert told.out.split() == [str(tmp_path / "maze-4"), str(tmp_path / "maze-6")]
    assert "generated/maze/6 is built (3 of 3)." in told.err


def test_a_cache_without_rights_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = []

    def build(_style: str, seed: int) -> Path:
        seeds.append(seed)
        raise ResourceError("The cache cannot be written to.")

    monkeypatch.setattr(generated_set, "build_generated", build)
    with pytest.raises(ResourceError, match=r"^The cache cannot be written to\.$"):
        run_generate(Generate("maze", 4, count=3, workers=1))
    assert seeds == [4]


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (Generate(count=0), "--count 0 must be at least 1"),
        (Generate(ray="somewhere"), "--ray is 'somewhere'"),
        (Generate("maz"), "no style 'maz'"),
    ],
)
def test_bad_options_are_told(options: Generate, match: str) -> None:
    with pytest.raises(InputError, match=match):
        run_generate(options)
