"""Bays as scenarios: what their settings files may say, and what is wrong with others."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.scenario.bay import is_bay, read_bay
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.shipped import BAYS
from aquanav_tools.sea.generate import generate_map
from aquanav_tools.sea.sea_map import write_map
from aquanav_tools.shipped import shipped_names


def write_bay(folder: Path, text: str) -> Path:
    path = folder / "reefs.toml"
    path.write_text("format = 1\n" + text)
    return path


def test_shipped_bays_are_read_by_name() -> None:
    bays = [read_bay(name) for name in shipped_names(BAYS)]
    assert [bay.settings.sea for bay in bays] == ["breeze", "calm", "rough"]
    assert len({bay.content_hash for bay in bays}) == len(bays)


def test_names_and_paths_of_caves_mean_no_bay() -> None:
    assert [is_bay(spec) for spec in ("cave-test-1", "out/han", "bay-calm", "reefs.toml", "bay.json")] == [
        False, False, True, True, True,
    ]  # fmt: skip


def test_a_bays_name_with_a_slip_gets_the_right_one() -> None:
    with pytest.raises(ScenarioError, match="bay-calm"):
        read_scenario("bay-clam")


def test_a_fixed_bay_is_named_by_its_map_and_hashed_with_it(tmp_path: Path) -> None:
    write_map(generate_map(4), tmp_path / "bay.json")
    path = write_bay(tmp_path, 'map = "bay.json"\nsea = "rough"\n')
    first = read_bay(path)
    assert (first.map_path, first.settings.sea) == (tmp_path / "bay.json", "rough")
    write_map(generate_map(5), tmp_path / "bay.json")
    assert read_bay(path).content_hash != first.content_hash
    assert read_bay(tmp_path / "bay.json").settings.vehicle == "otter"


def test_a_scene_of_the_original_has_its_boat(data_dir: Path) -> None:
    settings = read_bay(data_dir / "saferlauv" / "surface" / "train.json").settings
    assert (settings.vehicle, settings.sea) == ("boat", "still")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('sae = "calm"\n', r"unknown key 'sae'.*sea"),
        ('map = "../bay.json"\n', r"beside the settings, without a folder"),
        ('map = "none.json"\n', r"There is no map .*none\.json"),
        ('map = "bay.json"\n[rocks]\ndensity = 0.1\n', r"exclude each other"),
        ("decisions = 0\n", r"decisions = 0 must be at least 1"),
    ],
)
def test_senseless_settings_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=message):
        read_bay(write_bay(tmp_path, text))


def test_rocks_without_room_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="density"):
        read_bay(write_bay(tmp_path, "[rocks]\ndensity = 0.9\n"))


def test_a_file_of_another_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bay.toml"
    path.write_text('sea = "calm"\n')
    with pytest.raises(ScenarioError, match="format = 1"):
        read_bay(path)
