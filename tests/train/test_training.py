from __future__ import annotations

import csv
import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import TrainingError
from aquanav_tools.evaluate.network import NetworkPolicy
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from aquanav_tools.train import training
from aquanav_tools.train.checkpoint import read_checkpoint
from aquanav_tools.train.environments import TrainingEnvs
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.settings import RunSettings, TrainSettings
from aquanav_tools.train.training import train
from tests.caves import tube_scenario
from tests.train.runs import TINY, learned, tiny_pipeline, tiny_tube


@pytest.fixture(scope="module")
def tube_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "tube")


@pytest.fixture(scope="module")
def run(tube_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two lessons, validated."""
    folder = tmp_path_factory.mktemp("run")
    trial = RunSettings(
        validation=(str(tube_folder),), validation_episodes=3, validate_every=128, checkpoint_every=10**6
    )
    train(tiny_pipeline(tube_folder, 2, trial, steps=256), 0, folder)
    return folder


@pytest.fixture
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(csv.DictReader(stream))


def mean_gain(scenario: Scenario, policy: PPO | None, decisions: int = 60) -> float:
    """Return the mean progress (m) from the first ten starts; None acts at random."""
    env = CaveEnv(scenario)
    env.action_space.seed(0)
    gains = []
    for start in range(10):
        obs, info = env.reset(seed=start, options={"start": start})
        remaining = info["remaining"]
        for _ in range(decisions):
            action = env.action_space.sample() if policy is None else policy.predict(obs, deterministic=True)[0]
            obs, _, terminated, _, info = env.step(action)
            if terminated:
                break
        gains.append(remaining - info["remaining"])
    env.close()
    return float(np.mean(gains))


def test_run_folder_tells_what_was_learned_from_what_with_what(run: Path, tube_folder: Path) -> None:
    record = json.loads((run / "train.json").read_text())
    assert record["is_finished"] and record["steps"] == 512 and record["seed"] == 0
    assert [lesson["steps"] for lesson in record["lessons"]] == [256, 256]
    assert {len(cave["content_hash"]) for cave in record["scenarios"] + record["validation_scenarios"]} == {64}
    assert {"aquanav", "code", "python", "torch", "numpy", "stable-baselines3"} <= set(record["versions"])
    assert [(row["lesson"], row["steps"]) for row in rows_of(run / "curve.csv")] == [
        ("1", "128"), ("1", "256"), ("2", "384"), ("2", "512")
    ]  # fmt: skip
    assert all(np.isfinite(float(row["train/value_loss"])) for row in rows_of(run / "curve.csv"))
    assert not list(run.glob("*.partial"))


def test_finished_run_has_its_curves_and_its_policy_in_every_form(run: Path) -> None:
    page = (run / "report.html").read_text()
    assert "Training in" in page and "data:image/png;base64" in page
    assert load_policy(str(run / "policy.onnx")).action == "multidiscrete"
    assert {path.name for path in run.iterdir()} >= {"policy.pt", "curve.rrd", "tensorboard", "best.zip", "policy.zip"}
    rerun = Path(sys.executable).with_name("rerun")
    told = subprocess.run([rerun, "rrd", "verify", run / "curve.rrd"], capture_output=True, text=True, check=True)
    assert "verified without error" in told.stdout + told.stderr


def test_best_policy_is_that_of_the_best_trial(run: Path) -> None:
    trials = rows_of(run / "validation.csv")
    assert [row["steps"] for row in trials] == ["128", "256", "384", "512"]
    scores = [
        tuple(float(row[name]) for name in ("collision_free_success", "success_rate", "mean_reward")) for row in trials
    ]
    best = PPO.load(run / "best.zip")
    lesson, step = divmod(scores.index(max(scores)), 2)
    assert best.num_timesteps == (step + 1) * 128
    record = json.loads((run / "train.json").read_text())
    assert record["validation"][2 * lesson + step]["mean_reward"] == max(scores)[2]


def test_policy_has_seen_every_observation_but_those_of_the_last_update_once(run: Path) -> None:
    checkpoint = read_checkpoint(run)
    assert checkpoint is not None
    weights = checkpoint.learner["parameters"]["policy"]
    assert int(weights["features_extractor.count"]) == 512  # both lessons' decisions: statistics are carried on
    normaliser = NetworkPolicy(run / "policy.zip").normaliser
    assert normaliser is not None
    assert torch.equal(normaliser.mean, weights["features_extractor.mean"])


@pytest.mark.usefixtures("no_reports")
def test_same_seed_gives_the_same_policy_and_another_seed_another(tube_folder: Path, tmp_path: Path) -> None:
    for name, seed in (("first", 7), ("second", 7), ("third", 8)):
        train(tiny_pipeline(tube_folder, steps=128), seed, tmp_path / name)
    assert learned(tmp_path / "first") == learned(tmp_path / "second") != learned(tmp_path / "third")


@pytest.mark.usefixtures("no_reports")
def test_a_training_leaves_no_log_folder_of_stable_baselines_behind(
    tube_folder: Path, tmp_path: Path, no_reports: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path / "logs"))  # where SB3's own loggers make it
    train(tiny_pipeline(tube_folder, steps=128), 0, tmp_path / "run")
    assert (tmp_path / "run" / "policy.zip").is_file()
    assert not (tmp_path / "logs").exists()


def test_fresh_optimiser_leaves_the_moments_behind(tube_folder: Path, tmp_path: Path) -> None:
    for optimiser in ("carried", "fresh"):
        train(tiny_pipeline(tube_folder, 2, steps=128, optimiser=optimiser), 0, tmp_path / optimiser)
        checkpoint = read_checkpoint(tmp_path / optimiser)
        assert checkpoint is not None
        state = checkpoint.learner["parameters"]["policy.optimizer"]["state"]
        updates = 128 // 32 * 2  # minibatches times epochs of a lesson
        assert int(state[0]["step"]) == (updates if optimiser == "fresh" else 2 * updates)


@pytest.mark.usefixtures("no_reports")
def test_diverging_run_stops_and_keeps_its_last_good_checkpoint(tube_folder: Path, tmp_path: Path) -> None:
    good = tiny_pipeline(tube_folder).lessons[0]
    bad = tiny_pipeline(tube_folder, learning_rate=1e30).lessons[0]
    with pytest.raises(TrainingError, match=r"after \d+ decisions, in lesson 2, .* learning rate of 1e\+30 is likely"):
        train(Pipeline((good, bad), RunSettings(checkpoint_every=128)), 0, tmp_path)
    NetworkPolicy(tmp_path / "policy.zip")  # refuses weights that are not finite
    checkpoint = read_checkpoint(tmp_path)
    assert checkpoint is not None and checkpoint.journal["steps"] >= good.steps


@pytest.mark.usefixtures("no_reports")
@pytest.mark.parametrize("workers", [0, 2])
def test_environments_are_shared_out_over_the_caves(workers: int) -> None:
    caves = [tube_scenario(limits=LimitSettings(decisions=decisions)) for decisions in (5, 9, 7)]
    envs = TrainingEnvs(caves, dataclasses.replace(TINY, num_envs=5, batch=5, n_steps=1), workers)
    envs.seed(0)
    envs.reset()
    ended = [np.flatnonzero(envs.step(np.ones((5, 3), dtype=int))[2]).tolist() for _ in range(9)]
    assert ended == [[], [], [], [], [0, 1], [], [3, 4], [], [2]]  # two, one and two in caves of 5, 9 and 7 decisions
    envs.close()


@pytest.mark.slow
def test_a_short_run_learns_to_swim_ahead(tube: Scenario, tmp_path: Path) -> None:
    settings = TrainSettings(
        scenario="tube", steps=8192, reward="dense", num_envs=4, hidden=(64, 64), n_steps=256, batch=128, epochs=10,
        learning_rate=1e-3, normalise=False,
    )  # fmt: skip
    train(Pipeline((settings,), RunSettings(final_episodes=0)), 0, tmp_path, scenario=tube)
    trained = mean_gain(tube, PPO.load(tmp_path / "policy.zip"))
    # 6 s ahead at 1 m/s would be 6 m, random actions gain 1.2 m, this run 5.6 m. With normalised observations, which
    # move while their statistics settle, so short a run gains -0.2 m.
    assert trained > mean_gain(tube, None) + 1.0
