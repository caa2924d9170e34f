"""Scenarios in drawn caves: a vehicle crosses them, and a command builds many."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from aquanav_tools.build.generated import build_generated
from aquanav_tools.cli.info import main
from aquanav_tools.machine import CACHE_VARIABLE
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.shipped import named_folder
from tests.commands import run_here
from tests.evaluate.test_policies import score


@pytest.fixture(autouse=True, scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A drawn cave in a cache of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(tmp_path_factory.mktemp("cache")))
        yield build_generated("phreatic-tube", 1)


@pytest.mark.parametrize("current", [None, "full"])
def test_the_oracle_crosses_a_drawn_cave_without_a_collision(drawn: Path, current: str | None) -> None:
    summary = score(read_scenario(drawn), "baseline:oracle", 2, current=current)
    assert summary.collision_free_success.rate == 1.0


def test_count_builds_a_cave_of_every_seed_that_has_none_and_tells_their_folders(drawn: Path) -> None:
    before = (drawn / "scenario.toml").stat().st_mtime_ns
    done = run_here(main, "generate", "--style", "phreatic-tube", "--seed", 1, "--count", 2, "--workers", 2)
    folders = [named_folder(f"generated/phreatic-tube/{seed}") for seed in (1, 2)]
    assert done.returncode == 0, done.stderr
    assert sorted(done.stdout.split()) == sorted(str(folder) for folder in folders)
    assert [len(read_scenario(folder).starts) > 10 for folder in folders] == [True, True]
    assert folders[0] == drawn and (drawn / "scenario.toml").stat().st_mtime_ns == before


def test_no_caves_at_all_are_a_mistake() -> None:
    done = run_here(main, "generate", "--style", "phreatic-tube", "--count", 0)
    assert done.returncode == 2
    assert "--count 0 must be at least 1" in done.stderr
