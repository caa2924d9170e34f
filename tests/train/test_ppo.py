"""The update does what Stable-Baselines3's own does."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import PPO

from aquanav_tools.policy.normaliser import NormalisedObservations
from aquanav_tools.train.ppo import ParallelPPO

SPACES = {
    "multidiscrete": spaces.MultiDiscrete([3, 3, 3]),
    "discrete": spaces.Discrete(27),
    "continuous": spaces.Box(-1.0, 1.0, (3,), np.float32),
}


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Torch's own threads wait for each other on a busy machine; training has one as well."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


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


def model_of(kind: type[PPO], action: str) -> PPO:
    """Return a learner whose rollouts make six minibatches, the last of a single decision; many ratios are clipped."""
    network: dict[str, Any] = {
        "net_arch": [32, 32],
        "activation_fn": torch.nn.SiLU,
        "features_extractor_class": NormalisedObservations,
    }
    return kind(
        "MlpPolicy", Chance(action), n_steps=256, batch_size=51, n_epochs=3, ent_coef=0.01, clip_range=0.02,
        learning_rate=3e-3, policy_kwargs=network, seed=1, device="cpu",
    )  # fmt: skip


def learned(kind: type[PPO], action: str) -> tuple[dict[str, torch.Tensor], dict[str, float]]:
    """Return weights and last logged numbers after a few updates."""
    model = model_of(kind, action).learn(3 * 256)
    return model.policy.state_dict(), {name: float(value) for name, value in model.logger.name_to_value.items()}


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("action", list(SPACES))
def test_update_is_that_of_stable_baselines(action: str) -> None:
    """Sums in another order round otherwise: 54 steps of Adam at 3e-3 leave 1e-5 at most between the weights."""
    (weights, told), (expected, expected_told) = (learned(kind, action) for kind in (ParallelPPO, PPO))
    assert weights.keys() == expected.keys()
    for name, value in expected.items():
        assert torch.allclose(weights[name], value, atol=1e-5), name
    for name, number in expected_told.items():
        if name.startswith("train/"):
            assert told[name] == pytest.approx(number, abs=1e-3), name
    assert told["train/clip_fraction"] > 0.1
    first = expected["action_net.weight"]
    assert not torch.allclose(first, torch.zeros_like(first), atol=1e-3)


class Inline:
    """An executor without threads."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(function(*arguments))
        return done


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
def test_threads_change_nothing() -> None:
    model = model_of(ParallelPPO, "multidiscrete").learn(256)
    other = copy.deepcopy(model)
    update = other._update  # type: ignore[attr-defined]
    other._update = lambda *arguments: update(*arguments[:-1], Inline())  # type: ignore[attr-defined]
    for one in (model, other):
        np.random.seed(5)
        one.train()
    for name, value in model.policy.state_dict().items():
        assert torch.equal(value, other.policy.state_dict()[name]), name


@pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
@pytest.mark.parametrize("action", list(SPACES))
def test_bfloat16_rounds_gradients_and_keeps_weights_in_float32(action: str) -> None:
    """bfloat16 has 8 bits, so that a product is off by 2^-9 on average; through three layers, 2 % of a gradient."""
    model: Any = model_of(ParallelPPO, action).learn(256)
    batch = model._rollout()
    gradients = {}
    for precision in ("float32", "bfloat16"):
        model.precision = precision
        model.policy.optimizer.zero_grad()
        model._backward_actor(batch, None, 0.2)
        model._backward_critic(batch)
        gradients[precision] = {name: value.grad.clone() for name, value in model.policy.named_parameters()}
    for name, exact in gradients["float32"].items():
        rounded = gradients["bfloat16"][name]
        assert exact.dtype == rounded.dtype == torch.float32
        error = float((rounded - exact).norm() / exact.norm())
        assert 1e-5 < error < 0.05, f"{name}: {error}"


def test_saved_policy_is_read_by_stable_baselines(tmp_path: Any) -> None:
    model = ParallelPPO(
        "MlpPolicy", Chance("multidiscrete"), n_steps=64, batch_size=64, seed=1, device="cpu",
        policy_kwargs={"activation_fn": torch.nn.SiLU},
    ).learn(64)  # fmt: skip
    model.save(tmp_path / "policy.zip")
    again = PPO.load(tmp_path / "policy.zip", device="cpu")
    looks = np.random.default_rng(0).uniform(-1, 1, (50, 31)).astype(np.float32)
    assert np.array_equal(again.predict(looks, deterministic=True)[0], model.predict(looks, deterministic=True)[0])
    again.set_env(model.get_env())  # type: ignore[arg-type]
    again.learn(64)


def test_the_critics_thread_starts_no_threads_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    backward = ParallelPPO._backward_critic

    def counted(model: ParallelPPO, batch: Any) -> torch.Tensor:
        found.append(torch.get_num_threads())
        return backward(model, batch)

    monkeypatch.setattr(ParallelPPO, "_backward_critic", counted)
    torch.set_num_threads(2)
    model_of(ParallelPPO, "multidiscrete").learn(256)
    assert set(found) == {1}
