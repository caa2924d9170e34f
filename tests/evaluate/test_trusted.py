from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.policies import load_policy
from tests.evaluate.models import ACTIONS, Still, make_model


class Fixed(torch.nn.Module):
    """Gives the same numbers for every observation of one size."""

    def __init__(self, size: int, numbers: list[float], is_integer: bool = False) -> None:
        super().__init__()
        self.size = size
        self.numbers = torch.tensor([numbers], dtype=torch.int64 if is_integer else torch.float32)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        assert observation.shape[1] == self.size
        return self.numbers


class Counting(torch.nn.Module):
    """Its level is the number of observations since its reset, in tenths."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    @torch.jit.export
    def reset(self) -> None:
        self.count = 0

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        self.count += 1
        return torch.full((1, 3), 0.1 * self.count)


class Writing(torch.nn.Module):
    """Writes a file: TorchScript is a program."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self.path = path

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        torch.save(observation, self.path)
        return observation[:, :3]


def export(module: torch.nn.Module, path: Path) -> str:
    torch.jit.script(module).save(str(path))
    return str(path)


def test_policy_with_state_dependent_exploration_acts_as_the_library_has_it(
    tmp_path: Path, rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    model = PPO("MlpPolicy", Still(ACTIONS["continuous"]), use_sde=True, seed=0, device="cpu")
    model.save(tmp_path / "policy.zip")
    with pytest.raises(InputError, match=r"use_sde.*--trust"):
        load_policy(str(tmp_path / "policy.zip"))
    with caplog.at_level(logging.WARNING):
        loaded = load_policy(str(tmp_path / "policy.zip"), is_trusted=True)
    assert "runs any code that it holds" in caplog.text
    assert (loaded.observation, loaded.action) == ("full", "continuous")
    for observation in rng.uniform(-1.0, 1.0, (20, 44)).astype(np.float32):
        np.testing.assert_array_equal(loaded.policy.act(observation), model.predict(observation, deterministic=True)[0])


def test_what_needs_no_trust_is_rebuilt_without_it_all_the_same(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    make_model().save(tmp_path / "policy.zip")
    load_policy(str(tmp_path / "policy.zip"), is_trusted=True)
    assert "runs any code" not in caplog.text


def test_torchscript_writes_files_when_it_is_run_and_is_not_loaded_without_trust(tmp_path: Path) -> None:
    witness = tmp_path / "witness"
    spec = export(Writing(str(witness)), tmp_path / "policy.pt")
    with pytest.raises(InputError, match=r"is a program: its operators can write files.*--trust"):
        load_policy(spec)
    assert not witness.exists()
    load_policy(spec, is_trusted=True)
    assert witness.exists()  # the attack is real


@pytest.mark.parametrize(
    ("size", "numbers", "is_integer", "expected"),
    [
        (44, [0.5, -1.0, 0.25], False, ("full", "continuous", [0.5, -1.0, 0.25])),
        (31, [0, 2, 1], True, ("paper", "multidiscrete", [0, 2, 1])),
        (31, [9.0, 0, 0, 0, 9, 0, 0, 0, 9], False, ("paper", "multidiscrete", [0, 1, 2])),
        (120, [26], True, ("original", "discrete", 26)),
        (120, [0.0] * 5 + [1.0] + [0.0] * 21, False, ("original", "discrete", 5)),
    ],
)
def test_form_of_torchscript_follows_from_what_it_takes_and_gives(
    size: int, numbers: list[float], is_integer: bool, expected: tuple[str, str, object], tmp_path: Path
) -> None:
    loaded = load_policy(export(Fixed(size, numbers, is_integer), tmp_path / "policy.pt"), is_trusted=True)
    assert (loaded.observation, loaded.action) == expected[:2]
    np.testing.assert_array_equal(loaded.policy.act(np.zeros(size, dtype=np.float32)), expected[2])


def test_torchscript_with_a_reset_forgets_between_episodes(tmp_path: Path) -> None:
    policy = load_policy(export(Counting(), tmp_path / "policy.pt"), is_trusted=True).policy
    observation = np.zeros(44, dtype=np.float32)
    for seed in range(2):
        policy.reset(seed)
        levels = [policy.act(observation)[0] for _ in range(3)]
        np.testing.assert_allclose(levels, [0.1, 0.2, 0.3], rtol=1e-6)  # float32


@pytest.mark.parametrize(
    ("size", "numbers", "message"),
    [(12, [0.0] * 3, "takes no observation of a task: 44: "), (44, [0.0] * 7, "gives 7 values of type float32")],
)
def test_torchscript_for_another_task_says_so(size: int, numbers: list[float], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        load_policy(export(Fixed(size, numbers), tmp_path / "policy.pt"), is_trusted=True)


@pytest.mark.parametrize("content", [b"", b"no zip", b"PK\x05\x06" + bytes(18)])
def test_file_that_is_no_torchscript_says_so(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "policy.pt").write_bytes(content)
    with pytest.raises(InputError, match=r"is no TorchScript.*torch\.jit\.script"):
        load_policy(str(tmp_path / "policy.pt"), is_trusted=True)


def test_missing_torchscript_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="There is no policy at"):
        load_policy(str(tmp_path / "policy.pt"), is_trusted=True)
