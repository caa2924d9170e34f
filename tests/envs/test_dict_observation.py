"""Observations of several parts: the same readings in the environments of one vehicle and of many."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors.fan import RangeFan
from tests.caves import tube_scenario

TUBE = tube_scenario()
SONAR = {"num_beams": 8, "num_bins": 16, "num_sub_rays": 4}


def parts() -> dict[str, Any]:
    """Return a preset and every sensor, each new."""
    from aquanav_tools.sim.batch.sensors.sonar import ImagingSonar

    return {
        "base": "full", "rays": "fan", "depth": "depth", "imu": "imu", "dvl": "dvl", "sonar": ImagingSonar(SONAR),
    }  # fmt: skip


def own_env(**options: Any) -> CaveEnv:
    """Return one vehicle with the contacts and rays of the batch."""
    return CaveEnv(TUBE, **{"observation": parts(), "contacts": "own", "rays": "field", **options})


def same(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> bool:
    """Return whether two observations are the same to the bit."""
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)


def test_the_environment_of_one_vehicle_keeps_gymnasiums_contract() -> None:
    env = own_env(max_decisions=20)
    assert isinstance(env.observation_space, spaces.Dict)
    check_env(env, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("num_threads", [1, 2])
def test_a_vehicle_sees_alone_what_it_sees_among_many(num_threads: int, rng: np.random.Generator) -> None:
    """600 vehicles, so that two threads share them; collisions end episodes, and others follow."""
    num, watched, decisions = 600, 301, 60
    options = {"on_collision": "end", "action": "continuous", "sensor_noise": 0.05}
    many = CaveVectorEnv(num, TUBE, observation=parts(), num_threads=num_threads, **options)
    one = own_env(**options)
    seen, _ = many.reset(seed=7)
    alone, _ = one.reset(seed=7 + watched)
    for _ in range(decisions):
        assert same({name: values[watched] for name, values in seen.items()}, alone)
        actions = rng.uniform(-1, 1, (num, 3)).astype(np.float32)
        actions[:, 2] = 1.0
        seen = many.step(actions)[0]
        alone = one.step(actions[watched])[0]
    many.close()
    one.close()


def test_the_preset_in_a_dictionary_is_the_preset_alone() -> None:
    plain = CaveVectorEnv(3, TUBE, observation="full")
    mixed = CaveVectorEnv(3, TUBE, observation={"state": "full", "depth": "depth"})
    assert np.array_equal(plain.reset(seed=1)[0], mixed.reset(seed=1)[0]["state"])
    actions = np.full((3, 3), 2)
    assert np.array_equal(plain.step(actions)[0], mixed.step(actions)[0]["state"])
    plain.close()
    mixed.close()


def test_a_fan_sees_the_rays_of_the_preset() -> None:
    """In metres, where the preset has shares of the rays' lengths."""
    env = CaveVectorEnv(5, TUBE, observation={"base": "paper", "rays": "fan"})
    seen, _ = env.reset(seed=3)
    assert np.allclose(seen["rays"], seen["base"][:, :28] * RangeFan().pattern.lengths, rtol=1e-6)
    env.close()


def test_a_fan_of_spheres_sees_what_the_preset_original_sees() -> None:
    """Whose every fourth value is the share of a ray's length; to the rounding of that product."""
    env = CaveVectorEnv(20, TUBE, observation={"base": "original", "spheres": RangeFan("original")})
    seen, _ = env.reset(seed=3)
    assert np.allclose(seen["spheres"], seen["base"][:, 3:112:4] * RangeFan().pattern.lengths, rtol=1e-6)
    assert (seen["spheres"] < RangeFan().pattern.lengths.astype(np.float32)).any()
    env.close()


def test_the_last_observation_of_an_episode_is_kept_where_its_successor_begins_at_once() -> None:
    """Of two batches with the same seeds, one goes on at the next step: there the last observation is the step's."""
    options = {"observation": parts(), "max_decisions": 5, "num_threads": 1}
    same_step = CaveVectorEnv(4, TUBE, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    next_step = CaveVectorEnv(4, TUBE, **{**options, "observation": parts()})
    same_step.reset(seed=2)
    next_step.reset(seed=2)
    actions = np.full((4, 3), 2)
    for decision in range(5):
        begun, _, _, truncated, infos = same_step.step(actions)
        last = next_step.step(actions)[0]
        assert truncated.all() == (decision == 4)
    assert all(same(infos["final_obs"][n], {name: values[n] for name, values in last.items()}) for n in range(4))
    assert same(begun, next_step.step(actions)[0])
    same_step.close()
    next_step.close()


def test_late_sensors_show_what_they_read_so_many_decisions_ago() -> None:
    """The sensors of a batch with a delay of 3 against those without, over an episode's end."""
    delay, options = 3, {"max_decisions": 8, "num_threads": 1}
    prompt = CaveVectorEnv(2, TUBE, observation=parts(), **options)
    late = CaveVectorEnv(2, TUBE, observation=parts(), observation_delay=delay, **options)
    history = [prompt.reset(seed=4)[0]]
    assert same(late.reset(seed=4)[0], history[0])
    begun = 0
    for decision in range(1, 15):
        actions = np.full((2, 3), 2)
        history.append(prompt.step(actions)[0])
        shown = late.step(actions)[0]
        begun = decision if decision == 9 else begun  # 8 decisions, and the step that begins the next episode
        assert same(shown, history[max(decision - delay, begun)]), decision
    prompt.close()
    late.close()


def test_a_batch_goes_back_to_where_its_state_was_taken() -> None:
    batch = CaveBatch(TUBE, 3, next_step=True, observation=parts(), observation_delay=2)
    batch.reset([1, 2, 3])
    actions = np.full((3, 3), 2)

    def fly() -> list[dict[str, np.ndarray]]:
        seen = []
        for _ in range(4):
            batch.command(actions)
            batch.step()
            seen.append(batch.copy_of("observations"))
        return seen

    fly()
    state = batch.state()
    first = fly()
    batch.restore(state)
    assert all(same(a, b) for a, b in zip(first, fly(), strict=True))
    batch.close()


def test_several_caves_go_into_one_batch() -> None:
    env = CaveVectorEnv(4, [TUBE, tube_scenario(name="other")], observation={"sonar": "depth", "dvl": "dvl"})
    seen, _ = env.reset(seed=0)
    assert env.observation_space.contains(seen)
    env.close()


@pytest.mark.parametrize(
    ("observation", "words"),
    [
        ({}, "at least one part"),
        ({"a": "paper", "b": "full"}, "at most one preset, and a and b are two"),
        ({"a": "sonarr"}, r"no sensor 'sonarr'. Did you mean 'sonar'"),
    ],
)
def test_senseless_parts_are_refused(observation: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        CaveEnv(TUBE, observation=observation)


def test_multi_input_policy_learns_from_a_dictionary() -> None:
    """Some hundred decisions of SB3's PPO: every network's parameters change and the loss is finite."""
    import torch
    from stable_baselines3 import PPO

    env = BatchedVecEnv(TUBE, 16, observation=parts(), max_decisions=40)
    model = PPO("MultiInputPolicy", env, n_steps=16, batch_size=64, n_epochs=2, seed=0, device="cpu")
    before = {name: values.clone() for name, values in model.policy.named_parameters()}
    model.learn(16 * 16 * 2)
    changed = {name: not torch.equal(values, before[name]) for name, values in model.policy.named_parameters()}
    assert all(changed.values()), changed
    assert np.isfinite(model.logger.name_to_value["train/loss"])
    assert np.isfinite(model.rollout_buffer.returns).all()
    env.close()
