from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from aquanav_tools.cave.water.flow import find_flow
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.types import Pose, yaw_quaternion
from tests.caves import TUBE_RADIUS, tube_clearance, tube_scenario
from tests.sim.batch.guides import Tracker

AHEAD, IDLE, LEFT_AHEAD, UP = [1, 1, 2], [1, 1, 1], [1, 0, 2], [0, 1, 1]


@pytest.fixture
def env(tube: Scenario) -> Iterator[CaveEnv]:
    env = CaveEnv(tube, reward="dense")
    env.reset(seed=0)
    yield env
    env.close()


def roll(env: CaveEnv, seed: int, decisions: int = 80) -> list[tuple[Any, ...]]:
    """Act at random, mostly ahead; return everything the environment gives."""
    actions = np.random.default_rng(seed)
    obs, info = env.reset(seed=seed)
    steps: list[tuple[Any, ...]] = [(obs, 0.0, False, False, info)]
    for _ in range(decisions):
        steps.append(env.step([*actions.integers(0, 3, 2), actions.choice([1, 2, 2])]))
    return steps


def assert_same(first: list[tuple[Any, ...]], second: list[tuple[Any, ...]]) -> None:
    for (obs_a, *rest_a, info_a), (obs_b, *rest_b, info_b) in zip(first, second, strict=True):
        np.testing.assert_array_equal(obs_a, obs_b)
        assert rest_a == rest_b
        assert info_a.keys() == info_b.keys()
        for name in info_a:
            np.testing.assert_array_equal(info_a[name], info_b[name])


@pytest.mark.parametrize("action", ["multidiscrete", "discrete", "continuous"])
@pytest.mark.parametrize("observation", ["paper", "full", "original"])
def test_gymnasium_and_sb3_accept_the_environment(tube: Scenario, action: str, observation: str) -> None:
    env = CaveEnv(tube, action=action, observation=observation)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
        check_env_for_sb3(env)
    env.close()


def test_an_episode_that_starts_behind_the_goal_ends_when_the_vehicle_has_come_back_to_it(tube: Scenario) -> None:
    guide = dataclasses.replace(tube.guide, panels=tube.guide.panels[:6])
    goal = dataclasses.replace(tube.settings.goal, position=tuple(float(c) for c in guide.centres[-1]))
    pose = Pose(np.array([14.0, 0.0, 0.0]), yaw_quaternion(np.pi))
    start = dataclasses.replace(tube.starts[0], pose=pose, geodesic_to_goal=14.0 - goal.position[0])
    settings = dataclasses.replace(tube.settings, goal=goal)
    with CaveEnv(dataclasses.replace(tube, guide=guide, settings=settings, starts=(start,))) as env:
        _, info = env.reset(seed=0)
        places = [info["position"][0]]
        while info["outcome"] == "running":
            info = env.step(AHEAD)[4]
            places.append(info["position"][0])
    assert info["outcome"] == "success"
    # Behind by its tolerance: no decision before reached it, and the last one did.
    assert places[-1] <= goal.position[0] + goal.tolerance < places[-2]


def test_gymnasium_makes_it_by_its_name(tube: Scenario) -> None:
    env = gymnasium.make("aquanav/Cave-v0", scenario=tube, observation="paper")
    obs, _ = env.reset(seed=0)
    assert obs.shape == (31,)
    env.close()


def test_it_opens_a_scenario_folder(tmp_path: Path) -> None:
    write_scenario(tube_scenario(), tmp_path / "tube")
    env = CaveEnv(tmp_path / "tube")
    assert env.reset(seed=0)[1]["remaining"] > 5.0
    env.close()


def test_same_seed_gives_the_same_episode_bit_for_bit(tube: Scenario) -> None:
    first, second = CaveEnv(tube), CaveEnv(tube)
    episode = roll(first, 3)
    assert any(step[4]["collision"] for step in episode)
    roll(second, 8)  # what happened before must not matter
    assert_same(roll(second, 3), episode)
    assert_same(roll(first, 3), episode)
    first.close()
    second.close()


def test_other_seeds_give_other_starts(env: CaveEnv) -> None:
    assert len({env.reset(seed=seed)[1]["start_index"] for seed in range(20)}) > 5


def test_start_can_be_chosen(env: CaveEnv) -> None:
    _, info = env.reset(options={"start": 7})
    assert info["start_index"] == 7
    np.testing.assert_array_equal(info["position"], env.scenario.starts[7].pose.position)


def test_an_episode_begins_at_the_gate_of_its_start_however_often_it_began_there(env: CaveEnv) -> None:
    guide, field, starts = env.scenario.guide, env.scenario.field, env.scenario.starts
    tracker = Tracker(guide)
    for index in [*range(len(starts)), *range(len(starts))]:
        _, info = env.reset(options={"start": index})
        position = starts[index].pose.position
        expected = guide.length - tracker.remaining(position, guide.locate(position, field))
        assert info["progress"] == pytest.approx(expected)


def test_swimming_ahead_reaches_the_goal_and_pays_for_it(env: CaveEnv) -> None:
    _, info = env.reset(options={"start": 10})
    remaining, rewards, terminated = info["remaining"], [], False
    while not terminated:
        _, reward, terminated, truncated, info = env.step(AHEAD)
        rewards.append(reward)
        assert not truncated
    assert info["outcome"] == "success"
    assert info["remaining"] <= 0.5
    assert info["num_collisions"] == 0
    # Ten per metre, a cent per physics step, 500 at the goal.
    assert sum(rewards) == pytest.approx(10 * (remaining - info["remaining"]) - 0.05 * len(rewards) + 500)


PRICES = {"dense": (10.0, -0.01, -0.01, 0.0), "safe": (10.0, -0.01, -0.01, -0.005), "careful": (10.0, -0.01, -1.0, 0.0)}
"""Of progress, m, and of each of 5 physics steps: time, contact, and share of rays lost, as documented."""


@pytest.mark.parametrize("reward", PRICES)
def test_reward_is_what_the_table_pays_for_what_info_tells(tube: Scenario, reward: str) -> None:
    progress, time, contact, proximity = PRICES[reward]
    env = CaveEnv(tube, reward=reward, on_collision="continue")
    first, *others = roll(env, 2, 40)
    remaining = first[4]["remaining"]
    for _, total, _, _, info in others:
        num_contacts = round(info["reward/contact"] / contact) if contact else 0
        assert not contact or ((num_contacts > 0) == info["collision"] and num_contacts <= 5)
        lost = float((1.0 - info["rays"] / original_pattern().lengths).sum())
        paid = progress * (remaining - info["remaining"]) + 5 * (time + proximity * lost) + contact * num_contacts
        assert info["outcome"] == "running"
        assert total == pytest.approx(paid, abs=1e-5)  # rays are in float32
        remaining = info["remaining"]
    env.close()


def test_info_always_has_the_same_keys(env: CaveEnv) -> None:
    assert len({tuple(step[4]) for step in roll(env, 1, 30)}) == 1


def test_observations_are_finite_and_every_value_changes(tube: Scenario) -> None:
    env = CaveEnv(tube)
    seen = np.array([step[0] for seed in range(6) for step in roll(env, seed)])
    assert np.isfinite(seen).all()
    assert (np.ptp(seen, axis=0) > 0).all()
    env.close()


def test_clearance_is_that_of_the_hull(env: CaveEnv) -> None:
    capsule = env.vehicle.capsule
    for start in (0, 9, 19):
        _, info = env.reset(options={"start": start})  # level, heading along the tube
        nose = info["position"] + [capsule.axis_length / 2, 0, 0]
        tail = info["position"] - [capsule.axis_length / 2, 0, 0]
        expected = tube_clearance(np.array([nose, tail])).min() - capsule.radius
        assert info["clearance"] == pytest.approx(expected, abs=0.01)  # the field's interpolation


def test_contact_is_counted_charged_and_costs(env: CaveEnv) -> None:
    env.reset(options={"start": 10})
    infos = [env.step(LEFT_AHEAD if n < 9 else AHEAD)[4] for n in range(60)]
    assert infos[-1]["collision"]
    assert infos[-1]["cost"] == 1.0
    assert infos[-1]["num_collisions"] >= 1
    assert infos[-1]["reward/contact"] == pytest.approx(-0.05)
    assert infos[0]["cost"] == infos[0]["num_collisions"] == 0
    assert infos[-1]["clearance"] < 0.02
    assert np.hypot(*infos[-1]["position"][1:]) < TUBE_RADIUS


@pytest.mark.parametrize("options", [{"on_collision": "end", "reward": "dense"}, {"reward": "sparse"}])
def test_first_contact_ends_the_episode_where_asked(tube: Scenario, options: dict[str, Any]) -> None:
    env = CaveEnv(tube, **options)
    env.reset(options={"start": 10})
    terminated, decisions = False, 0
    while not terminated:
        _, reward, terminated, _, info = env.step(LEFT_AHEAD if decisions < 9 else AHEAD)
        decisions += 1
    assert info["outcome"] == "collision"
    # -10 by the paper; by the original -1000, less time, contact and a step forth or back
    assert reward == (-10.0 if options["reward"] == "sparse" else pytest.approx(-1000.0, abs=3.0))
    env.close()


def test_time_runs_out_at_the_limit(tube: Scenario) -> None:
    env = CaveEnv(tube, max_decisions=4)
    env.reset(seed=0)
    ends = [env.step(IDLE)[2:4] for _ in range(4)]
    assert ends == [(False, False)] * 3 + [(False, True)]
    env.close()


def test_idle_vehicle_floats_where_it_is(env: CaveEnv) -> None:
    _, before = env.reset(options={"start": 3})
    for _ in range(50):
        after = env.step(IDLE)[4]
    np.testing.assert_allclose(after["position"], before["position"], atol=1e-9)


def test_idle_vehicle_drifts_with_the_current(tube: Scenario) -> None:
    env = CaveEnv(tube, current=(0.2, 0.0, 0.0))
    _, before = env.reset(options={"start": 3})
    for _ in range(100):
        after = env.step(IDLE)[4]
    assert 0.5 < after["position"][0] - before["position"][0] < 2.0  # 0.2 m/s for 10 s, less the time to be caught
    np.testing.assert_array_equal(after["current"], [0.2, 0, 0])
    env.close()


def test_current_is_that_where_the_vehicle_is_and_repeats_with_the_seed(tube: Scenario) -> None:
    flow = find_flow(tube.cavity, tube.field, tube.guide.centres, 2.0, spacing=0.5)
    scenario = dataclasses.replace(tube, flow=flow)
    runs = []
    for seed in (7, 7, 8):
        env = CaveEnv(scenario, current="half")
        _, info = env.reset(seed=seed, options={"start": 3})
        infos = [info, *(env.step(IDLE)[4] for _ in range(50))]
        runs.append(np.array([[*info["position"], *info["current"]] for info in infos]))
        env.close()
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.abs(runs[0] - runs[2]).max() > 1e-3
    assert -0.4 < runs[0][:, 3].mean() < -0.1  # 0.25 m/s from the goal to the entrance, with eddies
    assert runs[0][-1, 0] < runs[0][0, 0] - 0.3  # 5 s of it, less the time to be caught


def test_ballast_up_lifts_the_vehicle(env: CaveEnv) -> None:
    _, before = env.reset(options={"start": 3})
    for _ in range(10):
        after = env.step(UP)[4]
    assert after["position"][2] > before["position"][2] + 0.05


def test_limits_of_the_scenario_apply() -> None:
    scenario = tube_scenario(limits=LimitSettings(dt=0.01, substeps=2, decisions=2))
    env = CaveEnv(scenario)
    env.reset(seed=0)
    *_, info = env.step(IDLE)
    assert info["reward/time"] == pytest.approx(-0.02)
    assert env.step(IDLE)[3]
    env.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"observation": "ful"}, "no observation preset 'ful'. Did you mean 'full'"),
        ({"action": "multi_discrete"}, "Did you mean 'multidiscrete'"),
        ({"reward": "saef"}, "Did you mean 'safe'"),
        ({"on_collision": "stop"}, "no collision rule 'stop'"),
        ({"vehicle": "bluerov3"}, "Did you mean 'bluerov2'"),
        ({"current": (0, np.nan, 0)}, "water.current = nan is outside"),
        ({"current": (0, 99, 0)}, "water.current = 99.0 is outside"),
        ({"current": (0, 99)}, "neither a preset nor 1 or 3 numbers"),
        ({"current": "flod"}, "Did you mean 'flood'"),
        ({"max_decisions": 0}, "max_decisions must be at least 1"),
    ],
)
def test_unknown_options_are_refused_with_advice(tube: Scenario, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        CaveEnv(tube, **options)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"strat": 1}, "Did you mean 'start'"),
        ({"start": 20}, "from 0 to 19, got 20"),
        ({"start": -1}, "from 0 to 19, got -1"),
        ({"start": "first"}, "from 0 to 19, got 'first'"),
    ],
)
def test_senseless_reset_options_are_refused(env: CaveEnv, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        env.reset(options=options)
    assert message in str(error.value)


def test_missing_scenario_is_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="is not a scenario"):
        CaveEnv(tmp_path / "nowhere")


def test_scenario_without_starts_is_refused(tube: Scenario) -> None:
    with pytest.raises(ScenarioError, match="no starts"):
        CaveEnv(dataclasses.replace(tube, starts=()))


def test_a_scenario_dives_with_the_vehicle_it_carries(tube: Scenario) -> None:
    from aquanav_tools.sim.vehicle import vehicle_path

    text = vehicle_path("bluerov2").read_text().replace("mass = 11.5 ", "mass = 12.0 ")
    env = CaveEnv(dataclasses.replace(tube, vehicle_toml=text))
    assert env.vehicle.body.mass == 12.0
    env.close()
