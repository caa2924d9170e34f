"""What the options of the task do to the environment."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.safety import SafetyWrapper
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.protocol import read_protocol
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import TaskOptions
from aquanav_tools.train.pipeline import read_pipeline
from aquanav_tools.train.settings import TrainSettings
from tests.caves import TUBE_RADIUS, tube_clearance

AHEAD, IDLE, LEFT_AHEAD = [1, 1, 2], [1, 1, 1], [1, 0, 2]
WAYS = [AHEAD, LEFT_AHEAD, AHEAD, IDLE, [0, 1, 2], AHEAD, [2, 2, 2], AHEAD]


@contextmanager
def opened(scenario: Scenario, **options: Any) -> Iterator[CaveEnv]:
    env = CaveEnv(scenario, **options)
    try:
        yield env
    finally:
        env.close()


def swim(env: CaveEnv, actions: list[list[int]], **reset: Any) -> list[tuple[Any, ...]]:
    obs, info = env.reset(**reset)
    return [(obs, 0.0, False, False, info), *(env.step(action) for action in actions)]


def test_environments_training_and_evaluation_pay_by_one_default(tube: Scenario) -> None:
    with opened(tube) as env:
        rewards = {env.task.reward, SurfaceEnv(sea="still").task.reward}
    evaluation = EvaluateOptions(policies=("baseline:random",), scenario=(Path("cave"),))
    assert rewards == {evaluation.reward} == {TrainSettings().reward} == {"careful"}


def test_what_continues_the_paper_says_by_itself_that_it_pays_as_the_paper_did() -> None:
    assert read_protocol("paper")["reward"] == "dense"
    for name in ("paper", "paper-end-to-end", "paper-clip-01", "paper-recurrent", "paper-sac", "bay-standard"):
        assert {lesson.reward for lesson in read_pipeline(name, {}).lessons} == {"dense"}


def test_by_default_a_decision_in_contact_costs_more_than_swimming_through_it_earns(tube: Scenario) -> None:
    with opened(tube) as env:
        steps = swim(env, [*[LEFT_AHEAD] * 9, *[AHEAD] * 51], options={"start": 10})
    touching = [reward for _, reward, _, _, info in steps if info["cost"]]
    assert touching
    assert max(touching) < 0.0


def test_a_delayed_action_is_the_same_action_later(tube: Scenario) -> None:
    start = {"options": {"start": 10}}
    with opened(tube) as prompt, opened(tube, action_delay=3) as late:
        expected = swim(prompt, [IDLE] * 3 + WAYS, **start)
        seen = swim(late, [*WAYS, IDLE, IDLE, IDLE], **start)
    for one, other in zip(expected, seen, strict=True):
        np.testing.assert_array_equal(one[4]["position"], other[4]["position"])


def test_a_late_observation_is_an_earlier_one_and_reward_and_info_are_of_now(tube: Scenario) -> None:
    start = {"options": {"start": 10}}
    with opened(tube) as prompt, opened(tube, observation_delay=2) as late:
        expected, seen = swim(prompt, WAYS, **start), swim(late, WAYS, **start)
    for n, (step, original) in enumerate(zip(seen, expected, strict=True)):
        np.testing.assert_array_equal(step[0], expected[max(n - 2, 0)][0])
        assert step[1] == original[1]
        np.testing.assert_array_equal(step[4]["position"], original[4]["position"])


def test_noise_is_seen_and_not_lived(tube: Scenario) -> None:
    with opened(tube, reward="safe") as clean, opened(tube, reward="safe", sensor_noise=0.1) as noisy:
        expected, seen = swim(clean, WAYS, seed=3), swim(noisy, WAYS, seed=3)
    for one, other in zip(expected, seen, strict=True):
        assert np.abs(one[0][:28] - other[0][:28]).max() > 0.0
        np.testing.assert_array_equal(one[0][28:], other[0][28:])
        np.testing.assert_array_equal(one[4]["rays"], other[4]["rays"])
        assert one[1] == other[1]


def test_every_ray_can_lose_its_echo(tube: Scenario) -> None:
    with opened(tube, sensor_dropout=1.0) as deaf:
        assert (swim(deaf, WAYS, seed=0)[-1][0][:28] == 1.0).all()
    with opened(tube, sensor_dropout=1.0, observation="original") as deaf:
        cells = swim(deaf, WAYS, seed=0)[-1][0][:112].reshape(28, 4)
        np.testing.assert_array_equal(cells, [[0, 0, 1, 1]] * 28)


def test_the_current_of_an_episode_is_drawn_from_its_range(tube: Scenario) -> None:
    with opened(tube, current=(0.4, 0.0, -0.2), current_range=(0.5, 1.5)) as env:
        speeds = [env.reset(seed=seed)[1]["current"] for seed in range(40)]
        shares = np.array(speeds)[:, 0] / 0.4
        np.testing.assert_allclose(np.array(speeds), shares[:, None] * [0.4, 0.0, -0.2])
        assert 0.5 <= shares.min() < 0.7 < 1.3 < shares.max() <= 1.5
        assert np.ptp([step[4]["current"][0] for step in swim(env, WAYS)]) == 0.0  # the same all through an episode


def test_starts_anywhere_are_free_spread_and_head_for_the_goal(tube: Scenario) -> None:
    with opened(tube, starts="anywhere") as env:
        infos = [env.reset(seed=seed)[1] for seed in range(150)]
        capsule = env.vehicle.capsule
    places = np.array([info["position"] for info in infos])
    # starts keep 2 m and the goal's tolerance of 0.5 m from the goal, but for half a cell of 0.2 m
    assert np.linalg.norm(places - [19.0, 0.0, 0.0], axis=1).min() >= 2.3
    assert places[:, 0].min() < 3.0
    assert np.ptp(places[:, 1]) > TUBE_RADIUS
    # Even over the length: 150 draws put 37 in each quarter, give or take 5.3; four sigma
    assert np.abs(np.histogram(places[:, 0], 4, (0.4, 16.6))[0] - 37.5).max() < 22
    yaws = np.array([2 * np.arctan2(info["orientation"][3], info["orientation"][0]) for info in infos])
    assert np.abs(yaws).max() <= np.deg2rad(45 + 15)  # off the axis the way to the goal leans by up to 15 degrees
    ahead = 0.5 * capsule.axis_length * np.stack([np.cos(yaws), np.sin(yaws), 0 * yaws], axis=1)
    rooms = np.minimum(tube_clearance(places + ahead), tube_clearance(places - ahead)) - capsule.radius
    assert rooms.min() > 0.05
    assert {info["start_index"] for info in infos} == {-1}
    assert not any(info["collision"] for info in infos)


def test_the_same_seed_draws_the_same_start_anywhere(tube: Scenario) -> None:
    with opened(tube, starts="anywhere", sensor_noise=0.05, current_range=(0.0, 2.0)) as first:
        with opened(tube, starts="anywhere", sensor_noise=0.05, current_range=(0.0, 2.0)) as second:
            swim(second, WAYS, seed=8)  # what happened before must not matter
            for one, other in zip(swim(first, WAYS, seed=5), swim(second, WAYS, seed=5), strict=True):
                np.testing.assert_array_equal(one[0], other[0])
                assert one[1] == other[1]


def test_episodes_begin_in_the_chosen_share_of_the_way(tube: Scenario) -> None:
    with opened(tube, start_range=(0.7, 0.85)) as env:
        infos = [env.reset(seed=seed)[1] for seed in range(60)]
        asked = env.reset(options={"start": 0})[1]["start_index"]
    # Of the 18 m from the first panel to the goal at x = 19 m.
    wanted = {n for n, start in enumerate(tube.starts) if 0.7 <= (19.0 - start.pose.position[0]) / 18.0 <= 0.85}
    assert {info["start_index"] for info in infos} == wanted and 0 < len(wanted) < len(tube.starts)
    for info in infos:  # numbers stay those of the scenario
        np.testing.assert_array_equal(info["position"], tube.starts[info["start_index"]].pose.position)
    assert asked == 0  # a start by number is taken as it is


def test_a_share_that_has_all_starts_changes_no_draw(tube: Scenario) -> None:
    def drawn(**task: tuple[float, float]) -> list[int]:
        with opened(tube, **task) as env:
            return [env.reset(seed=seed)[1]["start_index"] for seed in range(30)]

    assert drawn(start_range=(0.5, 0.99)) == drawn()


def test_starts_anywhere_keep_to_the_chosen_share(tube: Scenario) -> None:
    with opened(tube, starts="anywhere", start_range=(0.0, 0.5)) as env:
        places = np.array([env.reset(seed=seed)[1]["position"] for seed in range(60)])
    # The longest way is 18.6 m and 1 m aside; half a cell is 0.2 m.
    assert places[:, 0].min() > 19.0 - 0.5 * np.hypot(18.8, 1.9) - 0.3
    assert np.linalg.norm(places - [19.0, 0.0, 0.0], axis=1).min() >= 2.3


@pytest.mark.parametrize(
    ("share", "sentence"),
    [
        ((0.0, 0.3), r"None of the 20 starts .* has 0 to 0.3 .* they have 0.61 to 0.97.*--starts.last-share 1"),
        ((0.5, 0.5), "start_range is 0.5 to 0.5; it rises"),
        ((-0.1, 0.5), "start_range is -0.1 to 0.5; it rises"),
    ],
)
def test_a_share_without_starts_is_told(tube: Scenario, share: tuple[float, float], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        with opened(tube, start_range=share):
            pass


def test_a_listed_start_can_be_asked_for_when_they_are_drawn_anywhere(tube: Scenario) -> None:
    with opened(tube, starts="anywhere") as env:
        assert env.reset(options={"start": 4})[1]["start_index"] == 4


@pytest.mark.parametrize("progress", ["panels", "geodesic"])
def test_every_measure_pays_ten_per_metre_towards_the_goal(tube: Scenario, progress: str) -> None:
    with opened(tube, progress=progress) as env:
        steps = swim(env, [AHEAD] * 60, options={"start": 10})
    paid = sum(step[4]["reward/progress"] for step in steps)
    way = steps[-1][4]["position"][0] - steps[0][4]["position"][0]
    assert way > 4.0
    # Planes square to the tube are exact; ways from 0.5 m off the axis lean by 3 degrees and are 1 % off.
    assert paid == pytest.approx(10.0 * way, rel={"panels": 0.001, "geodesic": 0.02}[progress])


def test_the_originals_measure_pays_for_its_chain_of_centres(tube: Scenario) -> None:
    with opened(tube, progress="original") as env:
        steps = swim(env, [AHEAD] * 70, options={"start": 0})
    first, last = steps[0][4]["position"], steps[-1][4]["position"]
    panels = np.linspace(1.0, 19.0, 10)  # on the axis
    following = panels[panels > last[0] - 0.5][0]  # crossed once the tail has left it; the hull is 0.46 m long
    assert 0.3 < abs(last[0] - following) < 1.7
    before = np.linalg.norm(first - [1.0, 0.0, 0.0]) + 18.0
    after = np.linalg.norm(last - [following, 0.0, 0.0]) + 19.0 - following
    paid = sum(step[4]["reward/progress"] for step in steps)
    assert paid == pytest.approx(10.0 * (before - after))


def test_info_and_success_go_by_the_panels_whatever_is_paid(tube: Scenario) -> None:
    with opened(tube) as panels, opened(tube, progress="geodesic") as geodesic:
        for one, other in zip(swim(panels, WAYS, seed=1), swim(geodesic, WAYS, seed=1), strict=True):
            assert one[4]["remaining"] == other[4]["remaining"]


def test_safety_gymnasiums_form_has_the_cost_between_reward_and_end(tube: Scenario) -> None:
    env = SafetyWrapper(CaveEnv(tube))
    env.reset(options={"start": 10})
    steps = [env.step(LEFT_AHEAD if n < 9 else AHEAD) for n in range(60)]
    assert all(len(step) == 6 for step in steps)
    assert [step[2] for step in steps] == [float(step[5]["collision"]) for step in steps]
    assert {0.0, 1.0} == {step[2] for step in steps}
    assert all(isinstance(step[3], bool) and isinstance(step[4], bool) for step in steps)
    env.close()


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"sensor_noise": -0.1}, "sensor_noise is -0.1; it is a length of 0 m or more"),
        ({"sensor_noise": float("nan")}, "sensor_noise is nan"),
        ({"sensor_dropout": 1.5}, "it is a probability from 0 to 1"),
        ({"action_delay": -1}, "action_delay is -1; it is a number of decisions from 0 to 100"),
        ({"observation_delay": 101}, "observation_delay is 101"),
        ({"current_range": (1.0, 0.5)}, "current_range is 1.0 to 0.5; it rises"),
    ],
)
def test_senseless_values_are_refused(choice: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        TaskOptions(**choice)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"progress": "geodesics"}, "no measure of progress 'geodesics'. Did you mean 'geodesic'"),
        ({"starts": "any"}, "no rule for starts 'any'"),
        ({"sensor_nois": 0.1}, "The task has no option 'sensor_nois'. Did you mean 'sensor_noise'"),
    ],
)
def test_unknown_names_get_the_closest(tube: Scenario, choice: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        CaveEnv(tube, **choice)
    assert message in str(error.value)


def test_episode_has_conditions_of_its_own_and_the_next_has_the_tasks_again(tube: Scenario) -> None:
    with opened(tube) as env, opened(tube, sensor_dropout=1.0) as deaf:
        calm, noise = (env.reset(seed=3, options={"start": 1, "sensor_dropout": share})[0] for share in (0.0, 1.0))
        np.testing.assert_array_equal(noise, deaf.reset(seed=3, options={"start": 1})[0])
        assert not np.array_equal(calm, noise)
        np.testing.assert_array_equal(env.reset(seed=3, options={"start": 1})[0], calm)
        with pytest.raises(InputError, match=r"no option 'sensor_drop'\. Did you mean 'sensor_dropout'"):
            env.reset(options={"sensor_drop": 0.5})
        with pytest.raises(InputError, match="sensor_dropout is 2"):
            env.reset(options={"sensor_dropout": 2})
