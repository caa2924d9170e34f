"""Boats in a batch are the boats of the environment with one, to the bit: held against it, episode by episode."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import aquanav_tools.envs
from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.factory import make_batch
from aquanav_tools.envs.reward import TERMS
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.envs.vector_env import SurfaceVectorEnv
from aquanav_tools.errors import InputError
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.sea_map import Rock
from aquanav_tools.sim.batch.boat_state import AHEAD
from tests.envs.test_surface_env import bay_with, block

SMALL = MapSettings(length=70.0, width=40.0, boat_width=1.1)
SEEDS = [11, 12, 13, 14]
HARD: dict[str, Any] = {"sea": "breeze", "reward": "safe", "current": 0.3, "current_range": (0.5, 1.5)}


def actions_of(rng: np.random.Generator, num: int) -> Any:
    """Return actions that mostly go ahead."""
    return np.stack([rng.integers(0, 3, num), np.minimum(rng.integers(0, 5, num), 2)], axis=1)


def fly_both(bay: Any, decisions: int, rng: np.random.Generator, seeds: list[int], **options: Any) -> list[list[str]]:
    """Fly the same episodes in a batch and one by one, compare all that both tell; return the outcomes of each."""
    batch = BoatBatch(bay, len(seeds), next_step=True, **options)
    envs = [SurfaceEnv(bay, **options) for _ in seeds]
    batch.reset(seeds)
    infos = [env.reset(seed=seed)[1] for env, seed in zip(envs, seeds, strict=True)]
    assert batch.path_lengths == pytest.approx([info["path_length"] for info in infos])
    assert batch.route_lengths == pytest.approx([info["remaining"] for info in infos])
    outcomes = [["running"] * 2 for _ in seeds]
    for _ in range(decisions):
        actions = actions_of(rng, len(seeds))
        batch.command(actions)
        batch.step()
        seen = {name: batch.copy_of(name) for name in (*SAME, *ENDS, "observations", "rewards", "terms")}
        for i, env in enumerate(envs):
            if outcomes[i][0] != "running":
                continue
            observation, reward, terminated, truncated, info = env.step(actions[i])
            assert np.array_equal(seen["observations"][i], observation)
            assert seen["rewards"][i] == reward
            assert seen["terms"][i].tolist() == [info[f"reward/{name}"] for name in TERMS]
            for name, key in SAME.items():
                assert np.array_equal(seen[name][i], info[key]), name
            assert (seen["terminated"][i], seen["truncated"][i]) == (terminated, truncated)
            outcomes[i] = [info["outcome"], OUTCOMES[seen["outcomes"][i]]]
    batch.close()
    return outcomes


SAME = {
    "positions": "position",
    "orientations": "orientation",
    "velocities": "velocity",
    "rays": "rays",
    "clearances": "clearance",
    "collisions": "num_collisions",
    "remaining": "remaining",
}
ENDS = ("terminated", "truncated", "outcomes")


def assert_row(rows: Any, n: int, alone: Any) -> None:
    """What a step returned for boat n of a batch is, to the bit, what it returned for a boat alone."""
    for many, one in zip(rows[:4], alone[:4], strict=True):
        assert np.array_equal(many[n : n + 1], one)
    for key, values in alone[4].items():
        assert np.array_equal(rows[4][key][n : n + 1], values), key


@pytest.mark.parametrize("num", [1, 7, 256])
@pytest.mark.parametrize("place", ["drawn bays", "a rock ahead"])
def test_boat_has_the_episodes_that_it_has_alone(num: int, place: str, rng: np.random.Generator) -> None:
    """To the bit, over several episodes, on two threads and on one, in any order."""
    bay = SMALL if place == "drawn bays" else bay_with(block(-38.8, 3.0, 20.0))
    options: dict[str, Any] = HARD | {"bay": bay, "max_decisions": 12, "sensor_noise": 0.1, "sensor_dropout": 0.1}
    options |= {"action_delay": 1, "observation_delay": 1}
    seeds, chosen = rng.integers(1 << 32, size=num).tolist(), rng.permutation(num)[:3]
    together = SurfaceVectorEnv(num, num_threads=2, **options)
    alone = [SurfaceVectorEnv(1, num_threads=1, **options) for _ in chosen]
    whole = together.reset(seed=seeds)[0]
    for n, env in zip(chosen, alone, strict=True):
        assert np.array_equal(whole[n : n + 1], env.reset(seed=[seeds[n]])[0])
    touched = 0
    for _ in range(30):
        actions = actions_of(rng, num)
        rows = together.step(actions)
        touched += int(rows[4]["collision"].sum())
        for n, env in zip(chosen, alone, strict=True):
            assert_row(rows, n, env.step(actions[n : n + 1]))
            for name in ("rays", "tags", "orientations", "currents", "path_lengths"):
                assert np.array_equal(together.batch.copy_of(name)[n : n + 1], env.batch.copy_of(name)), name
    assert (touched > 0) == (place == "a rock ahead")
    for env in (together, *alone):
        env.close()


# A thousand show it too, in the default tests.
@pytest.mark.parametrize("num", [1024, pytest.param(16384, marks=[pytest.mark.slow, pytest.mark.nightly])])
@pytest.mark.parametrize("threads", [1, 2])
def test_boat_among_thousands_has_the_episodes_that_it_has_alone(
    num: int, threads: int, rng: np.random.Generator
) -> None:
    """To the bit, drawn dynamics and its second episode included, with threads and without."""
    options: dict[str, Any] = HARD | {"bay": bay_with(block(-38.6, 3.0, 20.0)), "max_decisions": 4, "action_delay": 1}
    options |= {"sensor_noise": 0.1, "sensor_dropout": 0.1, "randomisation": "wide"}
    seeds, chosen = rng.integers(1 << 32, size=num).tolist(), [0, num - 1, *rng.permutation(num)[:6].tolist()]
    together = SurfaceVectorEnv(num, num_threads=threads, **options)
    alone = [SurfaceVectorEnv(1, num_threads=1, **options) for _ in chosen]
    whole = together.reset(seed=seeds)[0]
    singles = [env.reset(seed=[seeds[n]])[0][0] for n, env in zip(chosen, alone, strict=True)]
    assert np.array_equal(whole[chosen], singles) and len({row.tobytes() for row in singles}) == len(set(chosen))
    touched = 0
    for _ in range(7):
        actions = actions_of(rng, num)
        rows = together.step(actions)
        touched += int(rows[4]["collision"][chosen].sum())
        for n, env in zip(chosen, alone, strict=True):
            assert_row(rows, n, env.step(actions[n : n + 1]))
    assert touched > 0 and (together.batch.view_of("episodes") == 2).all()
    for env in (together, *alone):
        env.close()


def test_the_order_of_boats_changes_nothing(rng: np.random.Generator) -> None:
    order, seeds, found = rng.permutation(40), np.arange(40), []
    for turn in (np.arange(40), order):
        batch = BoatBatch(SMALL, 40, next_step=False, num_threads=2, max_decisions=9, **HARD)
        batch.reset(seeds[turn].tolist())
        actions = np.stack([np.arange(40) % 3, np.full(40, 2)], axis=1)
        rows = []
        for _ in range(20):
            batch.command(actions[turn])
            batch.step()
            rows.append(np.concatenate([batch.copy_of("positions"), batch.copy_of("terms")], axis=1))
        found.append(np.array(rows))
        batch.close()
    assert np.array_equal(found[0][:, order], found[1])


@pytest.mark.parametrize(("vehicle", "observation"), [("otter", "full"), ("otter", "original"), ("boat", "original")])
@pytest.mark.parametrize("rule", ["continue", "end"])
def test_boats_fly_as_alone(vehicle: str, observation: str, rule: str, rng: np.random.Generator) -> None:
    options = {"vehicle": vehicle, "observation": observation, "on_collision": rule, "max_decisions": 140}
    found = fly_both(SMALL, AHEAD + 20, rng, SEEDS, **options, **HARD)
    assert all(alone == batched != "running" for alone, batched in found)


@pytest.mark.parametrize(
    "errors", [{"sensor_noise": 0.3}, {"sensor_dropout": 0.2}, {"sensor_noise": 0.3, "sensor_dropout": 0.2}]
)
@pytest.mark.parametrize(("action_delay", "observation_delay"), [(0, 2), (3, 0), (1, 1)])
def test_boats_err_and_are_late_as_alone(
    errors: dict[str, float], action_delay: int, observation_delay: int, rng: np.random.Generator
) -> None:
    delays = {"action_delay": action_delay, "observation_delay": observation_delay}
    fly_both(SMALL, 30, rng, SEEDS[:2], **HARD, **errors, **delays)


def test_boats_fly_as_alone_past_a_sunken_rock_that_beams_do_not_see(rng: np.random.Generator) -> None:
    deep = Rock(block(10.0, -3.0).outline, -3.0)
    fly_both(bay_with(deep, block(25.0, 1.0)), 60, rng, SEEDS[:2], observation="paper")


def test_episodes_may_have_conditions_of_their_own(rng: np.random.Generator) -> None:
    """Until the next reset, as `SurfaceEnv.reset` gives them to one."""
    given: list[dict[str, Any]] = [{"sensor_noise": 0.5}, {"current_range": (2.0, 3.0)}, {"sensor_dropout": 0.4}]
    usual = {"sensor_noise": 0.0, "sensor_dropout": 0.0, "current_range": (0.5, 1.5)}
    conditions = {name: [one.get(name, value) for one in given] for name, value in usual.items()}
    together = SurfaceVectorEnv(3, SMALL, max_decisions=5, **HARD)
    envs = [SurfaceEnv(SMALL, max_decisions=5, **HARD) for _ in given]
    seen = [env.reset(seed=seed, options=one)[0] for env, seed, one in zip(envs, SEEDS, given, strict=False)]
    assert np.array_equal(together.reset(seed=SEEDS[:3], options=conditions)[0], seen)
    for _ in range(5):
        actions = actions_of(rng, 3)
        alone = [env.step(action)[0] for env, action in zip(envs, actions, strict=True)]
        assert np.array_equal(together.step(actions)[0], alone)
    together.step(actions)
    assert together.batch.copy_of("noises").tolist() == [0.5, 0.0, 0.0]  # of the next episodes
    together.reset(seed=1)
    assert not together.batch.copy_of("noises").any() and not together.batch.copy_of("dropouts").any()
    together.close()


@pytest.mark.slow
def test_500_episodes_end_as_alone(rng: np.random.Generator) -> None:
    found = fly_both(SMALL, 400, rng, list(range(500)), on_collision="end", max_decisions=400)
    assert np.mean([alone == batched for alone, batched in found]) >= 0.98
    assert len({alone for alone, _ in found}) == 3


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_ended_episodes_are_followed_by_others(mode: AutoresetMode) -> None:
    env = SurfaceVectorEnv(3, SMALL, autoreset_mode=mode, max_decisions=4, sea="still")
    env.reset(seed=0)
    first = env.batch.route_lengths
    for n in range(4):
        last = env.step(np.full((3, 2), [1, 2]))
        assert last[3].all() == (n == 3)
    if mode is AutoresetMode.SAME_STEP:
        assert last[4]["final_info"]["length"].tolist() == [4, 4, 4]
        assert not np.array_equal(np.stack(last[4]["final_obs"]), last[0])
    else:
        observations, rewards, _, truncated, _ = env.step(np.full((3, 2), [1, 2]))
        assert not rewards.any() and not truncated.any()
        assert not observations[:, 9:12].any()  # at rest again
    assert not np.isclose(env.batch.route_lengths, first).any()
    env.close()


def test_a_batch_goes_back_to_where_it_was(rng: np.random.Generator) -> None:
    def batch() -> BoatBatch:
        return BoatBatch(SMALL, 3, next_step=False, max_decisions=AHEAD + 15, on_collision="end", **HARD)

    one, other = batch(), batch()
    one.reset([5, 6, 7])
    for _ in range(AHEAD + 5):
        one.command(actions_of(rng, 3))
        one.step()
    other.restore(one.state())
    for _ in range(20):  # beyond the ends of episodes
        actions = actions_of(rng, 3)
        for each in (one, other):
            each.command(actions)
            each.step()
        for name in ("observations", "rewards", "positions", "currents", "last_outcomes"):
            assert np.array_equal(one.copy_of(name), other.copy_of(name)), name


def test_gymnasium_and_stable_baselines_find_it() -> None:
    assert aquanav_tools.envs.__doc__
    env = gymnasium.make_vec("aquanav/Surface-v0", num_envs=2, vectorization_mode="vector_entry_point", bay=SMALL)
    observations, infos = env.reset(seed=1)
    assert observations in env.observation_space
    assert infos["start_index"].tolist() == [-1, -1]
    batch = BatchedVecEnv("bay-calm", 2, observation="paper")
    assert batch.reset().shape == (2, 9)


def test_each_seed_gives_its_own_bay_and_the_same_one_again() -> None:
    ways = []
    for _ in range(2):
        batch = make_batch("bay-calm", 3, next_step=True)
        batch.reset([7, 8, 9])
        ways.append(batch.path_lengths.tolist())
    assert ways[0] == ways[1]
    assert len(set(ways[0])) == 3


def test_starts_of_a_fixed_bay_are_asked_for(data_dir: Path) -> None:
    batch = BoatBatch(data_dir / "saferlauv" / "surface" / "train.json", 3, next_step=True, vehicle="boat", sea="still")
    batch.reset([0, 1, 2], [2, 0, None])
    assert batch.copy_of("start_indices")[:2].tolist() == [2, 0]


def test_what_no_batch_does_is_refused() -> None:
    with pytest.raises(InputError, match="no measure of progress on the surface 'geodesic'"):
        BoatBatch(SMALL, 2, next_step=True, progress="geodesic")
    with pytest.raises(InputError, match="There is no device 'cuda:7'"):
        BoatBatch(SMALL, 2, next_step=True, device="cuda:7")
    with pytest.raises(InputError, match="num_threads must be at least 1"):
        BoatBatch(SMALL, 2, next_step=True, num_threads=0)
    batch = BoatBatch(SMALL, 2, next_step=True)
    with pytest.raises(InputError, match="choices from 0 to 2, got 0 to 3"):
        batch.command([[0, 3], [1, 1]])
    with pytest.raises(InputError, match="one for each of the 2 vehicles"):
        batch.command([[0, 1, 1], [1, 1, 1]])
