from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.envs.action import choices_of
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate import oracle
from aquanav_tools.evaluate.lookahead import CHOICES, predictor_of
from aquanav_tools.evaluate.oracle import OraclePolicy
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.pursuit import SLOWEST, Pursuit
from aquanav_tools.sim.command import IDLE, Command
from aquanav_tools.sim.vehicle import known_vehicles
from tests.bullet import ENGINES
from tests.caves import TUBE_RADIUS
from tests.evaluate.test_policies import score
from tests.evaluate.winding import RADIUS, winding_scenario
from tests.shipped_caves import shipped_caves

NEAR_ZERO = 0.05
"""Random successes without a collision: 1 in 20."""


@pytest.mark.parametrize("vehicle", [name for name in known_vehicles() if name != "boat"])  # too wide for the tube
def test_prediction_in_still_free_water_is_what_the_environment_does(
    vehicle: str, tube: Scenario, rng: np.random.Generator
) -> None:
    env = CaveEnv(tube, vehicle=vehicle)
    observation, _ = env.reset(options={"start": 0})
    predictor = predictor_of(env, has_map=True)
    for _ in range(8):
        command = CHOICES[rng.integers(len(CHOICES))]
        trims, commands = observation[40:41].astype(np.float64), np.array([[command]])
        states, trims, clearances = predictor.predict(env.state[None], trims, commands, env.water_velocity)
        observation, _, _, _, info = env.step(choices_of(command))
        np.testing.assert_allclose(env.state[:13], states[0, 1, :13], atol=1e-5)  # the trim is observed in float32
        assert observation[40] == pytest.approx(trims[0, 1], abs=1e-6)
        assert info["clearance"] == pytest.approx(clearances[0, 1], abs=1e-5)
    env.close()


@pytest.mark.parametrize("contacts", ENGINES)
@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2-heavy", "original-auv"])
def test_prediction_knows_what_the_episode_drew(
    vehicle: str, contacts: str, tube: Scenario, rng: np.random.Generator
) -> None:
    env, delays = CaveEnv(tube, vehicle=vehicle, contacts=contacts, randomisation="wide", action_delay=1), set()
    for seed in (0, 1, 10):  # the last one acts without delay
        env.reset(seed=seed, options={"start": 0})
        predictor, delay = predictor_of(env, has_map=True, knows_draws=True), env.action_delay
        delays.add(delay)
        pending = [IDLE] * delay
        for _ in range(6):
            pending.append(CHOICES[rng.integers(len(CHOICES))])
            trim = predictor.trim_at(env.ballast_level)
            acting = np.array([[pending.pop(0)]])
            expected = predictor.predict(env.state[None], np.array([trim]), acting, env.water_velocity)
            env.step(choices_of((pending or [Command(*acting[0, 0])])[-1]))
            np.testing.assert_allclose(env.state[:13], expected.states[0, 1, :13], atol=1e-9)
            assert predictor.trim_at(env.ballast_level) == pytest.approx(expected.trims[0, 1], abs=1e-12)
    assert delays == {0, 1}
    env.close()


def test_a_way_is_moved_to_the_middle_of_a_passage_and_left_where_there_is_room(tube: Scenario) -> None:
    middle = np.stack([np.linspace(3.0, 9.0, 61), np.zeros(61), np.zeros(61)], axis=1)
    beside = middle + [0.0, 0.3, -0.2]
    moved = oracle._centred(beside, tube.field, enough=2.0 * TUBE_RADIUS)
    off = np.linalg.norm((moved - middle)[1:-1, 1:], axis=1)
    assert off.max() < tube.field.spacing
    np.testing.assert_array_equal(moved[[0, -1]], beside[[0, -1]])
    np.testing.assert_array_equal(oracle._centred(beside, tube.field, enough=0.5 * TUBE_RADIUS), beside)


def test_what_acting_compiles_is_compiled_before_a_first_action_is_timed(
    tube: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    called = []
    foresee = Pursuit.foresee
    monkeypatch.setattr(Pursuit, "foresee", lambda *given: called.append(len(given)) or foresee(*given))
    env = CaveEnv(tube)
    env.reset(seed=0)
    policy = OraclePolicy()
    policy.bind(env)
    assert called
    env.close()


def test_oracle_waits_for_what_is_still_to_come_through() -> None:
    summary = score(winding_scenario(), "baseline:oracle", 3, action_delay=2)
    assert summary.collision_free_success.rate == 1.0


def test_each_command_is_its_discrete_number() -> None:
    for number, command in enumerate(CHOICES):
        assert choices_of(command) @ (9, 3, 1) == number
    assert choices_of(Command(1.0, 1.0, -1.0)).tolist() == [0, 0, 0]


def test_oracle_finds_a_goal_that_is_out_of_sight_without_a_collision() -> None:
    summary = score(winding_scenario(), "baseline:oracle", 10)
    assert summary.collision_free_success.rate == 1.0


def test_oracle_hurries_where_its_look_ahead_finds_room(monkeypatch: pytest.MonkeyPatch) -> None:
    hurried = score(winding_scenario(), "baseline:oracle", 3)
    monkeypatch.setattr(oracle, "PACES", (SLOWEST,))
    slow = score(winding_scenario(), "baseline:oracle", 3)
    assert hurried.collision_free_success.rate == slow.collision_free_success.rate == 1.0
    assert hurried.means["time"].mean < 0.9 * slow.means["time"].mean


def test_oracle_asks_for_no_more_room_than_a_narrow_place_has(monkeypatch: pytest.MonkeyPatch) -> None:
    env = CaveEnv(winding_scenario())
    env.reset(seed=0, options={"start": 0})
    policy = OraclePolicy()
    monkeypatch.setattr(oracle, "MARGIN", 2.0)
    policy.bind(env)
    policy.reset(0)
    assert policy._margin(5.0) == pytest.approx(oracle.SHARE * (RADIUS - env.vehicle.capsule.radius), abs=0.05)
    env.close()


def test_oracle_goes_on_where_there_is_less_room_than_it_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oracle, "MARGIN", 2.0)  # a passage of 1.1 m leaves 0.93 m beside the hull
    summary = score(winding_scenario(), "baseline:oracle", 2)
    assert summary.success.rate == 1.0


def test_oracle_finds_a_way_that_a_coarse_map_does_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    env = CaveEnv(winding_scenario())
    env.reset(seed=0, options={"start": 0})
    monkeypatch.setattr(oracle, "NUM_NODES", (10,))
    with pytest.raises(InputError, match="No way as wide as the vehicle"):
        OraclePolicy().bind(env)
    monkeypatch.setattr(oracle, "NUM_NODES", (10, 300_000))
    OraclePolicy().bind(env)
    env.close()


def test_oracle_that_has_no_map_says_so() -> None:
    with pytest.raises(InputError, match="call its bind"):
        OraclePolicy().reset(0)


@pytest.mark.parametrize("name", shipped_caves())
@pytest.mark.parametrize("current", [None, "still", "full"])
def test_oracle_dives_through_every_shipped_scenario_without_a_collision(name: str, current: str | None) -> None:
    summary = score(read_scenario(name), "baseline:oracle", 20, max_decisions=2400, current=current)
    assert summary.collision_free_success.rate == 1.0


@pytest.mark.parametrize("name", shipped_caves())
def test_random_stays_near_zero_in_every_shipped_scenario(name: str) -> None:
    # A collision decides already, so the episode may end with it.
    summary = score(read_scenario(name), "baseline:random", 20, max_decisions=2400, on_collision="end")
    assert summary.collision_free_success.rate <= NEAR_ZERO


@pytest.mark.slow
def test_shield_cuts_the_collisions_of_the_random_baseline_in_a_shipped_scenario() -> None:
    scenario = read_scenario("cave-train-1")
    bare, shielded = (score(scenario, spec, 10) for spec in ("baseline:random", "shield:baseline:random"))
    assert shielded.collisions_per_100m.high < 0.5 * bare.collisions_per_100m.low
