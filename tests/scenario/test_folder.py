from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import ScenarioError
from aquanav_tools.scenario.folder import read_scenario, write_scenario
from aquanav_tools.scenario.schema import LimitSettings, Scenario, WaterSettings
from tests.caves import tube_scenario


@pytest.fixture
def folder(tube: Scenario, tmp_path: Path) -> Path:
    write_scenario(tube, tmp_path / "tube")
    return tmp_path / "tube"


def replace_in(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_a_scenario_reads_back_as_it_was_written(tmp_path: Path) -> None:
    water = WaterSettings(density=1025.0, current=(0.1, 0.0, -0.2))
    written = tube_scenario(water=water, limits=LimitSettings(decisions=77))
    read = write_scenario(written, tmp_path / "tube")
    assert read.settings == written.settings
    assert np.array_equal(read.cavity.mesh.faces, written.cavity.mesh.faces)
    assert np.array_equal(read.cavity.labels, written.cavity.labels)
    assert np.array_equal(read.cavity.observed, written.cavity.observed)
    assert np.array_equal(read.cavity.mesh.vertices, written.cavity.mesh.vertices.astype(np.float32))
    assert np.array_equal(read.field.values, written.field.values)
    assert np.array_equal(read.guide.centres, written.guide.centres)
    assert [s.geodesic_to_goal for s in read.starts] == [s.geodesic_to_goal for s in written.starts]
    assert [p.area for p in read.cavity.portals] == [p.area for p in written.cavity.portals]


def test_the_same_scenario_gives_the_same_bytes(tube: Scenario, tmp_path: Path) -> None:
    one, two = write_scenario(tube, tmp_path / "one"), write_scenario(tube, tmp_path / "two")
    assert one.content_hash == two.content_hash


def test_an_unknown_key_is_refused_with_the_closest_match(folder: Path) -> None:
    replace_in(folder / "scenario.toml", "vehicle =", "vehicel =")
    with pytest.raises(ScenarioError, match=r"unknown key 'vehicel'\. Did you mean 'vehicle'\?"):
        read_scenario(folder)


def test_a_value_out_of_range_is_refused_with_the_range(folder: Path) -> None:
    replace_in(folder / "scenario.toml", "dt = 0.02", "dt = 2.0")
    with pytest.raises(ScenarioError, match=r"limits\.dt = 2\.0 is outside \[0\.0001, 0\.1\]"):
        read_scenario(folder)


def test_a_wrong_type_is_refused(folder: Path) -> None:
    replace_in(folder / "scenario.toml", "substeps = 5", 'substeps = "5"')
    with pytest.raises(ScenarioError, match="substeps must be of type int, not str"):
        read_scenario(folder)


@pytest.mark.parametrize("name", ["cave.ply", "collision.obj", "field.npz", "guide.json", "starts.json"])
def test_a_changed_file_is_noticed(folder: Path, name: str) -> None:
    with (folder / name).open("ab") as stream:
        stream.write(b" ")
    with pytest.raises(ScenarioError, match=f"{name} has changed since"):
        read_scenario(folder)


def test_a_missing_file_is_noticed(folder: Path) -> None:
    (folder / "field.npz").unlink()
    with pytest.raises(ScenarioError, match=r"lacks its file field\.npz"):
        read_scenario(folder)


def test_a_link_out_of_the_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    shutil.move(folder / "guide.json", tmp_path / "guide.json")
    (folder / "guide.json").symlink_to(tmp_path / "guide.json")
    with pytest.raises(ScenarioError, match=r"lacks its file guide\.json"):
        read_scenario(folder)


def test_a_folder_without_settings_is_not_a_scenario(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="is not a scenario"):
        read_scenario(tmp_path)


def test_a_scenario_carries_its_vehicle(tube: Scenario, tmp_path: Path) -> None:
    text = 'name = "mine"  # a vehicle\'s own file\n'
    assert write_scenario(dataclasses.replace(tube, vehicle_toml=text), tmp_path / "tube").vehicle_toml == text


def test_a_vehicle_that_is_a_path_is_refused(folder: Path) -> None:
    replace_in(folder / "scenario.toml", 'vehicle = "bluerov2"', 'vehicle = "../other.toml"')
    with pytest.raises(ScenarioError, match=r"vehicle = '\.\./other\.toml' is no name"):
        read_scenario(folder)


def test_a_guide_with_a_non_finite_number_is_refused(tube: Scenario, tmp_path: Path) -> None:
    from aquanav_tools.scenario import geometry

    path = tmp_path / "guide.json"
    geometry.write_guide(tube.guide, tube.cavity.portals, path)
    table = json.loads(path.read_text())
    table["panels"][0]["centre"][0] = float("nan")
    path.write_text(json.dumps(table))
    with pytest.raises(ScenarioError, match="not finite"):
        geometry.read_guide(path)


def test_settings_are_frozen(tube: Scenario) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        tube.settings.name = "other"  # type: ignore[misc]
