from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from gymnasium import spaces
from stable_baselines3 import PPO, SAC, TD3

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.onnx_file import read_onnx
from aquanav_tools.evaluate.onnx_run import OnnxRunner
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.policy.normaliser import NormalisedObservations
from aquanav_tools.train.export import LOGITS, export
from tests.evaluate.models import ACTIONS, Still

SIZE = 44
CASES = [(PPO, "multidiscrete"), (PPO, "discrete"), (PPO, "continuous"), (SAC, "continuous"), (TD3, "continuous")]


def make(kind: Any, action: str, rng: np.random.Generator) -> Any:
    """An untrained policy that has seen observations, as aquanav-train makes it."""
    network = {"net_arch": [32, 32, 32], "activation_fn": torch.nn.SiLU}
    normalising = {"features_extractor_class": NormalisedObservations}
    memory = {} if kind is PPO else {"buffer_size": 10}
    model = kind(
        "MlpPolicy", Still(ACTIONS[action]), policy_kwargs=network | normalising, seed=0, device="cpu", **memory
    )
    for module in model.policy.modules():
        if isinstance(module, NormalisedObservations):
            module.take_in(rng.normal(0.1, 0.2, (500, SIZE)))
    return model


@pytest.mark.parametrize(("kind", "action"), CASES)
def test_exported_policies_act_as_the_trained_one(
    kind: Any, action: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    model = make(kind, action, rng)
    export(model, tmp_path)
    observations = rng.normal(0.1, 0.3, (200, SIZE)).astype(np.float32)
    wanted = model.predict(observations, deterministic=True)[0]
    script = torch.jit.load(tmp_path / "policy.pt")  # type: ignore[no-untyped-call]
    loaded = load_policy(str(tmp_path / "policy.onnx"))
    acted = np.array([loaded.policy.act(observation) for observation in observations])
    assert (loaded.observation, loaded.action) == ("full", action)
    # Levels in [-1, 1] after sums of up to 44 products: some float32 roundings of 6e-8. Choices are whole numbers; of
    # 600 none lies so near to a tie.
    np.testing.assert_allclose(script(torch.from_numpy(observations)), wanted, atol=2e-6)
    np.testing.assert_allclose(acted, wanted, atol=2e-6)


def test_logits_agree_to_rounding(tmp_path: Path, rng: np.random.Generator) -> None:
    model = make(PPO, "multidiscrete", rng)
    export(model, tmp_path)
    observations = rng.normal(0.1, 0.3, (50, SIZE)).astype(np.float32)
    runner = OnnxRunner(read_onnx(tmp_path / "policy.onnx"), [LOGITS], "the policy")
    distribution = model.policy.get_distribution(torch.from_numpy(observations)).distribution
    wanted = torch.cat([part.logits for part in distribution], dim=1).detach().numpy()
    found = np.concatenate([runner.run({"obs_0": row[None]})[0] for row in observations])
    shares = [part - np.log(np.exp(part).sum(axis=1, keepdims=True)) for part in np.split(found, 3, axis=1)]
    np.testing.assert_allclose(np.concatenate(shares, axis=1), wanted, atol=2e-6)  # as above


@pytest.mark.parametrize(("kind", "action"), [(PPO, "multidiscrete"), (SAC, "continuous")])
def test_onnxruntime_runs_the_same_file(kind: Any, action: str, tmp_path: Path, rng: np.random.Generator) -> None:
    model = make(kind, action, rng)
    export(model, tmp_path)
    onnx.checker.check_model(onnx.load(tmp_path / "policy.onnx"), full_check=True)
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    observations = rng.normal(0.1, 0.3, (200, SIZE)).astype(np.float32)
    inputs = {"obs_0": observations}
    if action == "multidiscrete":
        inputs["action_masks"] = np.ones((200, 9), dtype=np.float32)
    found = session.run(None, inputs)[0]
    np.testing.assert_allclose(found, model.predict(observations, deterministic=True)[0], atol=2e-6)


def test_policy_with_a_memory_is_not_exported(tmp_path: Path) -> None:
    contrib = pytest.importorskip("sb3_contrib")
    model = contrib.RecurrentPPO("MlpLstmPolicy", Still(spaces.Discrete(27)), device="cpu")
    with pytest.raises(InputError, match="cannot be exported"):
        export(model, tmp_path)
