"""A policy that cannot act is told of in the terminal, and does not pass for one that fails to arrive."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.cli.evaluate import main
from aquanav_tools.errors import PolicyError
from tests.commands import run_here

aquanav_eval = functools.partial(run_here, main)

CODE = """
import numpy as np

def raises(observation):
    return {}["rudder"]

def wrong_shape(observation):
    return np.array([1, 1])

def not_finite(observation):
    return np.array([np.nan, 0.0, 0.0])

not_finite.action = "continuous"

def fractions(observation):
    return np.array([1.7, 0.2, 1.9])

def words(observation):
    return "ahead"

class Sometimes:
    def reset(self, seed):
        self.is_bad = seed % 2 == 0

    def __call__(self, observation):
        if self.is_bad:
            raise ValueError("lost the wall")
        return [1, 1, 2]
"""
LINE = CODE.splitlines().index('    return {}["rudder"]') + 1
KINDS: dict[str, dict[str, Any]] = {
    "alone": {"--workers": 1},
    "in processes": {"--workers": 2},
    "batch": {"--backend": "batch"},
}


@pytest.fixture(autouse=True)
def working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    (tmp_path / "own_failing.py").write_text(CODE)
    yield
    sys.modules.pop("own_failing", None)


def finished(folder: Path, policy: str, kind: str, episodes: int = 2) -> Any:
    flags = [word for pair in KINDS[kind].items() for word in pair]
    short = ("--episodes", episodes, "--max-decisions", 5, "--record", "none", "-o", "out")
    return aquanav_eval(f"own_failing:{policy}", "--scenario", folder, *short, *flags)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("alone", marks=pytest.mark.drawn_reports),
        pytest.param("in processes", marks=pytest.mark.slow),  # test_episode_runner.py has an error in one of two
        "batch",
    ],
)
def test_error_in_every_episode_is_told_with_its_line_and_ends_with_a_code_of_its_own(folder: Path, kind: str) -> None:
    result = finished(folder, "raises", kind)
    assert result.returncode == PolicyError.exit_code == 8
    assert "own_failing:raises itself failed in every episode (2)" in result.stderr
    assert f"KeyError: 'rudder' (own_failing.py, line {LINE})" in result.stderr
    assert "success" not in result.stdout
    assert (Path("out") / "results.json").is_file()
    assert "(own_failing.py, line" in (Path("out") / "report.html").read_text()


@pytest.mark.parametrize(
    ("policy", "action", "kind"),
    [
        ("wrong_shape", "3 choices from 0 to 2, got array([1, 1])", "alone"),
        ("not_finite", "3 finite numbers, got array([nan,  0.,  0.])", "batch"),
        ("fractions", "3 choices from 0 to 2, got array([1.7, 0.2, 1.9])", "batch"),
        ("words", "3 choices from 0 to 2, got 'ahead'", "alone"),
    ],
)
def test_actions_of_the_wrong_form_are_told_like_errors(folder: Path, policy: str, action: str, kind: str) -> None:
    result = finished(folder, policy, kind)
    assert result.returncode == 8
    assert f"An action must be {action}" in result.stderr


@pytest.mark.parametrize("kind", ["alone", "batch"])
def test_some_failed_episodes_are_a_warning_with_their_number(folder: Path, kind: str) -> None:
    result = finished(folder, "Sometimes", kind, episodes=5)
    assert result.returncode == 0
    assert "warning: The policy own_failing:Sometimes itself failed in 3 of 5 episodes" in result.stderr
    assert "ValueError: lost the wall" in result.stderr
    assert "collision-free success" in result.stdout


def test_search_for_failures_is_none_where_the_policy_cannot_act(folder: Path) -> None:
    flags = ("--budget", 2, "--max-decisions", 3, "--workers", 1, "-o", "out")
    result = aquanav_eval("stress", "own_failing:raises", "--scenario", folder, *flags)
    assert result.returncode == 8
    assert "itself failed in every episode (4), first in episode 0 (seed" in result.stderr
    assert "It failed in" not in result.stdout


def test_policy_that_only_misses_the_goal_is_no_failed_policy(folder: Path) -> None:
    result = aquanav_eval(
        "baseline:random", "--scenario", folder, "--episodes", 2, "--max-decisions", 5, "--record", "none"
    )
    assert (result.returncode, result.stderr.count("itself failed")) == (0, 0)
    assert "0 %" in result.stdout


def test_one_unusable_policy_of_several_ends_with_the_code_after_all_were_flown(folder: Path) -> None:
    policies = ("own_failing:raises", "baseline:reactive")
    short = ("--episodes", 2, "--max-decisions", 5, "--record", "none", "-o", "out")
    result = aquanav_eval(*policies, "--scenario", folder, *short)
    assert result.returncode == 8
    assert "baseline:reactive in" in result.stdout
    assert "own_failing:raises itself failed in every episode" in result.stderr
