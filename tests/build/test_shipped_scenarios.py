"""A scenario's name is enough: it is built once, into the cache, from its recipe, and found again."""

from __future__ import annotations

import subprocess
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import aquanav_tools.envs  # noqa: F401  # registers aquanav/Cave-v0
from aquanav_tools import shipped as content
from aquanav_tools.build import shipped_scenarios
from aquanav_tools.build.shipped_scenarios import build_shipped, difficulty
from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.cli.scenarios import Scenarios, run_scenarios
from aquanav_tools.errors import AquanavError, InputError
from aquanav_tools.machine import CACHE_VARIABLE
from aquanav_tools.scenario import shipped
from aquanav_tools.scenario.folder import read_scenario

RECIPE = """
title = "a short gallery"
split = "train"
vehicle = "bluerov2"

[cave]
seed = 5
length = 7.0
radius = 1.0
winding = 0.3
rise = 0.2
swings = 0.5
narrow_radius = 0.8
voxel = 0.2

[starts]
count = 4

[water]
current = "half"
"""


@pytest.fixture
def recipes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a tiny recipe called "tiny", built in this process when a child would be asked to."""
    folder = tmp_path / "content" / "scenarios"
    folder.mkdir(parents=True)
    (folder / "tiny.toml").write_text(RECIPE)
    monkeypatch.setattr(content, "CONTENT_DIR", folder.parent)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))

    def build_here(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        assert command[-2:] == ["scenarios", "tiny"]
        build_shipped("tiny")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(shipped.subprocess, "run", build_here)
    return folder


def test_a_name_builds_a_cave_once_that_can_be_dived(
    recipes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    env = gymnasium.make("aquanav/Cave-v0", scenario="tiny")
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    env.step(env.action_space.sample())
    env.close()

    scenario = read_scenario("tiny")
    prove_watertight(scenario.cavity.mesh)
    assert scenario.settings.built.kind == "synthetic"
    assert [portal.normal.tolist() for portal in scenario.cavity.portals] == [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    for portal, x in zip(scenario.cavity.portals, (0.0, 7.0), strict=True):
        lid = scenario.cavity.mesh.triangles[scenario.cavity.labels == portal.label]
        np.testing.assert_array_equal(lid[..., 0], x)
    assert scenario.flow is not None and scenario.settings.water.current == "half"
    hard = difficulty(scenario)
    assert hard.num_loops == hard.num_dead_ends == 0 and 1.0 < hard.least_clearance <= hard.median_clearance

    monkeypatch.setattr(shipped_scenarios, "gallery_cave", lambda *_: pytest.fail("it was built already"))
    assert build_shipped("tiny") is None
    assert read_scenario("tiny").content_hash == scenario.content_hash
    assert not list((tmp_path / "cache").glob("*.work"))
    run_scenarios(Scenarios())
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("tiny"))
    assert "train" in row and row.endswith("half")

    (recipes / "tiny.toml").write_text(RECIPE.replace("short", "small"))
    run_scenarios(Scenarios())
    assert "1 scenarios of other versions take" in capsys.readouterr().out
    run_scenarios(Scenarios(clean=True))
    assert "1 of 1 older scenarios removed" in capsys.readouterr().out
    assert [path.name for path in (tmp_path / "cache").iterdir() if path.is_dir()] == []


def test_a_recipe_with_an_unknown_key_is_refused(recipes: Path) -> None:
    (recipes / "tiny.toml").write_text(RECIPE.replace("winding", "windng"))
    with pytest.raises(InputError, match=r"windng.*winding"):
        build_shipped("tiny")


def test_an_unknown_name_gets_the_closest(recipes: Path) -> None:
    for ask in (build_shipped, lambda name: run_scenarios(Scenarios(name)), read_scenario):
        with pytest.raises(AquanavError, match=r"[Tt]he nearest names are tiny"):
            ask("tinny")
