"""The user's own reward, sensors, observation, rule and disturbance with boats, held against what infos tell."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import aquanav_tools.envs  # noqa: F401  # registers the environments
from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.factory import make_batch
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.envs.vector_env import SurfaceVectorEnv
from aquanav_tools.errors import InputError, OwnCodeError
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.boat import Boat
from tests.envs.test_surface_env import AHEAD, IDLE, bay_with, block
from tests.own_modules import WriteModule, own_module

__all__ = ["own_module"]

SMALL = MapSettings(length=70.0, width=40.0, boat_width=1.1)
CODE = """
class Careful:
    def terms(self, batch):
        outcomes, none = batch.outcomes, np.zeros(batch.num)
        return {
            "way": 10.0 * batch.gained,
            "steps": -0.01 * 5.0 * (batch.decisions > 0),
            "touching": -1.0 * batch.touched,
            "nearness": none,
            "arrived": 50.0 * (outcomes == "success"),
            "crashed": -100.0 * (outcomes == "collision"),
            "late": none,
        }

class Turns:
    base = "safe"

    def terms(self, batch):
        changed = np.abs(batch.commands - batch.last_commands).sum(axis=1)
        return {"changed": -0.05 * changed, "near": -0.1 * np.exp(-batch.clearances)}

class Where:
    def spec(self, scenario, vehicle):
        assert type(scenario).__name__ in ("SeaMap", "MapSettings") and vehicle.name == "otter"
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
        assert batch.observations.shape[1] == 9
        return np.stack([batch.remaining, batch.decisions], axis=1)

def far(batch):
    return batch.positions[:, 0] > -30.0

class Off:
    def actions(self, batch, commands):
        return 0.0 * commands

class Plus:
    def observations(self, batch, observations):
        return observations + 1.0

class Odd(Turns):
    def terms(self, batch):
        if ((batch.seeds == 8) & (batch.decisions > 3)).any():
            raise RuntimeError("odd")
        return super().terms(batch)
"""


def steers(num: int, decision: int) -> Any:
    """Return (N, 2) actions, another for each boat and decision."""
    return np.stack([[(n + decision // 7) % 3, 2 if n % 3 else 1] for n in range(num)])


@pytest.mark.parametrize("num", [1, 7])
@pytest.mark.parametrize("place", ["drawn bays", "a rock ahead"])
def test_a_reward_that_restates_careful_pays_the_same_to_the_bit(num: int, place: str, own_module: WriteModule) -> None:
    bay: Any = SMALL if place == "drawn bays" else bay_with(block(-38.6, 3.0, 20.0))
    own = own_module(CODE)
    options: dict[str, Any] = {"sea": "breeze", "max_decisions": 25, "autoreset_mode": "SameStep"}
    envs = [SurfaceVectorEnv(num, bay, reward=name, **options) for name in ("careful", f"{own}:Careful")]
    for env in envs:
        env.reset(seed=3)
    touched, ended = 0, 0
    for n in range(60):
        plain, restated = (env.step(steers(num, n + 1)) for env in envs)
        assert all(np.array_equal(plain[part], restated[part]) for part in (0, 1, 2, 3))  # type: ignore[arg-type]
        names = ("way", "progress"), ("steps", "time"), ("touching", "contact"), ("arrived", "goal")
        for mine, theirs in names:
            assert np.array_equal(restated[4][f"reward/{mine}"], plain[4][f"reward/{theirs}"])
        touched, ended = touched + plain[4]["collision"].sum(), ended + plain[3].sum()
        if "final_info" in plain[4]:
            assert np.array_equal(plain[4]["final_info"]["return"], restated[4]["final_info"]["return"])
    assert ended == 2 * num and (touched > 0) == (place == "a rock ahead")
    assert "reward/progress" not in restated[4]


@pytest.mark.parametrize("num", [1, 7])
def test_one_definition_is_for_one_boat_and_for_many(num: int, own_module: WriteModule) -> None:
    """To the bit, until a rule ends the episode."""
    own = own_module(CODE)
    options: dict[str, Any] = {
        "reward": f"{own}:Turns", "sensors": (f"{own}:Chance", f"{own}:Where"), "termination": f"{own}:far",
        "disturbance": f"{own}:Plus", "observation_delay": 1, "action_delay": 1, "sensor_noise": 0.1, "sea": "breeze",
        "bay": bay_with(block(-5.0, 3.0, 25.0)),
    }  # fmt: skip
    many = SurfaceVectorEnv(num, **options)
    one = gymnasium.make("aquanav/Surface-v0", disable_env_checker=True, **options)  # "Plus" leaves the space
    seeds: list[int | None] = list(range(4, 4 + num))
    row = num // 2
    seen, _ = many.reset(seed=seeds)
    alone, info = one.reset(seed=seeds[row])
    assert one.observation_space.shape == (16 + 4 + 3,) and isinstance(info["reward/changed"], float)
    outcome, count = "running", 0
    while outcome == "running":
        assert np.array_equal(seen[row], alone)
        actions = np.tile([(1, 0, 2)[count % 3], 2], (num, 1))
        seen, rewards, *_, infos = many.step(actions)
        alone, reward, terminated, truncated, info = one.step(actions[0])
        assert reward == rewards[row]
        for name in ("reward/changed", "reward/near", "reward/proximity"):
            assert info[name] == infos[name][row], name
        outcome, count = info["outcome"], count + 1
        assert outcome == infos["outcome"][row] and (terminated or truncated) == (outcome != "running")
    assert outcome == "ended" and terminated and count > 10


def test_an_episode_is_the_same_alone_and_in_any_batch(own_module: WriteModule) -> None:
    """The ones that follow in the same step as well."""
    own = own_module(CODE)
    options: dict[str, Any] = {
        "reward": f"{own}:Turns", "sensors": (f"{own}:Chance", f"{own}:Where"), "observation_delay": 2,
        "autoreset_mode": "SameStep", "max_decisions": 12, "bay": SMALL, "sea": "calm",
    }  # fmt: skip
    seeds: list[int | None] = [11, 2, 5, 900, 11]
    many, alone = SurfaceVectorEnv(5, **options), [SurfaceVectorEnv(1, **options) for _ in seeds]
    together = many.reset(seed=seeds)[0]
    singles = [env.reset(seed=[seed])[0][0] for env, seed in zip(alone, seeds, strict=True)]
    for n in range(30):
        assert np.array_equal(together, singles)
        actions = np.tile(steers(1, n), (5, 1))
        together, rewards, *_, infos = many.step(actions)
        steps = [env.step(actions[:1]) for env in alone]
        singles = [step[0][0] for step in steps]
        assert np.array_equal(rewards, [step[1][0] for step in steps])
        if "final_obs" in infos:
            finals = [step[4]["final_obs"][0] for step in steps]
            assert np.array_equal(np.stack(infos["final_obs"]), finals)
            assert np.allclose(finals[0][:2], finals[4][:2]) and not np.allclose(finals[0][-3:], together[0][-3:])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_sensor_measures_where_the_boat_is(mode: str, own_module: WriteModule) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {"bay": SMALL, "sea": "breeze", "max_decisions": 9, "autoreset_mode": mode}
    more, plain = SurfaceVectorEnv(3, sensors=(f"{own}:Where",), **options), SurfaceVectorEnv(3, **options)
    seen: tuple[Any, ...] = more.reset(seed=7)
    without: tuple[Any, ...] = plain.reset(seed=7)
    assert np.array_equal(seen[0][:, :16], without[0]) and np.allclose(seen[0][:, 16:], seen[1]["position"])
    for n in range(30):
        before = seen
        seen, without = more.step(steers(3, n)), plain.step(steers(3, n))
        assert np.array_equal(seen[0][:, :16], without[0])
        assert np.allclose(seen[0][:, 16:], seen[4]["position"])
        if "final_obs" in seen[4]:
            ends = np.stack(seen[4]["final_obs"])
            assert np.allclose(ends[:, 16:], before[0][:, 16:], atol=0.6), "a decision further"
            assert not np.allclose(ends[:, 16:18], seen[4]["position"][:, :2], atol=0.6), "of the end"


def test_a_dictionary_of_parts_takes_ones_own_by_name(own_module: WriteModule) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {"bay": SMALL, "sea": "calm", "max_decisions": 9, "autoreset_mode": "SameStep"}
    parts = {"seen": "paper", "where": f"{own}:Where"}
    prompt, late = (SurfaceVectorEnv(3, observation=parts, observation_delay=delay, **options) for delay in (0, 2))
    one = SurfaceEnv(SMALL, observation=parts, sea="calm")
    assert one.observation_space.contains(one.reset(seed=1)[0])
    rows: list[Any] = [prompt.reset(seed=5)[0]]
    waited: Any = late.reset(seed=5)[0]
    assert {name: part.shape for name, part in waited.items()} == {"seen": (3, 9), "where": (3, 3)}
    for n in range(8):
        rows.append((told := prompt.step(steers(3, n)))[0])
        infos = told[4]
        assert np.allclose(rows[-1]["where"], infos["position"])
        waited = late.step(steers(3, n))[0]
        for name in parts:
            assert np.array_equal(waited[name], rows[max(n - 1, 0)][name])


def test_an_observation_stands_for_the_preset(own_module: WriteModule) -> None:
    own = own_module(CODE)
    envs = SurfaceVectorEnv(3, SMALL, observation=f"{own}:Own", sensors=(f"{own}:Where",))
    observations, infos = envs.reset(seed=1)
    assert observations.shape == (3, 5) and envs.single_observation_space.contains(observations[0])
    for n in range(4):
        expected = np.stack([infos["remaining"], np.full(3, n), *infos["position"].T], axis=1)
        assert np.allclose(observations, expected)
        observations, *_, infos = envs.step(steers(3, n))


def test_a_rule_ends_episodes_and_others_begin(own_module: WriteModule) -> None:
    own = own_module(CODE)
    envs = SurfaceVectorEnv(5, bay_with(), sea="breeze", termination=f"{own}:far")
    envs.reset(seed=2)
    found, was_far = 0, np.zeros(5, dtype=bool)
    for _ in range(200):
        _, rewards, terminated, truncated, infos = envs.step(np.tile(AHEAD, (5, 1)))
        is_far = infos["position"][:, 0] > -30.0
        assert np.array_equal(is_far, infos["outcome"] == "ended")
        assert np.array_equal(terminated, is_far) and not truncated.any()
        assert not rewards[was_far].any() and np.allclose(infos["position"][was_far, :2], [-40.0, 0.0])
        found, was_far = found + is_far.sum(), is_far
    assert found > 10
    ends = BatchedVecEnv("bay-calm", 3, termination=f"{own}:far", max_decisions=30)
    ends.reset()
    told = [info for n in range(60) for info in ends.step(np.tile(IDLE, (3, 1)))[3] if info]
    assert {info["outcome"] for info in told} <= {"ended", "timeout"} and told


def test_a_rule_and_a_reward_count_from_an_episodes_first_decision_to_its_last(own_module: WriteModule) -> None:
    """In the step that begins the next one nothing ends or is paid, nor after the end where none follows."""
    own = own_module("def always(batch):\n    return batch.decisions >= 0\n" + CODE)
    envs = SurfaceVectorEnv(3, bay_with(), termination=f"{own}:always", reward=f"{own}:Turns")
    envs.reset(seed=1)
    rows = [envs.step(np.tile(AHEAD, (3, 1))) for _ in range(6)]
    assert [row[2].tolist() for row in rows] == [[True] * 3, [False] * 3] * 3
    assert all((row[1] == 0.0).all() == (n % 2 == 1) for n, row in enumerate(rows))
    env = SurfaceEnv(bay_with(), termination=f"{own}:always", reward=f"{own}:Turns")
    env.reset(seed=1)
    first, *others = [env.step(AHEAD) for _ in range(3)]
    assert first[2] and first[1] != 0.0
    assert all(not other[2] and other[1] == 0.0 and other[4]["outcome"] == "ended" for other in others)


def test_bays_in_one_batch_have_ones_own_reward_and_dynamics_of_their_own(own_module: WriteModule) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {"reward": f"{own}:Turns", "randomisation": "mild"}
    joint = make_batch(["bay-calm", "bay-breeze"], 5, next_step=True, **options)
    alone = make_batch("bay-breeze", 3, next_step=True, **options)
    for batch, seeds in ((joint, [1, 2, 3, 4, 5]), (alone, [3, 4, 5])):
        batch.reset(seeds)
        for n in range(5):
            batch.command(np.tile(steers(3, n)[1], (batch.num, 1)))
            batch.step()
    part = slice(5 - alone.num, 5)
    for name in ("rewards", "terms", "positions"):
        assert np.array_equal(joint.copy_of(name)[part], alone.copy_of(name))
    assert joint.term_names[-2:] == ("changed", "near") and len(joint.dynamics["mass"]) == 5
    assert np.array_equal(joint.dynamics["mass"][part], alone.dynamics["mass"])


def test_a_disturbance_changes_what_acts_and_what_is_observed(own_module: WriteModule) -> None:
    own = own_module(CODE)
    still, plain, plus = (
        SurfaceVectorEnv(2, bay_with(), sea="still", disturbance=name)
        for name in (f"{own}:Off", None, f"{own}:Plus")
    )  # fmt: skip
    begun, *others = [env.reset(seed=1) for env in (still, plain, plus)]
    assert np.array_equal(others[0][0] + 1.0, others[1][0])
    for _ in range(10):
        idle = still.step(np.tile(AHEAD, (2, 1)))
        seen, more = plain.step(np.tile(AHEAD, (2, 1))), plus.step(np.tile(AHEAD, (2, 1)))
        assert np.array_equal(seen[0] + 1.0, more[0])
    assert np.allclose(begun[1]["position"], idle[4]["position"], atol=1e-6)
    assert np.abs(seen[4]["position"] - others[0][1]["position"]).max() > 0.5


def test_code_that_fails_fails_for_its_boat_alone(own_module: WriteModule) -> None:
    own = own_module(CODE)
    batch, plain = (BoatBatch(SMALL, 3, next_step=True, reward=f"{own}:{name}") for name in ("Odd", "Turns"))
    for each in (batch, plain):
        each.reset([7, 8, 9])
    for n in range(8):
        for each in (batch, plain):
            each.command(steers(3, n))
            each.step()
        assert list(batch.failures) == ([1] if n >= 3 else [])
        assert np.array_equal(batch.copy_of("rewards")[[0, 2]], plain.copy_of("rewards")[[0, 2]])
        assert np.array_equal(batch.copy_of("positions"), plain.copy_of("positions"))
    assert "raised RuntimeError: odd" in batch.failures[1] and "after 8 decisions of the episode" in batch.failures[1]
    env = SurfaceEnv(SMALL, reward=f"{own}:Odd")
    env.reset(seed=8)
    with pytest.raises(OwnCodeError, match=rf"The reward {own}:Odd raised RuntimeError: odd .*after 4 decisions"):
        for _ in range(4):
            env.step(AHEAD)
    assert env.info["outcome"] == "running"


def test_a_batch_with_ones_own_goes_back_to_where_it_was(own_module: WriteModule) -> None:
    own = own_module(CODE)
    options: dict[str, Any] = {
        "reward": f"{own}:Turns", "sensors": (f"{own}:Chance",), "observation_delay": 2, "max_decisions": 9,
    }  # fmt: skip
    one, other = (BoatBatch(SMALL, 3, next_step=False, **options) for _ in range(2))
    one.reset([5, 6, 7])
    for n in range(13):  # in the second episodes
        one.command(steers(3, n))
        one.step()
    other.restore(one.state())
    for n in range(12):
        for each in (one, other):
            each.command(steers(3, n))
            each.step()
        for name in ("observations", "rewards", "terms", "seeds", "path_lengths", "last_commands"):
            assert np.array_equal(one.copy_of(name), other.copy_of(name)), name


def test_what_has_no_meaning_for_boats_is_refused(own_module: WriteModule) -> None:
    own = own_module("")
    named: list[dict[str, Any]] = [{"sensors": ("sonar",)}, {"observation": {"a": "sonar"}}]
    for options in named:
        with pytest.raises(InputError, match="The sensor sonar measures in caves"):
            SurfaceVectorEnv(2, **options)
    with pytest.raises(InputError, match=r"There is no sensor 'sonr'\. Did you mean 'sonar'"):
        SurfaceEnv(sensors=("sonr",))
    with pytest.raises(InputError, match=r"The module own_\d+ has no Nothing"):
        SurfaceEnv(reward=f"{own}:Nothing")


def test_a_sensor_is_told_the_bay_and_the_boat(own_module: WriteModule) -> None:
    own = own_module("""
asked = []

class Ask:
    def spec(self, scenario, vehicle):
        asked.append((scenario, vehicle))
        return Box(0, 1, (1,))

    def measure(self, batch):
        return np.zeros((batch.num, 1))
""")
    import sys

    SurfaceEnv(bay_with(), sensors=(f"{own}:Ask",))
    SurfaceEnv(SMALL, sensors=(f"{own}:Ask",))
    asked = sys.modules[own].asked
    assert [type(scenario) for scenario, _ in asked] == [SeaMap, MapSettings]
    assert all(isinstance(vehicle, Boat) for _, vehicle in asked)
