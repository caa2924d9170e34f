from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.observation import layout
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.metrics import EpisodeReference, measure
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import EpisodePlan
from aquanav_tools.evaluate.rollout import run_episode
from aquanav_tools.evaluate.shield import ShieldedPolicy
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import TaskOptions
from tests.evaluate.models import make_model


class Stubborn:
    """Always does the same."""

    def __init__(self, action: Any) -> None:
        self.action = action
        self.seen: list[int] = []

    def reset(self, seed: int) -> None:
        self.seen = []

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        self.seen.append(len(observation))
        return self.action


def run(tube: Scenario, policy: Any, action: str = "multidiscrete", decisions: int = 120, start: int = 0) -> Trajectory:
    env = CaveEnv(tube, action=action, max_decisions=decisions)
    trajectory = run_episode(env, policy, EpisodePlan(0, start))
    env.close()
    return trajectory


UP_TO_THE_ROOF = [
    ("multidiscrete", [0, 1, 1]),
    ("discrete", 9 * 0 + 3 * 1 + 1),
    ("continuous", np.array([1.0, 0.0, 0.0], dtype=np.float32)),
]


@pytest.mark.parametrize(("form", "action"), UP_TO_THE_ROOF, ids=str)
def test_shield_keeps_a_policy_that_rises_stubbornly_off_the_roof(form: str, action: Any, tube: Scenario) -> None:
    bare = run(tube, Stubborn(action), form)
    shielded = run(tube, ShieldedPolicy(Stubborn(action), "full", form), form)
    assert bare.num_collisions > 0  # the danger is real
    assert shielded.num_collisions == 0
    assert shielded.interventions is not None and shielded.interventions > 0


def test_shield_leaves_a_careful_policy_alone(tube: Scenario) -> None:
    careful = load_policy("baseline:reactive").policy
    bare, shielded = run(tube, careful), run(tube, ShieldedPolicy(careful, "full", "multidiscrete"))
    assert (bare.interventions, shielded.interventions) == (None, 0)
    np.testing.assert_array_equal(bare.positions, shielded.positions)


def test_policy_on_paper_observations_gets_these_through_the_shield(tube: Scenario) -> None:
    inner = Stubborn([1, 1, 2])
    run(tube, ShieldedPolicy(inner, "paper", "multidiscrete"), decisions=5)
    assert set(inner.seen) == {max(part.stop for part in layout("paper").values())}


def test_sensors_behind_full_reach_the_policy_through_the_shield(tube: Scenario) -> None:
    inner = Stubborn([1, 1, 2])
    env = CaveEnv(tube, sensors=("echosounders",), max_decisions=5)
    run_episode(env, ShieldedPolicy(inner, "full", "multidiscrete"), EpisodePlan(0, 0))
    assert env.observation_space.shape is not None
    assert set(inner.seen) == {env.observation_space.shape[0]}
    assert inner.seen[0] == max(part.stop for part in layout("full").values()) + 16
    env.close()
    loaded = load_policy("shield:baseline:reference-echosounders")
    assert loaded.rules(TaskOptions()).sensors == ("echosounders",)


def test_interventions_are_counted_per_episode(tube: Scenario) -> None:
    policy = ShieldedPolicy(Stubborn([0, 1, 1]), "full", "multidiscrete")
    counts = [run(tube, policy).interventions for _ in range(2)]
    assert counts[0] == counts[1] != 0
    reference = EpisodeReference("tube", "as given", 0.5, tube.guide.length, 1.0, None)
    assert measure(run(tube, policy), 10.0, reference).interventions == counts[0]


def test_shield_is_named_before_any_policy(tmp_path: Path) -> None:
    make_model(num_observations=31).save(tmp_path / "policy.zip")
    loaded = load_policy(f"shield:{tmp_path / 'policy.zip'}")
    assert (loaded.name, loaded.observation, loaded.action) == ("shield:policy.zip", "full", "multidiscrete")
    assert loaded.sha256 == load_policy(str(tmp_path / "policy.zip")).sha256


def test_shield_on_observations_without_speed_says_why_not(tmp_path: Path) -> None:
    make_model(num_observations=120).save(tmp_path / "policy.zip")
    with pytest.raises(InputError, match=r"observes the preset 'original', which has no speed"):
        load_policy(f"shield:{tmp_path / 'policy.zip'}")
