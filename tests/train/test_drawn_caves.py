"""Training in caves that are drawn while it goes on: the same run whatever the timing, and never a test cave."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.build.generated_set import BuiltCave, CaveTask
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.machine import CACHE_VARIABLE
from aquanav_tools.scenario.folder import read_scenario, write_scenario
from aquanav_tools.scenario.scaling import scaled
from aquanav_tools.scenario.schema import LimitSettings
from aquanav_tools.scenario.split import is_test_cave, names_for_tests
from aquanav_tools.train import cave_supply, training
from aquanav_tools.train.cave_rotation import FLOWN, WAITING, CaveRotation, steps_between
from aquanav_tools.train.cave_supply import CaveSequence, CaveSupply
from aquanav_tools.train.checkpoint import read_checkpoint
from aquanav_tools.train.drawn_lessons import drawn_caves
from aquanav_tools.train.settings import RunSettings, TrainSettings
from aquanav_tools.train.training import train
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.worker import WorkerSpec
from tests.caves import TUBE_RADIUS, tube_scenario
from tests.sim.test_water import flowing
from tests.train.dying_builder import make_dying_builder
from tests.train.runs import assert_stopped_run_ends_alike, learned, tiny_pipeline

ON_BATCH = RunSettings(backend="batch", checkpoint_every=128, final_episodes=0)
MIXED = "generated/mixed"


def build_tube(folder: Path, task: CaveTask) -> BuiltCave:
    """Write the tube with flow of a seed, whose episodes take 10 to 19 decisions. One in four seeds has none."""
    if task.seed % 4 == 0:
        return BuiltCave(None, "It cannot be dived.")
    target = folder / f"{task.style}-{task.seed}"
    if not target.exists():
        tube = flowing()
        limits = LimitSettings(decisions=10 + task.seed % 10)
        settings = dataclasses.replace(tube.settings, name=target.name, limits=limits)
        write_scenario(dataclasses.replace(tube, settings=settings), target)
    return BuiltCave(target)


class TubePool:
    """Stands for a pool of workers: builds in the thread that asks, and takes a time for each cave."""

    def __init__(self, folder: Path, delay: float) -> None:
        self._folder, self._delay = folder, delay

    def __enter__(self) -> TubePool:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def results(self, tasks: Iterator[CaveTask | None], *_: object) -> Iterator[tuple[CaveTask, BuiltCave]]:
        """Yield what comes of each task; the first of two ends last."""
        held: list[CaveTask] = []
        for task in tasks:
            held += [] if task is None else [task]
            if task is None or len(held) == 2:
                time.sleep(self._delay)
                yield from ((one, build_tube(self._folder, one)) for one in reversed(held))
                held = []


def stub(monkeypatch: pytest.MonkeyPatch, folder: Path, delay: float = 0.0) -> None:
    """Have tubes built in place of drawn caves."""

    def build_set(tasks: Sequence[CaveTask]) -> Iterator[tuple[CaveTask, BuiltCave]]:
        yield from ((task, build_tube(folder, task)) for task in reversed(tasks))

    monkeypatch.setattr(cave_supply, "build_set", build_set)
    monkeypatch.setattr(cave_supply, "builder_pool", lambda *_, **__: TubePool(folder, delay))


@pytest.fixture(autouse=True)
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


def drawn_lesson(steps: int = 512, run: RunSettings = ON_BATCH, **changes: Any) -> Any:
    choices = {"num_caves": 2, "new_cave_every": 64, "steps": steps, **changes}
    return tiny_pipeline(Path(MIXED), run=run, **choices)


def test_the_same_caves_come_in_at_the_same_decisions_whatever_the_timing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []
    for name, delay in (("fast", 0.0), ("slow", 0.3)):
        stub(monkeypatch, tmp_path / f"caves-{name}", delay)
        run = dataclasses.replace(ON_BATCH, cave_workers=1 if delay else 2)
        train(drawn_lesson(run=run), 3, tmp_path / name)
        found.append(learned(tmp_path / name))
        checkpoint = read_checkpoint(tmp_path / name)
        assert checkpoint is not None
        last = checkpoint.journal["curve"]["points"][-1]["learner"]
        # 512 decisions by 4 vehicles, a cave each 64: those of decision 64 to 512 are taken, unless a place is taken.
        assert 6.0 <= last[FLOWN] <= 10.0
        assert 0.0 < last[WAITING] < 1.0  # a run of a second waits for the first
    assert found[0] == found[1]


@pytest.mark.parametrize(("lessons", "checkpoint"), [(1, 2), (2, 3)])
def test_a_stopped_run_in_drawn_caves_ends_as_one_that_never_stopped(
    lessons: int, checkpoint: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stub(monkeypatch, tmp_path / "caves")
    pipeline = tiny_pipeline(
        Path(MIXED), lessons, ON_BATCH, num_caves=2, new_cave_every=48, steps=384, current="half", mirrored=True
    )
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch, checkpoint)


def test_caves_follow_from_the_seed_and_none_is_a_test_cave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = CaveSequence(("maze", "mixed"), 5)
    tasks = [sequence.task(number) for number in range(100)]
    assert [task.style for task in tasks] == ["maze", "mixed"] * 50
    assert not any(is_test_cave(task.style, task.seed) for task in tasks)
    assert tasks == [sequence.task(number) for number in range(100)]
    assert {task.seed for task in tasks}.isdisjoint(CaveSequence(("maze", "mixed"), 6).task(n).seed for n in range(100))
    stub(monkeypatch, tmp_path / "caves")
    names = []
    for _ in range(2):
        with CaveSupply(sequence, 2) as supply:
            at_once = supply.at_once(range(6))
            supply.expect(3)
            assert [supply.take(number).name for number in range(3, 6)] == [cave.name for cave in at_once[3:]]
            names.append([cave.name for cave in at_once])
    assert names[0] == names[1]
    # What cannot be built is left out in the same way always.
    assert all(int(name.rpartition("-")[2]) % 4 for name in names[0])


def test_lessons_go_on_in_the_sequence(tmp_path: Path) -> None:
    pipeline = tiny_pipeline(Path(MIXED), 3, ON_BATCH, steps=512, num_caves=3, new_cave_every=100)
    first, second, third = drawn_caves(pipeline, 0)
    assert first is not None and second is not None and third is not None
    assert (first.window, second.window, third.window) == (range(3), range(5, 8), range(10, 13))  # 128 / 25


def test_fixed_caves_and_drawn_ones_share_a_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stub(monkeypatch, tmp_path / "caves")
    write_scenario(flowing(), tmp_path / "tube")
    seen: list[list[str]] = []
    step = CaveRotation.step

    def watched(self: CaveRotation, batch: Any, ended: Any) -> None:
        step(self, batch, ended)
        seen.append([batch.scenarios[cave].name for cave in batch.cave_of])

    monkeypatch.setattr(CaveRotation, "step", watched)
    pipeline = drawn_lesson(scenarios=(str(tmp_path / "tube"), "generated/maze"), num_caves=64)
    train(pipeline, 3, tmp_path / "run")
    assert {row[0] for row in seen} == {flowing().name}
    assert len({row[1] for row in seen}) > 1  # 4 vehicles, the first in the tube, the others in three drawn caves
    assert {name.rpartition("-")[0] for row in seen for name in row[1:]} == {"maze", "mixed"}


def test_a_builder_that_is_killed_twice_ends_the_run_with_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = WorkerSpec(make_dying_builder, "cave builder", "caves were built", "Again.")
    monkeypatch.setattr(cave_supply, "builder_pool", lambda num, **_: WorkerPool(PipeTransport(), spec, num))
    with CaveSupply(CaveSequence(("maze",), 1), 1) as supply:
        supply.expect(1)
        with pytest.raises(ResourceError, match=r"generated/maze/\d+ could not be built: its process was ended by SIG"):
            supply.take(1)


def test_caves_that_cannot_be_learned_in_end_the_run_with_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_scenario(tube_scenario(), tmp_path / "still")
    monkeypatch.setattr(
        cave_supply, "build_set", lambda tasks: ((task, BuiltCave(tmp_path / "still")) for task in tasks)
    )
    with pytest.raises(InputError, match=r"None of 10 drawn caves can be learned in\. The last, .* No water flows"):
        CaveSupply(CaveSequence(("maze",), 1), 1).at_once([0])


def test_no_cave_is_learned_in_in_which_hardly_any_start_can_be_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a tube of 0.23 m a hull of 0.17 m has 6 cm of room, and starts are drawn where it has 10."""
    folders = iter([tmp_path / "tight", tmp_path / "wide"])
    write_scenario(scaled(flowing(), 0.23 / TUBE_RADIUS), tmp_path / "tight")
    write_scenario(flowing(), tmp_path / "wide")
    monkeypatch.setattr(cave_supply, "build_set", lambda tasks: ((task, BuiltCave(next(folders))) for task in tasks))
    (taken,) = CaveSupply(CaveSequence(("maze",), 1), 1).at_once([0])
    assert taken.guide.length == pytest.approx(flowing().guide.length)
    assert next(folders, None) is None


def test_what_is_no_fault_of_a_cave_is_told_without_trying_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def build(_style: str, _seed: int) -> Path:
        raise ResourceError("The cache cannot be written to.")

    monkeypatch.setattr("aquanav_tools.build.generated_set.build_generated", build)
    with pytest.raises(ResourceError, match=r"^The cache cannot be written to\.$"):
        CaveSupply(CaveSequence(("maze",), 1), 1).at_once([0])


def test_a_damaged_cave_is_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stub(monkeypatch, tmp_path / "caves")
    supply = CaveSupply(CaveSequence(("maze",), 1), 1)
    cave = supply.at_once([0])[0]
    assert cave.folder is not None
    (cave.folder / "field.npz").write_bytes(b"half")
    name = cave.name
    del cave

    def again(style: str, seed: int) -> Path:
        folder = build_tube(tmp_path / "caves", CaveTask(style, seed)).folder
        assert folder is not None
        return folder

    monkeypatch.setattr(cave_supply, "build_generated", again)
    (whole,) = supply.at_once([0])
    assert whole.name == name and read_scenario(whole.folder or "").content_hash == whole.content_hash


@pytest.mark.parametrize(
    ("lesson", "run", "match"),
    [
        ({"scenario": names_for_tests("maze", 1)[0]}, {}, "^generated/maze/17 is a test cave"),
        ({"scenarios": (names_for_tests("mixed", 1)[0],)}, {}, r"^generated/mixed/\d+ is a test cave"),
        ({}, {"validation": (names_for_tests("maze", 1)[0],)}, "^generated/maze/17 is a test cave"),
        ({}, {"validation": (MIXED,)}, "give generated/mixed a seed, such as generated/mixed/1"),
        ({}, {"backend": "pybullet"}, "draws caves for the batch only. Choose --backend batch"),
        ({"progress": "original"}, {}, "The progress original counts panels"),
        ({"scenario": "generated/mase"}, {}, "no style 'mase'. Did you mean 'maze'"),
    ],
)
def test_what_cannot_be_learned_in_is_told(
    lesson: dict[str, Any], run: dict[str, Any], match: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=match):
        train(drawn_lesson(run=dataclasses.replace(ON_BATCH, **run), **lesson), 0, tmp_path)


def test_senseless_numbers_of_caves_are_told() -> None:
    for name in ("num_caves", "new_cave_every"):
        with pytest.raises(ValueError, match=f"{name} must be positive, got 0"):
            TrainSettings(scenario=MIXED, **{name: 0})
    with pytest.raises(ValueError, match="cave_workers is 300"):
        RunSettings(cave_workers=300)
    assert steps_between(TrainSettings(scenario=MIXED, num_envs=512, new_cave_every=10)) == 1
    assert np.isclose(steps_between(TrainSettings(scenario=MIXED, num_envs=384)), 100_000 / 384, atol=0.5)


@pytest.mark.slow
def test_a_run_learns_in_real_drawn_caves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(cave_supply, "AHEAD", 1)  # more would be built for nothing
    pipeline = drawn_lesson(256, scenario="generated/bedding-plane", current="half", new_cave_every=128)
    train(pipeline, 1, tmp_path / "run")
    checkpoint = read_checkpoint(tmp_path / "run")
    assert checkpoint is not None
    last = checkpoint.journal["curve"]["points"][-1]["learner"]
    assert last[FLOWN] >= 3.0 and 0.0 <= last[WAITING] <= 1.0
    built = [folder.name for folder in (tmp_path / "cache" / "generated").iterdir() if (folder / "cave.ply").exists()]
    assert len(built) >= 3
    assert not any(is_test_cave("bedding-plane", int(name.split("-")[2])) for name in built)
