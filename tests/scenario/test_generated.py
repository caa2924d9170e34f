"""Names generated/STYLE/SEED: built on first use, whole or not at all, and told when they make no sense."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import trimesh
from scipy.spatial import cKDTree

from aquanav_tools.build.generated import MAX_WIDTHS, MIN_WIDTHS, _limits, build_generated
from aquanav_tools.errors import ScenarioError
from aquanav_tools.machine import CACHE_VARIABLE
from aquanav_tools.scenario import shipped
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.shipped import named_folder, scenario_folder
from aquanav_tools.synthetic.styles.catalogue import VEHICLE_WIDTH

NAME = "generated/phreatic-tube/1"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_drawn_cave_is_built_into_the_cache_and_read_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = build_generated("phreatic-tube", 1)
    assert folder == named_folder(NAME)
    before = files(folder)
    monkeypatch.setattr("subprocess.run", lambda *_, **__: pytest.fail("nothing had to be built"))
    scenario = read_scenario(NAME)
    assert scenario.guide.length > 15.0 and len(scenario.starts) > 10 and scenario.flow is not None
    # The way's room, by another library: half the narrowest place is the distance to the wall of some point.
    inner = scenario.guide.centreline[20:-20]
    samples = trimesh.sample.sample_surface(scenario.cavity.walls.to_trimesh(), 200_000, seed=1)[0]
    width = 2.0 * cKDTree(samples).query(inner)[0].min() / VEHICLE_WIDTH
    assert MIN_WIDTHS <= width <= MAX_WIDTHS  # samples lie 3 cm apart: at this distance they overstate it by 1 mm
    (folder / "scenario.toml").unlink()  # half a scenario
    build_generated("phreatic-tube", 1)
    assert files(folder) == before
    assert not list(folder.parent.glob("*.work"))
    field = folder / "field.npz"
    field.write_bytes(field.read_bytes()[:-1])
    with pytest.raises(ScenarioError, match=r"field\.npz has changed since the scenario was written"):
        read_scenario(NAME)


def test_a_half_built_one_is_told_and_built_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    named_folder(NAME).mkdir(parents=True)
    monkeypatch.setattr("sys.executable", "/bin/false")
    with pytest.raises(ScenarioError, match="Try it by itself: aquanav generate --style phreatic-tube --seed 1"):
        scenario_folder(NAME)
    assert "What lies there was left half built, and is replaced." in capsys.readouterr().err


def test_an_episode_lasts_as_long_as_the_originals_and_longer_where_the_way_is_long() -> None:
    assert _limits(20.0).decisions == _limits(40.0).decisions == 2400
    assert _limits(100.0).decisions == 6000  # 600 s of ten decisions each


def test_mixed_shares_the_folder_of_the_style_it_picks() -> None:
    assert named_folder("generated/mixed/1") == named_folder("generated/breakdown-chamber/1")


@pytest.mark.parametrize(
    "name", ["generated/maze", "generated/maze/x", "generated/maze/-1", "generated/maze/99999999999"]
)
def test_a_name_without_a_seed_is_told(name: str) -> None:
    with pytest.raises(ScenarioError, match="write generated/STYLE/SEED with a whole number from 0 to"):
        read_scenario(name)


def test_an_unknown_style_is_told_the_nearest() -> None:
    with pytest.raises(ScenarioError, match=r"no style 'sump-serie'\. Did you mean 'sump-series'"):
        read_scenario("generated/sump-serie/1")


def drawn_cave(cache: Path, seed: int, num_bytes: int, used: float) -> Path:
    """Put a folder where a drawn cave would lie."""
    folder = named_folder(f"generated/maze/{seed}")
    folder.mkdir(parents=True)
    (folder / "scenario.toml").write_bytes(b"x" * num_bytes)
    os.utime(folder, (used, used))
    return folder


def test_caves_that_were_not_used_for_longest_leave_a_full_cache(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shipped, "DRAWN_LIMIT", 250)
    folders = [drawn_cave(cache, seed, 100, 1000.0 + seed) for seed in range(4)]
    begun = folders[0].with_name(folders[0].name + ".work")
    begun.mkdir()  # what a killed build left
    (begun / "staged").write_bytes(b"x" * 30)
    os.utime(begun, (900.0, 900.0))
    scenario_folder("generated/maze/1")  # is used now
    shipped.trim_drawn(kept=folders[2])
    assert [folder.is_dir() for folder in (*folders, begun)] == [False, True, True, False, False]


def test_drawn_caves_of_other_code_are_old_versions(cache: Path) -> None:
    here = drawn_cave(cache, 1, 10, 1.0)
    other = here.with_name("maze-1-0123456789abcdef")
    other.mkdir()
    assert shipped.old_versions() == [other]
