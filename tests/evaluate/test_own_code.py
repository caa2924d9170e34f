from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.provenance import file_hash

CODE = """
import numpy as np

def ahead(observation):
    return [1, 1, 2]

class Counter:
    observation = "paper"
    action = "discrete"

    def reset(self, seed):
        self.count = seed

    def __call__(self, observation):
        self.count += 1
        return self.count

def odd(observation):
    return 0

odd.observation = "pape"
number = 3

class Needy:
    def __init__(self, something):
        pass
"""


@pytest.fixture(autouse=True)
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A module of the user's own in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    (tmp_path / "own_pilot.py").write_text(CODE)
    (tmp_path / "broken_policy.py").write_text("raise RuntimeError('no policy today')")
    yield tmp_path / "own_pilot.py"
    sys.modules.pop("own_pilot", None)


def test_function_of_the_working_directory_is_a_policy_on_full_observations(module: Path) -> None:
    loaded = load_policy("own_pilot:ahead")
    assert (loaded.observation, loaded.action) == ("full", "multidiscrete")
    assert (loaded.name, loaded.sha256) == ("own_pilot:ahead", file_hash(module))
    loaded.policy.reset(0)
    assert loaded.policy.act(np.zeros(44, dtype=np.float32)) == [1, 1, 2]


def test_class_names_its_spaces_and_is_reset_with_the_seed() -> None:
    loaded = load_policy("own_pilot:Counter")
    assert (loaded.observation, loaded.action) == ("paper", "discrete")
    for seed in (3, 7):
        loaded.policy.reset(seed)
        assert loaded.policy.act(np.zeros(31, dtype=np.float32)) == seed + 1


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("no_such_pilot:act", r"no_such_pilot cannot be imported: ModuleNotFoundError.*working\s+directory"),
        ("broken_policy:act", "RuntimeError: no policy today"),
        ("own_pilot:ahed", "has no ahed. Did you mean 'ahead'"),
        ("own_pilot:number", "is a int, which cannot be called"),
        ("own_pilot:odd", "no observation preset 'pape'. Did you mean 'paper'"),
        ("own_pilot:Needy", "making one without arguments failed"),
    ],
)
def test_code_that_is_no_policy_says_why(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_policy(spec)
