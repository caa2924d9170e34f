"""A network's output for a row, against the same row among other rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO, TD3
from stable_baselines3.common.base_class import BaseAlgorithm

from aquanav_tools.evaluate.network import NetworkPolicy
from tests.evaluate.models import make_model


@pytest.mark.parametrize("kind", [PPO, TD3, RecurrentPPO])
@pytest.mark.parametrize("width", [16, 33, 128])
def test_row_gives_the_same_bits_wherever_it_stands(
    kind: type[BaseAlgorithm], width: int, tmp_path: Path, rng: np.random.Generator
) -> None:
    path = tmp_path / "policy.zip"
    make_model(kind, "continuous" if kind is TD3 else "multidiscrete", net_arch=[width, width]).save(path)
    rows = rng.uniform(-1.0, 1.0, (200, 44)).astype(np.float32)
    policy = NetworkPolicy(path)
    whole = policy.logits(rows)
    for _ in range(20):
        chosen = rng.permutation(200)[: rng.integers(1, 200)]
        policy.reset(0)
        assert np.array_equal(policy.logits(rows[chosen]), whole[chosen])
