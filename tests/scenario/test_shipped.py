"""Scenarios by name: found in the cache, built when missing, told when their slot is empty."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools.build.shipped_scenarios import read_shipped
from aquanav_tools.errors import ScenarioError
from aquanav_tools.machine import CACHE_VARIABLE
from aquanav_tools.scenario import shipped
from aquanav_tools.scenario.folder import read_scenario, write_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.shipped import named_folder, old_versions, remove_version, scenario_folder
from aquanav_tools.shipped import shipped_names
from aquanav_tools.store import locked


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_splits_are_fixed_and_share_no_cave() -> None:
    recipes = {name: read_shipped(name) for name in shipped_names("scenarios")}
    splits = {name: recipe.split for name, recipe in recipes.items()}
    assert [name for name, split in splits.items() if split == "test"] == ["cave-test-1", "cave-test-2", "cave-test-3"]
    assert {name for name, split in splits.items() if split == "train"} == {f"cave-train-{n}" for n in range(1, 25)}
    assert sum(split == "validation" for split in splits.values()) == 2
    assert len({recipe.cave.seed for recipe in recipes.values()}) == len(recipes)


def test_a_built_scenario_is_found_by_its_name(tube: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("subprocess.run", lambda *_, **__: pytest.fail("nothing had to be built"))
    written = write_scenario(tube, named_folder("cave-train-1"))
    assert read_scenario("cave-train-1").content_hash == written.content_hash


def test_a_changed_recipe_has_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = named_folder("cave-train-1")
    changed = tmp_path / "cave-train-1.toml"
    changed.write_text("title = 'another'\n")
    monkeypatch.setattr(shipped, "shipped_path", lambda *_: changed)
    assert named_folder("cave-train-1") != before


def test_a_build_is_announced_and_a_failed_one_tells_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(ScenarioError, match=r"could not be built.*Try it by itself: aquanav scenarios cave-train-1"):
        scenario_folder("cave-train-1")
    assert "Building cave-train-1 in" in capsys.readouterr().err


def test_an_empty_slot_says_how_to_fill_it(cache: Path) -> None:
    with pytest.raises(ScenarioError, match=r"slot for a cave of your own and is empty\. Fill it: aquanav-build-cave"):
        read_scenario("cave-real-1")


def test_a_filled_slot_is_read(tube: Scenario, cache: Path) -> None:
    write_scenario(tube, cache / "cave-real-2")
    assert read_scenario("cave-real-2").name == tube.name


def test_a_misspelt_name_gets_the_three_closest() -> None:
    with pytest.raises(ScenarioError, match="the nearest names are cave-train-1, cave-train-10, cave"):
        read_scenario("cave-trian-1")


def other_version(cache: Path, suffix: str = "") -> Path:
    folder = cache / f"cave-train-1-0123456789abcdef{suffix}"
    folder.mkdir(parents=True)
    (folder / "scenario.toml").write_text("")
    return folder


def test_only_other_versions_of_shipped_scenarios_are_removed(tube: Scenario, cache: Path) -> None:
    old = other_version(cache)
    left_over = cache / "cave-test-1-fedcba9876543210.work"  # of a build that was killed
    mine = [cache / name for name in ("cave-real-2", "cave-mine-0123456789abcdef", "cave-train-1-mine")]
    for folder in (left_over, *mine):
        folder.mkdir()
    current = named_folder("cave-train-1")
    write_scenario(tube, current)
    assert old_versions() == [left_over.with_suffix(""), old]
    assert all(remove_version(folder) for folder in old_versions())
    assert sorted(path for path in cache.iterdir() if path.is_dir()) == sorted([current, *mine])
    assert read_scenario("cave-train-1").name == tube.name


def test_a_version_that_is_being_built_stays(cache: Path) -> None:
    old = other_version(cache)
    with locked(other_version(cache, ".work")):  # flock holds between two openings in one process, too
        assert not remove_version(old)
    assert old.is_dir()
    assert remove_version(old)
    assert not [path for path in cache.iterdir() if path.is_dir()]
