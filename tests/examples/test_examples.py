"""Each example runs as it stands, learns to pass the tube, and tells the truth about episodes."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

import aquanav
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.scenario.folder import write_scenario
from tests.caves import tube_scenario
from tests.conftest import REPOSITORY

EXAMPLES = REPOSITORY / "examples"
LIMIT = 300
"""Decisions. Straight ahead takes about 170 from the farthest start of the tube, a walk at random thousands."""
BUDGET = ("--num-envs", "64", "--num-steps", "32", "--max-decisions", str(LIMIT), "--eval-episodes", "10")
LAST = r"After learning, 10 episodes: success (\d+)%, without a collision \d+%, mean return (-?\d+\.\d)"


@pytest.fixture(scope="module")
def cave(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tube(tmp_path_factory.mktemp("cave"))


def write_tube(folder: Path) -> Path:
    write_scenario(tube_scenario(), folder / "tube")
    return folder / "tube"


def run(name: str, cave: Path, folder: Path, *options: str) -> str:
    """Return what an example prints, run as a user runs it, in an empty folder."""
    command = [sys.executable, str(EXAMPLES / name), "--scenario", str(cave), *BUDGET, *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo_torch.py", "sb3_vec.py"])
def test_example_learns_to_reach_the_goal_and_writes_nothing_unasked(name: str, cave: Path, tmp_path: Path) -> None:
    """Untrained networks reach it in no episode (below); 40,000 decisions taught it in 10 of 10 (measured)."""
    printed = run(name, cave, tmp_path, "--steps", "40000")
    found = re.search(LAST, printed)
    assert found is not None, printed
    assert int(found[1]) >= 80 and float(found[2]) > 0.0
    assert re.search(r"^ +\d+ decisions.*; ", printed, re.M)
    assert list(tmp_path.iterdir()) == []


def test_an_untrained_network_does_not_reach_the_goal(cave: Path) -> None:
    example = load("ppo_torch")
    args = example.parse_arguments(["--scenario", str(cave), *BUDGET])
    torch.manual_seed(0)
    episodes = example.evaluate(example.ActorCritic(44, [3, 3, 3]), args)
    assert [(one.outcome, one.length) for one in episodes] == [("timeout", LIMIT)] * 10


def test_weights_are_saved_where_asked(cave: Path, tmp_path: Path) -> None:
    printed = run("ppo_torch.py", cave, tmp_path, "--steps", "2048", "--save", "weights.pt")
    assert re.search(LAST, printed) is not None, printed
    assert [path.name for path in tmp_path.iterdir()] == ["weights.pt"]
    weights = torch.load(tmp_path / "weights.pt", weights_only=True)
    network = load("ppo_torch").ActorCritic(44, [3, 3, 3])
    network.load_state_dict(weights)
    assert sum(tensor.abs().sum() for name, tensor in weights.items() if name.endswith("bias")) > 0.0, "they moved"


def test_the_zip_of_stable_baselines3_is_a_policy_for_evaluation(cave: Path, tmp_path: Path) -> None:
    printed = run("sb3_vec.py", cave, tmp_path, "--steps", "2048", "--save", "policy.zip")
    assert re.search(LAST, printed) is not None, printed
    assert [path.name for path in tmp_path.iterdir()] == ["policy.zip"]
    loaded = load_policy(str(tmp_path / "policy.zip"))
    assert (loaded.observation, loaded.action) == ("full", "multidiscrete")


def sums_of(step: Callable[[], tuple[np.ndarray, dict[int, float]]], num: int) -> tuple[list[float], list[float]]:
    """Return of 400 steps what each ended episode's rewards add up to, and what is said of it."""
    sums, added, said = np.zeros(num), [], []
    for _ in range(400):
        rewards, ended = step()
        sums += rewards
        for vehicle, total in ended.items():
            added.append(float(sums[vehicle]))
            said.append(total)
            sums[vehicle] = 0.0
    return added, said


def test_an_episode_is_told_once_with_the_sum_of_its_rewards(cave: Path) -> None:
    example, num = load("ppo_torch"), 6
    envs = aquanav.make_vec_env(cave, num, autoreset_mode="SameStep", max_decisions=90)
    envs.reset(seed=3)

    def step() -> tuple[np.ndarray, dict[int, float]]:
        _, rewards, _, _, infos = envs.step([[1, 1, 2]] * 3 + [[1, 1, 1], [1, 0, 2], [1, 1, 0]])
        ended = example.ended_in(infos)
        assert all(one.length <= 90 for one in ended.values())
        return rewards, {vehicle: one.total for vehicle, one in ended.items()}

    added, said = sums_of(step, num)
    assert len(said) >= num * (400 // 90)
    assert np.allclose(added, said, atol=1e-3)  # float32 sums of rewards up to 50


def test_advantages_are_the_sum_of_discounted_errors() -> None:
    """Its definition (Schulman et al. 2016, eq. 16), written out, with an episode's end in between."""
    example = load("ppo_torch")
    torch.manual_seed(1)
    rewards, values, next_values = torch.randn(3, 5, 2).double()
    ended = torch.zeros(5, 2, dtype=torch.bool)
    ended[2, 0] = True
    rollout: Any = example.Rollout(*[torch.zeros(5, 2)] * 3, rewards, values, next_values, ended)
    errors = rewards + 0.9 * next_values - values
    expected = [
        [sum(0.72**n * errors[t + n, i] for n in range(5 - t) if not ended[t : t + n, i].any()) for i in range(2)]
        for t in range(5)
    ]
    found = example.advantages_of(rollout, discount=0.9, gae_lambda=0.8)
    assert torch.allclose(found, torch.tensor(expected).double())


def test_scaled_rewards_are_divided_by_the_deviation_of_the_discounted_return(rng: np.random.Generator) -> None:
    scale = load("ppo_torch").ReturnScale(3, 0.9)
    returns, kept = np.zeros(3), []
    for _ in range(20):
        rewards, ended = rng.normal(size=3), rng.random(3) < 0.2
        scaled = scale(rewards, ended)
        returns = 0.9 * returns + rewards
        kept.append(returns.copy())
        assert np.allclose(scaled, rewards / np.std(kept), atol=1e-6)
        returns[ended] = 0.0
