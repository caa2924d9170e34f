"""A run that is given more steps goes on; what else may differ, and what may not."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.train import training
from aquanav_tools.train.checkpoint import read_checkpoint, write_checkpoint
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.renamed import ADDED, RENAMED
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from tests.train.runs import assert_stopped_run_ends_alike, learned, stop_after, tiny_pipeline, tiny_tube

OFF_POLICY = {"algorithm": "sac", "action": "continuous"}


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "tube")


@pytest.fixture(autouse=True)
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "curve.csv").open() as stream:
        return [{name: value for name, value in row.items() if name != "seconds"} for row in csv.DictReader(stream)]


@pytest.mark.parametrize("choices", [{}, OFF_POLICY], ids=["ppo", "sac"])
def test_more_steps_go_on_with_a_finished_run(choices: dict[str, Any], tube: Path, tmp_path: Path) -> None:
    said: list[str] = []
    train(tiny_pipeline(tube, steps=256, **choices), 3, tmp_path)
    before = rows_of(tmp_path)
    longer = tiny_pipeline(tube, steps=512, **choices)
    trained = train(longer, 3, tmp_path, tell=said.append)
    assert not trained.was_finished and trained.point.steps == 512
    after = rows_of(tmp_path)
    assert after[: len(before)] == before and [int(row["steps"]) for row in after] == [128, 256, 384, 512]
    assert "after 256 decisions. It was begun with 256 steps and now has 512" in said[0]
    record = json.loads((tmp_path / "train.json").read_text())
    assert record["lessons"][0]["steps"] == 512 and record["is_finished"]
    assert [(one["steps"], one["asked"]) for one in record["resumed"]] == [(256, [256])]
    assert train(longer, 3, tmp_path).was_finished


def test_learning_rate_goes_on_as_in_a_run_of_the_new_length_and_the_policy_is_another(
    tube: Path, tmp_path: Path
) -> None:
    for steps in (256, 512):
        train(tiny_pipeline(tube, steps=steps), 3, tmp_path / "longer")
    train(tiny_pipeline(tube, steps=512), 3, tmp_path / "whole")
    rates = [[float(row["train/learning_rate"]) for row in rows_of(tmp_path / name)] for name in ("longer", "whole")]
    assert rates[1] == pytest.approx([3e-4, 2.25e-4, 1.5e-4, 0.75e-4])
    assert rates[0] == pytest.approx([3e-4, 1.5e-4, 1.5e-4, 0.75e-4])  # the first two of two
    assert learned(tmp_path / "longer") != learned(tmp_path / "whole")


def test_stopped_while_going_on_it_ends_as_one_that_went_on_without(
    tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("whole", "stopped"):
        train(tiny_pipeline(tube, steps=256), 3, tmp_path / name)
    longer = tiny_pipeline(tube, steps=600)
    assert_stopped_run_ends_alike(longer, tmp_path, monkeypatch)


def test_chosen_n_steps_are_chosen_anew_for_a_longer_run(tube: Path, tmp_path: Path) -> None:
    choices: dict[str, Any] = {"n_steps": 0, "batch": 0, "run": RunSettings(checkpoint_every=10**6, final_episodes=0)}
    for steps in (96, 3072):
        train(tiny_pipeline(tube, steps=steps, **choices), 3, tmp_path)
        record = json.loads((tmp_path / "train.json").read_text())
        assert record["lessons"][0]["n_steps"] == {96: 4, 3072: 24}[steps]
    # 31 more updates: 96 decisions are done, and 2976 are 31 times 96. The last has a 32nd of the rate.
    assert len(rows_of(tmp_path)) == 6 + 31
    assert float(rows_of(tmp_path)[-1]["train/learning_rate"]) == pytest.approx(3e-4 / 32)


def test_fewer_steps_are_refused_and_nothing_lost(tube: Path, tmp_path: Path) -> None:
    train(tiny_pipeline(tube, steps=256), 3, tmp_path)
    before = learned(tmp_path)
    with pytest.raises(
        InputError, match=r"begun with 256 steps and has learned from 256 decisions; 128 .* not shorter"
    ):
        train(tiny_pipeline(tube, steps=128), 3, tmp_path)
    assert learned(tmp_path) == before


def test_only_the_last_lesson_can_be_made_longer(tube: Path, tmp_path: Path) -> None:
    pipeline = tiny_pipeline(tube, 2, steps=128)
    train(pipeline, 3, tmp_path)
    first, last = (dataclasses.replace(lesson, steps=256) for lesson in pipeline.lessons)
    with pytest.raises(InputError, match=r"Lesson 1 .* ended after 128 steps, and lesson 2 went on .* 256 were asked"):
        train(Pipeline((first, pipeline.lessons[1]), pipeline.run), 3, tmp_path)
    trained = train(Pipeline((pipeline.lessons[0], last), pipeline.run), 3, tmp_path)
    assert (trained.point.lesson, trained.point.steps) == (2, 384)


def test_lessons_added_to_a_run_that_has_ended_end_as_if_they_had_been_there_at_first(
    tube: Path, tmp_path: Path
) -> None:
    said: list[str] = []
    whole = tiny_pipeline(tube, 3, steps=128, run=RunSettings(checkpoint_every=128, final_episodes=2))
    train(whole, 3, tmp_path / "whole")
    for number in (1, 3):
        begun = Pipeline(whole.lessons[:number], whole.run)
        trained = train(begun, 3, tmp_path / "added", tell=said.append)
        assert (trained.point.lesson, trained.point.steps, trained.was_finished) == (number, 128 * number, False)
        assert train(begun, 3, tmp_path / "added").was_finished
    assert learned(tmp_path / "added") == learned(tmp_path / "whole")
    assert rows_of(tmp_path / "added") == rows_of(tmp_path / "whole")
    assert any("begun with 1 of its 3 lessons" in sentence for sentence in said)
    with pytest.raises(InputError, match=r"holds another training run, with lessons"):
        train(Pipeline(whole.lessons[:2], whole.run), 3, tmp_path / "added")


def test_more_steps_beside_another_difference_are_refused(tube: Path, tmp_path: Path) -> None:
    train(tiny_pipeline(tube, steps=128), 3, tmp_path)
    with pytest.raises(InputError, match=r"another training run, with lessons 1.clip 0.2 instead of 0.3. Nothing"):
        train(tiny_pipeline(tube, steps=256, clip=0.3), 3, tmp_path)


def test_checkpoint_written_before_adam_was_fused_goes_on(
    tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = tiny_pipeline(tube, steps=256)
    train(pipeline, 3, tmp_path / "whole")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        stop_after(patch, 1)
        train(pipeline, 3, tmp_path / "old")
    checkpoint = read_checkpoint(tmp_path / "old")
    assert checkpoint is not None
    adam = checkpoint.learner["parameters"]["policy.optimizer"]
    assert adam["param_groups"][0]["fused"] and int(adam["state"][0]["step"]) == 8
    adam["param_groups"][0]["fused"] = None
    write_checkpoint(checkpoint, tmp_path / "old")
    train(pipeline, 3, tmp_path / "old")
    assert learned(tmp_path / "old") == learned(tmp_path / "whole")


def as_recorded_before(lesson: dict[str, Any]) -> dict[str, Any]:
    """Return a lesson's record as versions wrote it in which `buffer` counted the decisions of all environments."""
    old = {new: name for name, new in RENAMED.items()} | {"n_steps": "buffer"}
    named = {old.get(name, name): value for name, value in lesson.items() if name not in ADDED}
    return {**named, "buffer": lesson["n_steps"] * lesson["num_envs"]}


def test_run_recorded_with_the_old_names_of_settings_and_numbers_goes_on(
    tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = RunSettings(checkpoint_every=128, final_episodes=0, validation=(str(tube),), validate_every=128)
    pipeline = tiny_pipeline(tube, steps=256, masked_observations=("distance",), run=run)
    train(pipeline, 3, tmp_path / "whole")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        stop_after(patch, 1)
        train(pipeline, 3, tmp_path / "old")
    checkpoint = read_checkpoint(tmp_path / "old")
    assert checkpoint is not None
    identity = checkpoint.journal["identity"]
    identity["lessons"] = [as_recorded_before(lesson) for lesson in identity["lessons"]]
    assert {"also", "blind_to", "trace", "warm_up", "entropy"} <= set(identity["lessons"][0])
    assert identity["lessons"][0]["buffer"] == 128 and "n_steps" not in identity["lessons"][0]
    for numbers in (*checkpoint.journal["curve"]["points"], *checkpoint.journal["trials"]):
        numbers["clean_success_rate"] = numbers.pop("collision_free_success")
    write_checkpoint(checkpoint, tmp_path / "old")
    train(pipeline, 3, tmp_path / "old")
    assert learned(tmp_path / "old") == learned(tmp_path / "whole")
    assert rows_of(tmp_path / "old") == rows_of(tmp_path / "whole")
    texts = [(tmp_path / name / "validation.csv").read_text() for name in ("old", "whole")]
    assert texts[0] == texts[1] and "collision_free_success" in texts[0] and "clean" not in texts[0]
