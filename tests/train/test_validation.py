"""Trials are evaluations: of policies of known deeds, beside aquanav-eval's own figures, and without a trace."""

from __future__ import annotations

import dataclasses
import io
import json
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import torch

from aquanav_tools.evaluate.episode_worker import EpisodeWorker, EvaluationSpec, Task, make_plan
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from aquanav_tools.sim.contacts import Backend, default_backend
from aquanav_tools.task import choices_of
from aquanav_tools.train import training
from aquanav_tools.train.environments import TrainingEnvs
from aquanav_tools.train.fitting import fitted
from aquanav_tools.train.learners import make_learner
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from aquanav_tools.train.validation import TRIED_FILE, Validation
from aquanav_tools.types import ignore_progress
from tests.caves import tube_scenario
from tests.train.runs import TINY, learned, tiny_pipeline, tiny_tube

AHEAD, IDLE = 2, 1


def policy_of(scenario: Scenario, thrust: int) -> bytes:
    """Return the zip of a policy that chooses one thrust, and neither ballast nor steer, whatever it sees."""
    with closing(TrainingEnvs([scenario], TINY, 0)) as envs:
        learner: Any = make_learner(envs, fitted(TINY), 0)
    with torch.no_grad():
        learner.policy.action_net.weight.zero_()
        learner.policy.action_net.bias.copy_(torch.eye(3)[[1, 1, thrust]].flatten())
    stream = io.BytesIO()
    learner.save(stream)
    return stream.getvalue()


@pytest.mark.parametrize(("thrust", "decisions", "rate"), [(AHEAD, 300, 1.0), (AHEAD, 40, 0.0), (IDLE, 60, 0.0)])
def test_a_straight_tube_is_swum_through_by_who_goes_straight_ahead_for_long_enough(
    thrust: int, decisions: int, rate: float, tmp_path: Path
) -> None:
    # 11 to 17.5 m at 1 m/s and ten decisions a second: 300 are enough, and 40 are not.
    tube = tube_scenario(limits=LimitSettings(decisions=decisions))
    with closing(Validation([tube, tube], TINY, 2, tmp_path)) as validation:
        trial = validation.trial(policy_of(tube, thrust), 1, 7)
    assert (trial.episodes, trial.lesson, trial.steps) == (4, 1, 7)
    if (
        trial.mean_reward or rate
    ):  # what cannot arrive within the limit is left out of rates, here all: nothing is known
        assert (trial.success_rate, trial.collision_free_success, trial.mean_collisions) == (rate, rate, 0.0)


@pytest.mark.parametrize(("num_workers", "backend"), [(0, default_backend()), (2, default_backend()), (0, "batch")])
def test_trials_of_one_policy_after_another_are_of_that_policy(
    num_workers: int, backend: Backend, tmp_path: Path
) -> None:
    tube = tube_scenario(limits=LimitSettings(decisions=300))
    with closing(Validation([tube], TINY, 3, tmp_path, num_workers, backend=backend)) as validation:
        rates = [
            validation.trial(policy_of(tube, thrust), 1, 1).collision_free_success for thrust in (IDLE, AHEAD, IDLE)
        ]
    assert rates == [0.0, 1.0, 0.0]
    assert not (tmp_path / TRIED_FILE).exists()


def test_a_worker_that_read_a_policy_while_it_changed_reads_it_again(tmp_path: Path) -> None:
    tube, path = tube_scenario(limits=LimitSettings(decisions=300)), tmp_path / "policy.zip"
    path.write_bytes(policy_of(tube, IDLE))
    options = EvaluateOptions((str(path),), (Path("tube"),), tmp_path, episodes=1, **choices_of(TINY))
    spec = EvaluationSpec(options, str(path), None, load_policy, scenarios=(tube,))
    plan = make_plan(spec)
    path.write_bytes(policy_of(tube, AHEAD))
    # The hash is taken after the file was read; here the file changes in between.
    misread = dataclasses.replace(plan, policy=dataclasses.replace(plan.policy, sha256=file_hash(path)))
    with closing(EpisodeWorker(spec, misread)) as worker:
        row = worker.run(Task(0, "never", policy_sha256=file_hash(path)))
    assert row["metrics"]["outcome"] == "success"


@pytest.mark.parametrize("num_workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_figures_are_those_of_aquanav_eval_on_the_same_starts(num_workers: int, tmp_path: Path) -> None:
    # Of starts 11 to 17.5 m away, some are near enough for 130 decisions in a current that each episode draws.
    folder = tiny_tube(tmp_path / "tube", decisions=130)
    task = dataclasses.replace(TINY, current=(0.3, 0.1, 0.0), current_range=(0.0, 1.0), sensor_noise=0.05)
    tube = read_scenario(folder)
    policy = policy_of(tube, AHEAD)
    with closing(Validation([tube], task, 12, tmp_path, num_workers)) as validation:
        trial = validation.trial(policy, 1, 0)
    (tmp_path / "policy.zip").write_bytes(policy)
    options = EvaluateOptions(
        (str(tmp_path / "policy.zip"),),
        (folder,),
        tmp_path / "eval",
        episodes=12,
        record="none",
        workers=1,
        **choices_of(task),
    )
    summary = evaluate(options, ignore_progress).summary
    assert summary.distinct_episodes == 12 and 0.0 < summary.success.rate < 1.0
    wanted = (summary.collision_free_success.rate, summary.success.rate, summary.means["reward"].mean)
    assert trial.score == tuple(round(value, 4) for value in wanted)
    assert trial.mean_collisions == round(summary.means["collisions"].mean, 4)


def test_what_is_learned_does_not_depend_on_being_tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)
    tube = tiny_tube(tmp_path / "tube")
    alone = RunSettings(checkpoint_every=128, final_episodes=0)
    tried = dataclasses.replace(
        alone, validation=(str(tube),), validation_episodes=2, validate_every=128, final_episodes=2
    )
    for name, run in (("alone", alone), ("tried", tried)):
        train(tiny_pipeline(tube, 2, run, steps=256), 3, tmp_path / name)
    assert learned(tmp_path / "tried") == learned(tmp_path / "alone")
    assert not (tmp_path / "tried" / TRIED_FILE).exists()


def test_run_on_the_batch_ends_with_whole_episodes_where_its_curve_has_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)
    pipeline = tiny_pipeline(
        tiny_tube(tmp_path / "tube"), run=RunSettings(backend="batch", final_episodes=5), steps=128, num_envs=32
    )  # 4 decisions of each vehicle, of the 40 of an episode
    trained = train(pipeline, 0, tmp_path / "run")
    assert trained.point.caveat.startswith("100%")
    assert trained.final is not None and trained.final.episodes == 5
    assert json.loads((tmp_path / "run" / "train.json").read_text())["final"]["episodes"] == 5
    again = train(pipeline, 0, tmp_path / "run")
    assert again.was_finished and again.final == trained.final
