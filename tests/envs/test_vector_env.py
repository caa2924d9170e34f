"""The batched environments: Gymnasium's and SB3's contracts, and parity with PyBullet's."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.reward import TERMS
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from tests.bullet import needs_bullet
from tests.caves import TUBE_RADIUS, tube_scenario
from tests.sim.test_water import flowing

AHEAD = [1, 1, 2]
WIDTH = 2.0 * TUBE_RADIUS


def wander(obs: np.ndarray, rng: np.random.Generator, wildness: float) -> np.ndarray:
    """Return (N, 3) continuous actions: to the goal and away from the nearer side, with (N,) bursts of chance."""
    num = len(obs)
    steer = 3.0 * obs[:, 29] + 1.5 * (obs[:, 8] - obs[:, 7])
    ballast = 2.0 * obs[:, 30] + 0.5 * (obs[:, 23] - obs[:, 18])
    actions = np.stack([ballast, steer, np.full(num, 0.9)], axis=1)
    noise: np.ndarray = actions + wildness * rng.normal(size=(num, 3))
    return np.clip(noise, -1.0, 1.0).astype(np.float32)


def fly_alone(scenario: Scenario, starts: np.ndarray, wildness: float, **options: Any) -> list[dict[str, Any]]:
    """Return the last info of an episode from each start in PyBullet; episode n has its own stream of chance."""
    ends = []
    env = CaveEnv(scenario, action="continuous", contacts="bullet", **options)
    for n, start in enumerate(starts):
        rng = np.random.default_rng([1, n])
        obs, info = env.reset(options={"start": int(start)})
        while info["outcome"] == "running":
            obs, _, _, _, info = env.step(wander(obs[None], rng, wildness)[0])
        ends.append(info)
    env.close()
    return ends


def fly_together(scenario: Scenario, starts: np.ndarray, wildness: float, **options: Any) -> list[str]:
    """Return the outcomes of the same episodes in a batch."""
    num = len(starts)
    env = CaveVectorEnv(num, scenario, action="continuous", autoreset_mode=AutoresetMode.SAME_STEP, **options)
    streams = [np.random.default_rng([1, n]) for n in range(num)]
    obs, _ = env.reset(seed=0, options={"start": starts})
    outcomes = ["running"] * num
    while "running" in outcomes:
        actions = np.concatenate([wander(row[None], rng, wildness) for row, rng in zip(obs, streams, strict=True)])
        obs, _, terminated, truncated, infos = env.step(actions)
        for n in np.flatnonzero(terminated | truncated):
            if outcomes[n] == "running":
                outcomes[n] = str(infos["final_info"]["outcome"][n])
    env.close()
    return outcomes


def share_of_equal_outcomes(num: int, on_collision: str, rays: str) -> float:
    scenario = tube_scenario(limits=LimitSettings(decisions=220))
    starts = np.arange(num) % len(scenario.starts)
    options = {"on_collision": on_collision, "current": (0.0, 0.12, -0.05)}
    alone = [info["outcome"] for info in fly_alone(scenario, starts, 0.9, **options)]
    together = fly_together(scenario, starts, 0.9, rays=rays, **options)
    assert len(set(alone)) > 1, f"all episodes end in {alone[0]}: they say little"
    return float(np.mean([a == b for a, b in zip(alone, together, strict=True)]))


@needs_bullet
@pytest.mark.parametrize(("on_collision", "rays"), [("end", "mesh"), ("continue", "field")])
def test_a_policy_fares_as_in_pybullet(on_collision: str, rays: str) -> None:
    assert share_of_equal_outcomes(25, on_collision, rays) >= 0.96  # one of 25 may differ


@needs_bullet
@pytest.mark.slow
@pytest.mark.parametrize("on_collision", ["end", "continue"])
@pytest.mark.parametrize("rays", ["mesh", "field"])
def test_a_policy_fares_as_in_pybullet_in_98_of_100_episodes(on_collision: str, rays: str) -> None:
    share = share_of_equal_outcomes(500, on_collision, rays)
    print(f"{on_collision}, {rays}: {share:.3f} of 500 episodes end alike")
    assert share >= 0.98


@pytest.mark.parametrize(
    ("vehicle", "delays", "progress"),
    [
        ("bluerov2", (0, 0), "geodesic"),
        ("bluerov2-heavy", (2, 1), "panels"),
        ("original-auv", (1, 3), "original"),
    ],
)
def test_a_free_swim_of_200_decisions_is_pybullets(
    vehicle: str, delays: tuple[int, int], progress: str, tube: Scenario, rng: np.random.Generator
) -> None:
    options: dict[str, Any] = {"vehicle": vehicle, "action": "continuous", "reward": "safe", "current": (0.01, 0, 0)}
    options |= {"action_delay": delays[0], "observation_delay": delays[1], "progress": progress}
    rounding = 1e-4 if progress == "geodesic" else 1e-5  # its map is in float32: 20 m to go are known within 2e-6 m
    alone, together = CaveEnv(tube, **options), CaveVectorEnv(2, tube, rays="mesh", **options)
    seen, _ = alone.reset(options={"start": 1})
    obs, _ = together.reset(options={"start": 1})
    for _ in range(200):
        assert np.abs(obs - seen).max() < 1e-3 / 4.0  # rays within a millimetre, of 2.7 to 3.9 m
        action = wander(seen[None], rng, 0.3)[0] * np.array([0.5, 1.0, 0.4], dtype=np.float32)
        seen, _, _, _, info = alone.step(action)
        obs, rewards, _, _, infos = together.step(np.tile(action, (2, 1)))
        assert not info["collision"]
        assert np.abs(infos["position"] - info["position"]).max() < 1e-4 * WIDTH
        for name in TERMS:
            assert np.abs(infos[f"reward/{name}"] - info[f"reward/{name}"]).max() < rounding
        assert rewards[0] == pytest.approx(sum(info[f"reward/{name}"] for name in TERMS), abs=rounding)
        assert infos["clearance"][0] == pytest.approx(info["clearance"], abs=1e-5)
    alone.close()
    together.close()


def test_make_vec_gives_the_batch_with_batched_spaces(tube: Scenario) -> None:
    env = gymnasium.make_vec(
        "aquanav/Cave-v0", num_envs=8, vectorization_mode="vector_entry_point", scenario=tube, observation="paper"
    )
    assert isinstance(env.unwrapped, CaveVectorEnv)
    obs, infos = env.reset(seed=1)
    assert env.observation_space.contains(obs)
    assert obs.shape == (8, 31)
    assert {"clearance", "outcome", "reward/progress"} <= infos.keys()
    obs, rewards, terminated, truncated, _ = env.step(env.action_space.sample())
    assert env.observation_space.contains(obs)
    assert rewards.shape == terminated.shape == truncated.shape == (8,)
    env.close()


@pytest.mark.parametrize("action", ["multidiscrete", "discrete", "continuous"])
def test_each_form_of_action_means_what_it_means_alone(action: str, tube: Scenario) -> None:
    alone, together = CaveEnv(tube, action=action), CaveVectorEnv(4, tube, action=action, rays="mesh")
    alone.action_space.seed(3)
    seen, _ = alone.reset(options={"start": 0})
    together.reset(options={"start": 0})
    for _ in range(5):
        chosen = alone.action_space.sample()
        seen, _, _, _, _ = alone.step(chosen)
        obs, _, _, _, _ = together.step(np.stack([chosen] * 4))
    assert np.abs(obs - seen).max() < 1e-5
    alone.close()


def ends_of(mode: AutoresetMode) -> tuple[CaveVectorEnv, int]:
    """Return a batch of two whose first vehicle, much nearer the goal, has just ended, and after how many steps."""
    env = CaveVectorEnv(2, tube_scenario(), autoreset_mode=mode, observation="paper")
    env.reset(seed=0, options={"start": [18, 0]})
    for steps in range(1, 400):
        _, _, terminated, _, _ = env.step([AHEAD, AHEAD])
        if terminated[0]:
            return env, steps
    raise AssertionError("nobody reached the goal")


def test_next_step_mode_shows_the_last_observation_then_begins_anew() -> None:
    env, _ = ends_of(AutoresetMode.NEXT_STEP)
    assert env._infos()["outcome"].tolist() == ["success", "running"]
    assert env._infos()["remaining"][0] <= 0.5
    _, rewards, terminated, _, infos = env.step([AHEAD, AHEAD])
    assert rewards[0] == 0.0
    assert not terminated[0]
    assert infos["outcome"].tolist() == ["running", "running"]
    start = env.batch.scenarios[0].starts[infos["start_index"][0]].pose.position
    assert np.array_equal(infos["position"][0], start)
    assert rewards[1] != 0.0


def test_same_step_mode_begins_anew_and_keeps_the_end() -> None:
    kept, steps = ends_of(AutoresetMode.NEXT_STEP)
    last = kept.batch.copy_of("observations")[0]
    env = CaveVectorEnv(2, tube_scenario(), autoreset_mode=AutoresetMode.SAME_STEP, observation="paper")
    env.reset(seed=0, options={"start": [18, 0]})
    for _ in range(steps):
        obs, rewards, terminated, _, infos = env.step([AHEAD, AHEAD])
    assert terminated.tolist() == [True, False]
    assert rewards[0] > 40.0  # the goal's 50 less what time has cost
    assert np.array_equal(infos["final_obs"][0], last)
    assert infos["final_obs"][1] is None
    assert infos["final_info"]["outcome"][0] == "success"
    assert infos["final_info"]["length"][0] == steps
    assert infos["outcome"].tolist() == ["running", "running"]
    start = env.batch.scenarios[0].starts[infos["start_index"][0]].pose.position
    assert np.array_equal(infos["position"][0], start)
    assert not np.array_equal(obs[0], last)


def test_stable_baselines_learns_from_a_batch_and_is_told_of_ends() -> None:
    from stable_baselines3 import PPO

    scenario = tube_scenario(limits=LimitSettings(decisions=40))
    env = BatchedVecEnv(scenario, 32, observation="paper", reward="safe")
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=512, n_epochs=1, device="cpu", seed=0).learn(4096)
    assert len(model.ep_info_buffer or []) >= 32
    env.reset()
    for _ in range(40):
        _, _, dones, infos = env.step(np.tile([1, 1, 1], (32, 1)))
    assert dones.all()
    for n in (0, 31):
        assert infos[n]["TimeLimit.truncated"] is True
        assert infos[n]["outcome"] == "timeout"
        assert infos[n]["episode"]["l"] == 40
        assert infos[n]["terminal_observation"].shape == (31,)
    env.close()


def test_the_same_seed_gives_the_same_episodes(tube: Scenario) -> None:
    env = CaveVectorEnv(16, tube)
    runs = []
    for seed in (5, 5, 6):
        first, _ = env.reset(seed=seed)
        runs.append(np.stack([first] + [env.step(np.tile(AHEAD, (16, 1)))[0] for _ in range(20)]))
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


@pytest.mark.parametrize(
    ("num", "observation"), [(1, "full"), (7, "full"), (1024, "full"), (16384, "full"), (7, "original")]
)
def test_vehicle_has_the_episodes_that_it_has_alone(num: int, observation: str, rng: np.random.Generator) -> None:
    """To the bit, over several episodes and through contacts: all that is drawn comes from its seed alone."""
    seeds, chosen = rng.integers(1 << 32, size=num).tolist(), rng.permutation(num)[:3]
    options: dict[str, Any] = {"current": "full", "current_range": (0.2, 1.0), "max_decisions": 9}
    options |= {"sensor_noise": 0.1, "sensor_dropout": 0.1, "action_delay": 2, "observation_delay": 1}
    options |= {"progress": "original", "observation": observation}
    together = CaveVectorEnv(num, flowing(), num_threads=2, **options)
    alone = [CaveEnv(flowing(), contacts="own", rays="field", **options) for _ in chosen]
    seen = together.reset(seed=seeds)[0][chosen]
    for row, env, n in zip(seen, alone, chosen, strict=True):
        np.testing.assert_array_equal(env.reset(seed=seeds[n])[0], row)
    for _ in range(25):
        actions = rng.integers(0, 3, (num, 3))
        actions[:, 2] = np.maximum(actions[:, 2], 1)
        *rows, infos = together.step(actions)
        for env, n in zip(alone, chosen, strict=True):
            *own, info = env.step(actions[n])  # beyond an end, the next episode begins
            for whole, part in zip(rows, own, strict=True):
                np.testing.assert_array_equal(whole[n], part)
            assert all(np.array_equal(infos[key][n], info[key]) for key in infos.keys() & info.keys())
    for env in (together, *alone):
        env.close()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_episodes_begin_anywhere_as_they_do_alone(mode: AutoresetMode, tube: Scenario) -> None:
    """Level, apart from the wall, in no two places twice; and to the bit beside others as alone."""
    options: dict[str, Any] = {"starts": "anywhere", "max_decisions": 4, "autoreset_mode": mode}
    seeds, seen = [9, 1, 5], {}
    for name, chosen in (("together", seeds), ("alone", seeds[2:])):
        env = CaveVectorEnv(len(chosen), tube, **options)
        _, infos = env.reset(seed=chosen)
        rows = [infos]
        rows += [env.step(np.tile(AHEAD, (len(chosen), 1)))[4] for _ in range(16)]
        seen[name] = np.array([row["position"][-1] for row in rows])
        if name == "together":
            starts = np.concatenate([row["position"] for row in rows if not row["reward/time"].any()])
            radius = CaveEnv(tube).vehicle.capsule.radius
            assert (np.hypot(starts[:, 1], starts[:, 2]) < TUBE_RADIUS - radius - 0.05).all()
            assert len(np.unique(starts.round(6), axis=0)) == len(starts) >= (3 * 4 if mode.value == "NextStep" else 3)
            assert (infos["start_index"] == -1).all()
            first = CaveEnv(tube, starts="anywhere").reset(seed=seeds[0])[1]
            np.testing.assert_array_equal(rows[0]["position"][0], first["position"])
            ways = env.batch.path_lengths
            assert len(set(ways)) == 3 and (ways > 2.0).all()
        env.close()
    np.testing.assert_array_equal(seen["together"], seen["alone"])


def test_start_by_number_is_kept_where_others_are_anywhere(tube: Scenario) -> None:
    env = CaveVectorEnv(3, tube, starts="anywhere")
    assert env.reset(seed=0, options={"start": 1})[1]["start_index"].tolist() == [1, 1, 1]
    assert env.batch.path_lengths == pytest.approx([tube.starts[1].geodesic_to_goal] * 3)
    env.close()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_late_observations_begin_anew_with_each_episode(mode: AutoresetMode, tube: Scenario) -> None:
    """Beside the same episodes without delay: each observation comes two decisions later, none in the next episode."""
    ends: dict[int, list[np.ndarray]] = {}
    for delay in (0, 2):
        env = CaveVectorEnv(2, tube, max_decisions=5, observation_delay=delay, autoreset_mode=mode)
        seen = [env.reset(seed=[3, 4])[0].copy()]
        for _ in range(12):
            obs, _, _, truncated, infos = env.step(np.tile(AHEAD, (2, 1)))
            if truncated.any() and mode is AutoresetMode.SAME_STEP:
                seen.append(np.stack(list(infos["final_obs"])))
            seen.append(obs.copy())
        ends[delay] = seen
        env.close()
    now, late = (np.array(ends[delay])[:12].reshape(2, 6, 2, -1) for delay in (0, 2))
    np.testing.assert_array_equal(late[:, 2:], now[:, :4])
    np.testing.assert_array_equal(late[:, 0], now[:, 0])
    np.testing.assert_array_equal(late[:, 1], now[:, 0])
    assert not np.array_equal(now[:, 1], now[:, 0])


def test_proximity_is_paid_by_true_distances(tube: Scenario) -> None:
    """Errors of the sensor change what is seen, and nothing that is paid."""
    terms = []
    for noise in (0.0, 0.5):
        env = CaveVectorEnv(3, tube, reward="safe", sensor_noise=noise)
        obs, _ = env.reset(seed=[3, 4, 5])
        infos = [env.step(np.tile(AHEAD, (3, 1)))[4] for _ in range(5)]
        terms.append((obs, np.array([info["reward/proximity"] for info in infos])))
        env.close()
    (exact, paid), (disturbed, also_paid) = terms
    np.testing.assert_array_equal(paid, also_paid)
    assert (np.abs(exact - disturbed)[:, :28] > 0.01).any() and np.array_equal(exact[:, 28:], disturbed[:, 28:])


def test_vehicles_of_several_caves_swim_as_in_a_batch_of_each(tube: Scenario) -> None:
    """Made by Gymnasium, in each autoreset mode; one thread or four, the result is the same."""
    caves = [tube, tube_scenario(limits=LimitSettings(decisions=15)), tube]
    joint = {"num_envs": 8, "vectorization_mode": "vector_entry_point", "scenario": caves, "action": "continuous"}
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
        batches: list[Any] = [
            gymnasium.make_vec("aquanav/Cave-v0", **joint, num_threads=n, autoreset_mode=mode) for n in (1, 4)
        ]
        shares = batches[0].batch.slices
        assert [part.stop - part.start for part in shares] == [3, 2, 3]
        alone = [
            CaveVectorEnv(part.stop - part.start, cave, action="continuous", autoreset_mode=mode)
            for cave, part in zip(caves, shares, strict=True)
        ]
        parts = [env.reset(seed=9 + part.start) for env, part in zip(alone, shares, strict=True)]
        for batch in batches:
            assert np.array_equal(batch.reset(seed=9)[0], np.concatenate([part[0] for part in parts]))
        rng = np.random.default_rng(0)
        for _ in range(20):
            actions = rng.uniform(-1.0, 1.0, (8, 3)).astype(np.float32)
            expected = [env.step(actions[part]) for env, part in zip(alone, shares, strict=True)]
            for found in (batch.step(actions) for batch in batches):
                for n in range(4):
                    assert np.array_equal(found[n], np.concatenate([one[n] for one in expected]))
                for name in expected[0][4].keys() - {"final_obs", "_final_obs", "final_info", "_final_info"}:
                    assert np.array_equal(found[4][name], np.concatenate([one[4][name] for one in expected])), name
        for env in (*batches, *alone):
            env.close()


def test_several_caves_are_refused_where_they_do_not_fit(tube: Scenario) -> None:
    with pytest.raises(InputError, match="3 scenarios need at least as many vehicles, got 2"):
        CaveVectorEnv(2, [tube, tube, tube])
    with pytest.raises(InputError, match="A batch needs a scenario"):
        BatchedVecEnv([], 2)
    with pytest.raises(InputError, match="tube is a cave and bay-calm a bay: they do not go into one batch"):
        BatchedVecEnv([tube, "bay-calm"], 2, observation="paper")
    env = CaveVectorEnv(4, [tube, tube])
    env.reset(seed=0)
    with pytest.raises(InputError, match="one for each of the 4 vehicles"):
        env.step(np.tile(AHEAD, (3, 1)))
    env.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"observation": "orginal"}, "no observation preset 'orginal'. Did you mean 'original'"),
        ({"contacts": "bulet"}, "no solver of contacts 'bulet'. Did you mean 'bullet'"),
        ({"contacts": "bullet", "device": "cuda"}, "solved on the processor, not on cuda"),
        ({"progress": "geodesi"}, "no measure of progress 'geodesi'. Did you mean 'geodesic'"),
        ({"rays": "bvh"}, "no source of rays 'bvh'"),
        ({"reward": "dens"}, "Did you mean 'dense'"),
        ({"autoreset_mode": AutoresetMode.DISABLED}, "Choose NEXT_STEP or SAME_STEP"),
        ({"num_threads": 0}, "num_threads must be at least 1, got 0"),
    ],
)
def test_unknown_options_are_refused(options: dict[str, Any], message: str, tube: Scenario) -> None:
    with pytest.raises(InputError, match=message):
        CaveVectorEnv(2, tube, **options)


def test_senseless_actions_and_starts_are_refused(tube: Scenario) -> None:
    env = CaveVectorEnv(2, tube)
    env.reset(seed=0)
    with pytest.raises(InputError, match="choices from 0 to 2, got 0 to 3"):
        env.step([[0, 1, 3], AHEAD])
    with pytest.raises(InputError, match="one for each of the 2 vehicles"):
        env.step([AHEAD])
    with pytest.raises(InputError, match="must be a number from 0 to 19, got 20"):
        env.reset(options={"start": 20})
    with pytest.raises(InputError, match="no option 'begin'"):
        env.reset(options={"begin": 1})
    with pytest.raises(InputError, match="as many seeds, or one; got 3"):
        env.reset(seed=[1, 2, 3])
