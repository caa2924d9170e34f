"""The user's own reward, sensors, observation, rule and disturbance, held against what infos tell."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import aquanav_tools.envs  # noqa: F401  # registers the environments
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.errors import InputError, OwnCodeError
from aquanav_tools.scenario.schema import Scenario
from tests.bullet import ENGINES
from tests.caves import TUBE_RADIUS
from tests.own_modules import WriteModule, own_module

__all__ = ["own_module"]

CODE = """
class Along:
    def terms(self, batch):
        return {"x": 2.0 * batch.positions[:, 0], "turn": -(batch.commands - batch.last_commands)[:, 1] ** 2}

class Beside(Along):
    base = "dense"

class Where:
    def spec(self, scenario, vehicle):
        return Box(-np.inf, np.inf, (3,))

    def measure(self, batch):
        return batch.positions

class Chance:
    def spec(self, scenario, vehicle):
        return Box(-np.inf, np.inf, (2, 2))

    def measure(self, batch):
        return batch.normals(4).reshape(-1, 2, 2)

class Own:
    space = Box(-np.inf, np.inf, (2,))
    base = "paper"

    def __call__(self, batch):
        assert batch.observations.shape[1] == 31
        return np.stack([batch.remaining, batch.decisions], axis=1)

def late(batch):
    return batch.positions[:, 0] > 10.0

class Off:
    def actions(self, batch, commands):
        return 0.0 * commands

def glide(states, commands, currents, dt):
    assert states.shape == (len(commands), 13) and currents.shape == (len(commands), 3)
    after = states.copy()
    after[:, 0] += dt * (0.5 * commands[:, 2] + currents[:, 0])
    after[:, 2] += dt * 0.1 * commands[:, 0]
    return after

class Plus:
    def observations(self, batch, observations):
        return observations + 1.0
"""


def wander(num: int, decision: int) -> np.ndarray:
    """Return (N, 3) actions, another for each vehicle and decision."""
    return np.stack([[1, (n + decision // 7) % 3, 2 if n % 3 else 1] for n in range(num)])


def run(tube: Scenario, decisions: int, num: int = 5, **options: Any) -> list[tuple[Any, ...]]:
    """Return what reset and each step return."""
    envs = CaveVectorEnv(num, tube, max_decisions=30, **options)
    observations, infos = envs.reset(seed=7)
    rows: list[tuple[Any, ...]] = [(observations, np.zeros(num), np.zeros(num, bool), np.zeros(num, bool), infos)]
    rows += [envs.step(wander(num, decision)) for decision in range(decisions)]
    envs.close()
    return rows


def test_a_reward_is_the_sum_of_its_terms_of_what_the_decision_led_to(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    rows = run(tube, 70, reward=f"{own}:Along")
    ended_before = np.zeros(5, bool)
    last = np.zeros(5)
    for decision, (_, rewards, terminated, truncated, infos) in enumerate(rows[1:]):
        steer = 1.0 - wander(5, decision)[:, 1]  # choices count from left, which is positive
        turn = np.where(ended_before, 0.0, -((steer - last) ** 2))
        x = np.where(ended_before, 0.0, 2.0 * infos["position"][:, 0])
        assert np.allclose(infos["reward/x"], x, rtol=1e-6)  # float32
        assert np.allclose(infos["reward/turn"], turn, rtol=1e-6)
        assert np.allclose(rewards, x + turn, rtol=1e-6)
        last = np.where(ended_before, 0.0, steer)
        ended_before = terminated | truncated
    assert any(row[3].any() for row in rows), "episodes end meanwhile"
    assert "reward/progress" not in infos


def test_the_command_before_an_episodes_first_is_idle_in_either_mode(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    last, num_ended = np.zeros(5), 0
    for n, (_, _, terminated, truncated, infos) in enumerate(
        run(tube, 70, reward=f"{own}:Along", autoreset_mode="SameStep")[1:]
    ):
        steer = 1.0 - wander(5, n)[:, 1]
        assert np.allclose(infos["reward/turn"], -((steer - last) ** 2))
        ended = terminated | truncated
        last = np.where(ended, 0.0, steer)
        num_ended += ended.sum()
    assert num_ended == 10


def test_a_rule_does_not_end_an_episode_before_its_first_decision(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module("def always(batch):\n    return batch.decisions >= 0")
    rows = run(tube, 6, termination=f"{own}:always")
    assert [row[2].tolist() for row in rows[1:]] == [[True] * 5, [False] * 5] * 3  # it ends, the next begins


def test_where_a_sensor_fails_for_one_the_others_read_what_they_would_have(
    tube: Scenario, own_module: WriteModule
) -> None:
    picky = """
class Picky(Chance):
    def measure(self, batch):
        assert 8 not in batch.seeds
        return batch.normals(4).reshape(-1, 2, 2)
"""
    own = own_module(CODE + picky)
    seen = []
    for seeds in ([7, 8, 9], [7, 6, 9]):
        batch = CaveBatch(tube, 3, next_step=True, sensors=(f"{own}:Picky",))
        batch.reset(seeds)
        seen.append((batch.copy_of("observations")[:, 44:], list(batch.failures)))
    assert [failed for _, failed in seen] == [[1], []]
    assert np.array_equal(seen[0][0][[0, 2]], seen[1][0][[0, 2]]) and np.ptp(seen[0][0][0]) > 0.0
    assert not seen[0][0][1].any()


def test_quaternions_of_a_law_are_brought_to_unit_length(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module("law = lambda states, commands, currents, dt: states * np.where(np.arange(13) < 3, 1.0, 1.05)")
    batch = CaveBatch(tube, 1, next_step=True, motion=f"{own}:law")
    batch.reset([0])
    batch.step()
    assert np.linalg.norm(batch.view_of("orientations")) == pytest.approx(1.0)


def test_a_reward_may_add_to_one_of_aquanavs(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    dense, beside = run(tube, 40, reward="dense"), run(tube, 40, reward=f"{own}:Beside")
    for plain, more in zip(dense[1:], beside[1:], strict=True):
        assert np.allclose(more[1] - plain[1], more[4]["reward/x"] + more[4]["reward/turn"], atol=1e-4)
        assert np.array_equal(more[4]["reward/progress"], plain[4]["reward/progress"])
        assert np.array_equal(more[0], plain[0])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_sensor_measures_where_the_vehicle_is(tube: Scenario, own_module: WriteModule, mode: str) -> None:
    own = own_module(CODE)
    rows = run(tube, 70, sensors=(f"{own}:Where",), autoreset_mode=mode)
    plain = run(tube, 70, autoreset_mode=mode)
    before = rows[0][0]
    for (observations, *_, infos), (without, *_) in zip(rows, plain, strict=True):
        assert np.array_equal(observations[:, :44], without)
        assert np.allclose(observations[:, 44:], infos["position"])
        if "final_obs" in infos:
            ends = np.stack(infos["final_obs"][infos["_final_obs"]])
            assert not np.allclose(ends[:, 44:], infos["position"][infos["_final_obs"]], atol=0.1), "of the end"
            assert np.allclose(ends[:, 44:], before[infos["_final_obs"], 44:], atol=0.2), "a decision further"
        before = observations
    assert mode == "NextStep" or any("final_obs" in row[4] for row in rows)


def test_sensors_are_late_like_all_that_is_observed(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    prompt, late = (run(tube, 25, sensors=(f"{own}:Where",), observation_delay=delay) for delay in (0, 3))
    plain = run(tube, 25, observation_delay=3)
    for n, (observations, *_) in enumerate(late):
        assert np.array_equal(observations[:, 44:], prompt[max(n - 3, 0)][0][:, 44:])
        assert np.array_equal(observations[:, :44], plain[n][0]), "as the batch itself delays"


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("delay", [0, 2])
def test_earlier_observations_follow_that_of_now(tube: Scenario, delay: int, mode: str) -> None:
    """Block by block they are what the same vehicles observed then; before its episode, what it began with."""
    plain = run(tube, 40, autoreset_mode=mode)
    blocks = run(tube, 40, autoreset_mode=mode, history=(1, 4), observation_delay=delay)
    began, num_ends = np.zeros(5, dtype=int), 0
    for n, (observations, _, terminated, truncated, _) in enumerate(blocks):
        ended = terminated | truncated
        if mode == "SameStep":
            began[ended] = n
        assert observations.shape == (5, 3 * 44)
        for block, age in enumerate((delay, delay + 1, delay + 4)):
            for i in range(5):
                expected = plain[max(n - age, began[i])][0][i]
                assert np.array_equal(observations[i, 44 * block : 44 * (block + 1)], expected)
        if mode == "NextStep":
            began[ended] = n + 1
        num_ends += ended.sum()
    assert num_ends >= 5


def test_a_history_has_no_future(tube: Scenario) -> None:
    with pytest.raises(InputError, match="history has 0; it has numbers of decisions from 1 to 100"):
        run(tube, 1, history=(3, 0))


def test_sensors_that_come_with_aquanav_stand_beside_ones_own(tube: Scenario, own_module: WriteModule) -> None:
    """Depth counts from the entrance, which is at the height 0; the sheet's error is 2 cm."""
    own = own_module(CODE)
    rows = run(tube, 40, sensors=("depth", f"{own}:Where", "imu"), autoreset_mode="SameStep", motion=f"{own}:glide")
    assert {row[0].shape for row in rows} == {(5, 44 + 1 + 3 + 6)}
    errors = [row[0][:, 44] + row[4]["position"][:, 2] for row in rows]
    assert 0.001 < np.std(errors) < 0.1
    assert all(np.allclose(row[0][:, 45:48], row[4]["position"]) for row in rows)


def test_a_dictionary_of_parts_takes_ones_own_by_name(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE + "\nclass Bad(Where):\n    def measure(self, batch):\n        return batch.decisions\n")
    parts = {"preset": "paper", "where": f"{own}:Where", "depth": "depth"}
    prompt = run(tube, 40, observation=parts, autoreset_mode="SameStep", reward=f"{own}:Along")
    late = run(tube, 20, observation=parts, autoreset_mode="SameStep", observation_delay=2)
    for n, (observations, *_, infos) in enumerate(prompt):
        assert np.allclose(observations["where"], infos["position"])
        assert n > 20 or np.array_equal(late[n][0]["where"], prompt[max(n - 2, 0)][0]["where"])
    with pytest.raises(OwnCodeError, match=rf"The sensor {own}:Bad returned an array of shape \(1,\), and \(1, 3\)"):
        run(tube, 1, observation={**parts, "bad": f"{own}:Bad"})
    with pytest.raises(InputError, match="A dictionary of parts is observed as it is"):
        run(tube, 1, observation=parts, sensors=(f"{own}:Where",))


def test_an_observation_stands_for_the_preset(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    envs = gymnasium.make_vec(
        "aquanav/Cave-v0", 3, vectorization_mode="vector_entry_point", scenario=tube, observation=f"{own}:Own",
        sensors=(f"{own}:Where",),
    )  # fmt: skip
    observations, infos = envs.reset(seed=1)
    assert observations.shape == (3, 5) and envs.single_observation_space.contains(observations[0])
    for n in range(4):
        expected = np.stack([infos["remaining"], np.full(3, n), *infos["position"].T], axis=1)
        assert np.allclose(observations, expected)
        observations, *_, infos = envs.step(wander(3, n))


def test_a_rule_ends_episodes_and_others_begin(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    found = 0
    for _, _, terminated, truncated, infos in run(tube, 70, num=12, termination=f"{own}:late")[1:]:
        is_far = infos["position"][:, 0] > 10.0
        assert np.array_equal(is_far, infos["outcome"] == "ended")
        assert np.array_equal(terminated, is_far) and not (truncated & is_far).any()
        found += is_far.sum()
    assert found > 0
    envs = BatchedVecEnv(tube, 12, termination=f"{own}:late", max_decisions=90)
    envs.reset()
    ends = [info for n in range(90) for info in envs.step(wander(12, n))[3] if info]
    assert {info["outcome"] for info in ends} == {"ended", "timeout"}
    assert all(not info["TimeLimit.truncated"] for info in ends if info["outcome"] == "ended")


def test_a_disturbance_changes_what_acts_and_what_is_observed(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    still = run(tube, 20, disturbance=f"{own}:Off")
    assert np.allclose(still[0][4]["position"], still[-1][4]["position"])
    plain, plus = run(tube, 20), run(tube, 20, disturbance=f"{own}:Plus")
    assert all(np.array_equal(one[0] + 1.0, more[0]) for one, more in zip(plain, plus, strict=True))


@pytest.mark.parametrize("contacts", ENGINES)
def test_a_law_of_motion_says_where_vehicles_go(tube: Scenario, own_module: WriteModule, contacts: str) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {"motion": f"{own}:glide", "current": (0.2, 0.0, 0.0), "contacts": contacts}
    envs = CaveVectorEnv(3, tube, **options)
    begun = envs.reset(seed=[1, 2, 3], options={"start": [0, 1, 2]})[1]["position"]
    actions = np.array([[1, 1, 2], [1, 1, 1], [0, 1, 2]])
    for _ in range(10):
        infos = envs.step(actions)[4]
    assert np.allclose(infos["position"] - begun, [[0.7, 0.0, 0.0], [0.2, 0.0, 0.0], [0.7, 0.0, 0.1]])  # 1 s


@pytest.mark.parametrize("contacts", ENGINES)
def test_the_wall_stops_a_vehicle_whatever_law_moves_it(tube: Scenario, own_module: WriteModule, contacts: str) -> None:
    own = own_module(CODE)
    envs = CaveVectorEnv(1, tube, motion=f"{own}:glide", contacts=contacts)
    envs.reset(seed=1, options={"start": 0})
    heights, touched = [], []
    for _ in range(400):  # 4 m up, where there are less than 2
        infos = envs.step([[0, 1, 1]])[4]
        heights.append(infos["position"][0, 2])
        touched.append(infos["collision"][0])
    assert touched[-1] and not touched[10]
    assert heights[-1] < np.sqrt(TUBE_RADIUS**2 - 0.5**2)  # it begins half a metre beside the axis
    assert heights[-1] == pytest.approx(heights[-50], abs=0.02)


def test_one_definition_is_for_one_vehicle_and_for_many(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {
        "reward": f"{own}:Beside", "sensors": (f"{own}:Chance", f"{own}:Where"), "termination": f"{own}:late",
        "disturbance": f"{own}:Plus", "motion": f"{own}:glide", "observation_delay": 1, "rays": "field",
    }  # fmt: skip
    many = CaveVectorEnv(3, tube, **options)
    one = gymnasium.make("aquanav/Cave-v0", scenario=tube, contacts="own", **options)
    seen, _ = many.reset(seed=[4, 5, 6])
    alone, info = one.reset(seed=5)
    assert one.observation_space.shape == (51,) and isinstance(info["reward/x"], float)
    outcome = "running"
    while outcome == "running":
        assert np.array_equal(seen[1], alone)
        seen, rewards, *_, infos = many.step(np.tile([1, 1, 2], (3, 1)))
        alone, reward, terminated, truncated, info = one.step([1, 1, 2])
        assert reward == rewards[1] and info["reward/turn"] == infos["reward/turn"][1]
        outcome = info["outcome"]
        assert outcome == infos["outcome"][1] and (terminated or truncated) == (outcome != "running")
    assert outcome == "ended"


def test_an_episode_is_the_same_alone_and_in_any_batch(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {
        "reward": f"{own}:Beside", "sensors": (f"{own}:Chance", f"{own}:Where"), "termination": f"{own}:late",
        "observation_delay": 2, "autoreset_mode": "SameStep", "max_decisions": 12,
    }  # fmt: skip
    seeds: list[int | None] = [11, 2, 5, 900, 11]
    many = CaveVectorEnv(5, tube, **options)
    alone = [CaveVectorEnv(1, tube, **options) for _ in seeds]
    together = many.reset(seed=seeds)[0]
    singles = [env.reset(seed=[seed])[0][0] for env, seed in zip(alone, seeds, strict=True)]
    for n in range(30):
        assert np.array_equal(together, singles)
        actions = np.tile(wander(1, n), (5, 1))
        together, rewards, *_ = many.step(actions)
        steps = [env.step(actions[:1]) for env in alone]
        singles = [step[0][0] for step in steps]
        assert np.array_equal(rewards, [step[1][0] for step in steps])
    assert np.array_equal(together[0], together[4]), "one seed, one episode"


def test_what_a_definition_draws_is_normal_and_its_own(tube: Scenario, own_module: WriteModule) -> None:
    first, second = own_module(CODE), own_module(CODE)
    envs = CaveVectorEnv(2000, tube, sensors=(f"{first}:Chance", f"{second}:Chance"))
    drawn = [envs.reset(seed=3)[0][:, 44:]]
    drawn.append(envs.step(wander(2000, 0))[0][:, 44:])
    values = np.concatenate(drawn, axis=1)  # 16 columns of 2000
    assert np.abs(values.mean(axis=0)).max() < 0.1  # 4.5 standard errors
    assert np.abs(values.std(axis=0) - 1.0).max() < 0.08
    assert np.abs(np.corrcoef(values.T) - np.eye(16)).max() < 0.1


def test_restored_batches_go_on_as_they_would_have(tube: Scenario, own_module: WriteModule) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {"reward": f"{own}:Along", "sensors": (f"{own}:Where",), "observation_delay": 3}
    options["history"] = (2,)
    first, second = (CaveBatch(tube, 4, next_step=False, **options) for _ in range(2))
    first.reset([1, 2, 3, 4])
    for n in range(5):
        first.command(wander(4, n))
        first.step()
    state = first.state()
    second.reset([5, 6, 7, 8])
    second.restore(state)
    for n in range(5, 12):
        for batch in (first, second):
            batch.command(wander(4, n))
            batch.step()
        for name in ("observations", "terms", "rewards"):
            assert np.array_equal(first.view_of(name), second.view_of(name))
