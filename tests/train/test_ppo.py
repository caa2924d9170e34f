from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from stable_baselines3 import PPO

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.train import ppo
from aquanav_tools.train.record import RunRecord
from aquanav_tools.train.settings import TrainSettings

TINY = TrainSettings(
    steps=1024, observation="paper", num_envs=2, hidden=(16,), buffer=512, batch=128, epochs=2, checkpoint_every=512
)


def read_files(folder: Path) -> tuple[dict[str, object], list[dict[str, str]]]:
    with (folder / "curve.csv").open() as stream:
        return json.loads((folder / "train.json").read_text()), list(csv.DictReader(stream))


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


def test_training_leaves_a_policy_a_record_and_a_curve(tube: Scenario, tmp_path: Path) -> None:
    ppo.train(tube, TINY, 0, tmp_path)
    record, curve = read_files(tmp_path)
    assert record["is_finished"] is True
    assert record["steps"] == 1024
    assert record["settings"] == {**dataclasses.asdict(TINY), "hidden": [16], "current_range": [1.0, 1.0]}
    assert [int(row["steps"]) for row in curve] == [512, 1024]
    policy = PPO.load(tmp_path / "policy.zip")
    assert policy.observation_space.shape == (31,)
    assert not list(tmp_path.glob("*.partial"))


def test_same_seed_gives_the_same_policy(tube: Scenario, tmp_path: Path) -> None:
    weights = []
    for name in ("first", "second"):
        ppo.train(tube, TINY, 7, tmp_path / name)
        weights.append(PPO.load(tmp_path / name / "policy.zip").policy.state_dict())
    assert all(np.array_equal(weights[0][key], weights[1][key]) for key in weights[0])


def test_stopped_run_leaves_its_last_checkpoint(
    tube: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = RunRecord.write

    def write_then_stop(*args: object, **kwargs: object) -> None:
        write(*args, **kwargs)  # type: ignore[arg-type]
        raise KeyboardInterrupt

    monkeypatch.setattr(RunRecord, "write", write_then_stop)
    with pytest.raises(KeyboardInterrupt):
        ppo.train(tube, TINY, 0, tmp_path)
    record, _ = read_files(tmp_path)
    assert record["is_finished"] is False
    assert record["steps"] == 512
    PPO.load(tmp_path / "policy.zip")


def test_a_short_run_learns_to_swim_ahead(tube: Scenario, tmp_path: Path) -> None:
    settings = TrainSettings(
        steps=8192, reward="dense", num_envs=4, hidden=(64, 64), buffer=1024, batch=128, epochs=10, learning_rate=1e-3
    )
    ppo.train(tube, settings, 0, tmp_path)
    trained = mean_gain(tube, PPO.load(tmp_path / "policy.zip"))
    # 6 s ahead at 1 m/s would be 6 m, random actions gain 1.2 m; seeds 0 to 2 gave 5.2, 3.4 and 2.7 m.
    assert trained > mean_gain(tube, None) + 1.0
