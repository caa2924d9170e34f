"""The lean update does what Stable-Baselines3's own does."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import PPO

from aquanav_tools.policy.normaliser import NormalisedObservations
from aquanav_tools.train.update import LeanPPO

SPACES = {
    "multidiscrete": spaces.MultiDiscrete([3, 3, 3]),
    "discrete": spaces.Discrete(27),
    "continuous": spaces.Box(-1.0, 1.0, (3,), np.float32),
}


class Chance(gymnasium.Env[Any, Any]):
    """Observations and rewards at random, the reward a little better for a high action; episodes of 17 steps."""

    observation_space = spaces.Box(-1.0, 1.0, (31,), np.float32)

    def __init__(self, action: str) -> None:
        self.action_space = SPACES[action]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps = 0
        return self._look(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        reward = float(np.mean(action) + self.np_random.normal())
        return self._look(), reward, False, self.steps == 17, {}

    def _look(self) -> np.ndarray:
        return self.np_random.uniform(-1.0, 1.0, 31).astype(np.float32)


def learned(kind: type[PPO], action: str) -> tuple[dict[str, torch.Tensor], dict[str, float]]:
    """Return weights and last logged numbers after a few updates of six minibatches, the last of a single decision."""
    network: dict[str, Any] = {
        "net_arch": [32, 32],
        "activation_fn": torch.nn.SiLU,
        "features_extractor_class": NormalisedObservations,
    }
    model = kind(
        "MlpPolicy", Chance(action), n_steps=256, batch_size=51, n_epochs=3, ent_coef=0.01, policy_kwargs=network,
        seed=1, device="cpu",
    )  # fmt: skip
    model.learn(3 * 256)
    return model.policy.state_dict(), {name: float(value) for name, value in model.logger.name_to_value.items()}


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("action", list(SPACES))
def test_update_is_that_of_stable_baselines(action: str) -> None:
    """Sums in another order round otherwise: 54 steps of Adam at 3e-4 leave 1e-5 at most between the weights."""
    (weights, told), (expected, expected_told) = (learned(kind, action) for kind in (LeanPPO, PPO))
    assert weights.keys() == expected.keys()
    for name, value in expected.items():
        assert torch.allclose(weights[name], value, atol=1e-5), name
    for name, number in expected_told.items():
        if name.startswith("train/"):
            assert told[name] == pytest.approx(number, abs=1e-3), name
    first = expected["action_net.weight"]
    assert not torch.allclose(first, torch.zeros_like(first), atol=1e-3)


def test_saved_policy_is_read_by_stable_baselines(tmp_path: Any) -> None:
    model = LeanPPO(
        "MlpPolicy", Chance("multidiscrete"), n_steps=64, batch_size=64, seed=1, device="cpu",
        policy_kwargs={"activation_fn": torch.nn.SiLU},
    ).learn(64)  # fmt: skip
    model.save(tmp_path / "policy.zip")
    again = PPO.load(tmp_path / "policy.zip", device="cpu")
    looks = np.random.default_rng(0).uniform(-1, 1, (50, 31)).astype(np.float32)
    assert np.array_equal(again.predict(looks, deterministic=True)[0], model.predict(looks, deterministic=True)[0])
    again.set_env(model.get_env())  # type: ignore[arg-type]
    again.learn(64)
