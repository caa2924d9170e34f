"""Comparisons say in the terminal who is better, how sure that is, and what more episodes would tell."""

from __future__ import annotations

import copy
import functools
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.cli.evaluate import main
from aquanav_tools.evaluate.paired import compare_rates, compare_runs, episodes_to_tell
from tests.commands import run_here
from tests.lighter import lighten_reports

aquanav_eval = functools.partial(run_here, main)
NUM_STARTS = 20
"""Of the tube."""


@pytest.fixture(scope="module")
def evaluated(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of reactive, whose episodes of a still tube are all there are, and of the same under other seeds."""
    output = tmp_path_factory.mktemp("evaluated")
    with pytest.MonkeyPatch.context() as patch:
        lighten_reports(patch)
        for name, seed in (("one", 0), ("other-seeds", 5)):
            flags = ("--seed", seed, "--workers", 1, "--record", "none", "-o", output / name)
            assert aquanav_eval("baseline:reactive", "--scenario", folder, *flags).returncode == 0
    return output


@pytest.fixture
def compare(evaluated: Path, tmp_path: Path) -> Any:
    """Return a function that compares `one` with it after an edit, and returns what the command printed."""

    def run(edit: Any, base: Any = lambda table: None) -> str:
        for name, change in (("first", base), ("second", edit)):
            table = json.loads((evaluated / "one" / "results.json").read_text())
            change(table)
            table["policy"]["name"] = name
            (tmp_path / name).mkdir()
            (tmp_path / name / "results.json").write_text(json.dumps(table))
        result = aquanav_eval("compare", tmp_path / "first", tmp_path / "second", "-o", tmp_path / "out")
        assert result.returncode == 0, result.stderr
        return result.stdout

    return run


def failing(count: int, possible: int | None = None) -> Any:
    """Return an edit after which the first `count` episodes touched the wall."""

    def edit(table: dict[str, Any]) -> None:
        table["possible_episodes"] = possible
        for episode in table["episodes"][:count]:
            episode["collisions"], episode["digest"] = 1, episode["digest"][::-1]

    return edit


@pytest.mark.drawn_reports
def test_the_better_policy_is_named_with_difference_interval_test_and_shared_episodes(compare: Any) -> None:
    printed = compare(failing(8))
    assert "first is better than second" in printed
    assert (
        f"the same {NUM_STARTS} different episodes first ended 20 at the goal without a collision, second 12" in printed
    )
    # By hand: 8 of 20; Newcombe's method 10 of 20 and 12 of 20; 2 / 2^8
    assert "+40 [+16, +61] points (McNemar's exact test, p = 0.0078)" in printed
    assert "collisions per episode" in printed


def test_what_cannot_be_told_apart_is_said_with_the_episodes_that_would_tell(compare: Any) -> None:
    printed = compare(failing(2))
    assert "first and second cannot be told apart" in printed
    assert "(McNemar's exact test, p = 0.5)" in printed
    # Connor's formula by hand: (1.96 sqrt(0.1) + 0.842 sqrt(0.09))^2 / 0.01 = 76.2
    assert "77 such episodes would show it with a probability of 80 %: 57 more" in printed


def test_where_all_episodes_were_run_no_more_are_asked_for(compare: Any) -> None:
    printed = compare(failing(2, NUM_STARTS), failing(0, NUM_STARTS))
    assert "cannot be told apart" in printed
    assert "There are no other episodes that differ under these rules" in printed
    assert "more" not in printed.split("rules.")[0].split("cannot")[1]


def test_rules_that_differ_and_policies_that_failed_are_told(compare: Any) -> None:
    def edit(table: dict[str, Any]) -> None:
        table["protocol"]["current"] = "full"
        table["episodes"][3].update(outcome="failed", reason="KeyError: 'rudder'")

    printed = compare(edit)
    assert "Note: They were run under different rules: current None for first, full for second." in printed
    assert "Note: second itself failed in 1 of 20 episodes" in printed


def test_where_nothing_is_random_the_same_starts_are_the_same_episodes_whatever_the_seeds(
    evaluated: Path, tmp_path: Path
) -> None:
    result = aquanav_eval("compare", evaluated / "one", evaluated / "other-seeds", "-o", tmp_path)
    assert f"of the same {NUM_STARTS} different episodes" in result.stdout


def test_training_runs_are_compared_by_run(evaluated: Path, tmp_path: Path) -> None:
    table = json.loads((evaluated / "one" / "results.json").read_text())
    for method, counts in {"good": (0, 1, 0, 2), "bad": (9, 8, 12, 10)}.items():
        for run, count in enumerate(counts):
            own = copy.deepcopy(table)
            failing(count)(own)
            path = tmp_path / method / str(run) / "results.json"
            path.parent.mkdir(parents=True)
            path.write_text(json.dumps(own))
    printed = aquanav_eval("compare", tmp_path / "good", tmp_path / "bad", "-o", tmp_path / "out").stdout
    assert "good (4 runs) is better than bad (4 runs)" in printed
    assert "permutation test over 4 and 4 runs, p = 0.029" in printed  # the 2 most uneven of 8! / (4! 4!) = 70 deals


def test_single_runs_without_a_common_episode_are_not_tested(compare: Any) -> None:
    def later(table: dict[str, Any]) -> None:
        table["possible_episodes"] = None
        for episode in table["episodes"]:
            episode["seed"] += 1000

    assert "cannot be tested: single runs need episodes in common" in compare(later)


def test_permutation_test_of_runs_is_that_of_all_deals(rng: np.random.Generator) -> None:
    first, second = rng.random(4), rng.random(5)
    scores, gap = np.concatenate([first, second]), abs(first.mean() - second.mean())
    deals = [deal for deal in itertools.permutations(range(9)) if list(deal[:4]) == sorted(deal[:4])][::120]
    gaps = [abs(scores[list(deal[:4])].mean() - scores[list(deal[4:])].mean()) for deal in deals]
    assert compare_runs(first, second).p_value == pytest.approx(np.mean(np.array(gaps) >= gap - 1e-9), abs=1e-9)


def test_advised_number_of_episodes_tells_policies_apart_four_times_in_five(rng: np.random.Generator) -> None:
    chances = np.array([0.80, 0.12, 0.03, 0.05])
    count = episodes_to_tell(compare_rates(*_outcomes(*(100 * chances).round().astype(int))))
    assert count is not None
    found = [compare_rates(*_outcomes(*counts)).p_value for counts in rng.multinomial(count, chances, size=1000)]
    assert 0.66 <= np.mean(np.array(found) < 0.05) <= 0.84  # the exact test is stricter than Connor's normal one


def _outcomes(both: int, only_first: int, only_second: int, neither: int) -> tuple[Any, Any]:
    counts = (both, only_first, only_second, neither)
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)
