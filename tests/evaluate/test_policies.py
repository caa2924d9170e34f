from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.env_cache import EpisodeSpec, open_env_cache
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import conditions_of, plan_condition
from aquanav_tools.evaluate.summary import Summary, summarise
from aquanav_tools.scenario.schema import Scenario
from tests.evaluate.models import make_model
from tests.evaluate.winding import winding_scenario


def score(scenario: Scenario, spec: str, num_episodes: int, max_decisions: int = 1200, **task: Any) -> Summary:
    options = ProtocolOptions(episodes=num_episodes, max_decisions=max_decisions, **task)
    (condition,) = conditions_of(options.grid)
    plans = plan_condition(scenario, options, condition)
    with open_env_cache(load_policy(spec), options) as env_cache:
        episodes = [EpisodeSpec(index, scenario, condition, plan) for index, plan in enumerate(plans)]
        return summarise([env_cache.run(episode)[1] for episode in episodes])


def test_reactive_policy_dives_through_the_tube_without_a_collision(tube: Scenario) -> None:
    summary = score(tube, "baseline:reactive", 20)
    assert summary.collision_free_success.rate == 1.0
    assert summary.means["spl"].mean > 0.95


def test_reactive_policy_finds_a_goal_that_is_out_of_sight() -> None:
    summary = score(winding_scenario(), "baseline:reactive", 10)
    assert summary.collision_free_success.rate == 1.0


def test_random_policy_is_a_floor_below_the_reactive_one(tube: Scenario) -> None:
    summary = score(tube, "baseline:random", 5, max_decisions=600)
    assert summary.collision_free_success.rate == 0.0
    assert summary.means["collisions"].mean > 1


def test_random_policy_repeats_with_its_seed() -> None:
    policy = load_policy("baseline:random").policy
    draws = []
    for seed in (1, 1, 2):
        policy.reset(seed)
        draws.append([policy.act(np.zeros(44, dtype=np.float32)).tolist() for _ in range(20)])
    assert draws[0] == draws[1] != draws[2]
    assert set(np.unique(draws)) == {0, 1, 2}


def test_unknown_baseline_gets_the_closest_name() -> None:
    with pytest.raises(InputError, match=r"no baseline 'reactiv'. Did you mean 'reactive'"):
        load_policy("baseline:reactiv")


@pytest.mark.parametrize(("size", "preset"), [(44, "full"), (31, "paper")])
@pytest.mark.parametrize("form", ["multidiscrete", "discrete", "continuous"])
def test_presets_follow_from_the_policys_spaces(size: int, preset: str, form: str, tmp_path: Path) -> None:
    save(make_model(action=form, num_observations=size), tmp_path)
    loaded = load_policy(str(tmp_path / "policy.zip"))
    assert (loaded.observation, loaded.action) == (preset, form)
    assert loaded.name == "policy.zip"


def test_policy_for_other_spaces_is_told_what_would_fit(tmp_path: Path) -> None:
    save(make_model(action=spaces.Discrete(9), num_observations=12), tmp_path)
    with pytest.raises(InputError) as caught:
        load_policy(str(tmp_path / "policy.zip"))
    for part in ("Box of 12 values", "Discrete(9)", "full (44 values)", "paper (31 values)", "discrete (Discrete(27))"):
        assert part in str(caught.value)


def test_message_names_the_preset_that_fits_where_only_one_space_does(tmp_path: Path) -> None:
    save(make_model(action=spaces.Discrete(9), num_observations=31), tmp_path)
    shown = r"31 values \(the preset paper\).*Discrete\(9\) \(no form has that\).*observation='paper'"
    with pytest.raises(InputError, match=shown):
        load_policy(str(tmp_path / "policy.zip"))


def save(model: BaseAlgorithm, folder: Path) -> None:
    model.save(folder / "policy.zip")
