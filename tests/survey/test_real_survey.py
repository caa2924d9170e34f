"""The survey of the Tatra caves, held against what Survex's own tools print."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.cavity import prove_watertight, to_manifold
from aquanav_tools.survey.solid import survey_solid
from aquanav_tools.survey.svx import read_svx
from tests.survey.example import SCALE, cavern


@pytest.fixture
def tatra(data_dir: Path) -> Path:
    folder = data_dir / "survey_tatra_jaskinie"
    if not folder.is_dir():
        pytest.skip(f"No real data: {folder} does not exist.")
    return folder


def test_the_whole_data_set_is_as_its_source_says(tatra: Path) -> None:
    survey = read_svx(tatra / "all.svx")
    # SOURCE.md, from cavern 1.4.4.
    assert len(survey.stations) == 5243
    assert len(survey.splays) == 4031
    assert len(survey.legs) - len(survey.splays) == 1155
    assert sum(leg.measured or 0.0 for leg in survey.legs if leg.flags.value == 0) == pytest.approx(5491.54, abs=0.006)
    assert survey.length == pytest.approx(5488.30, abs=0.006)  # cavern: "5488.30m adjusted"
    assert sum(len(passage.stations) for passage in survey.passages) == 378


def test_every_station_is_where_survex_puts_it(tatra: Path, tmp_path: Path) -> None:
    positions, length = cavern(tatra / "all.svx", tmp_path)
    survey = read_svx(tatra / "all.svx")
    named = {station.name: station.position for station in survey.stations if station.name}
    assert named.keys() == positions.keys()
    # Survex rounds to centimetres.
    assert max(np.abs(named[name] - positions[name]).max() for name in positions) < 0.0051
    assert survey.length == pytest.approx(length, abs=0.0051)


def test_mietusia_wyznia_agrees_to_a_millimetre(tatra: Path, tmp_path: Path) -> None:
    source = tatra / "Surveys" / "Jaskinia_Mietusia_Wyznia"
    folder = shutil.copytree(source, tmp_path / "cave", copy_function=shutil.copyfile)
    folder.chmod(0o755)
    enlarge = f"*calibrate tape 0 {SCALE}\n*sd tape position {0.05 * SCALE} metres\n*include mietusia_wyznia\n"
    (folder / "enlarged.svx").write_text(enlarge)
    positions, length = cavern(folder / "enlarged.svx", tmp_path)
    survey = read_svx(folder / "mietusia_wyznia.svx")
    named = {station.name: station.position for station in survey.stations if station.name}
    assert named.keys() == positions.keys()
    assert max(np.abs(named[name] - positions[name] / SCALE).max() for name in positions) < 0.001
    assert survey.length == pytest.approx(length / SCALE, abs=0.001)


@pytest.mark.slow
def test_mietusia_wyznia_becomes_a_cave_from_its_splays(tatra: Path) -> None:
    survey = read_svx(tatra / "Surveys" / "Jaskinia_Mietusia_Wyznia" / "mietusia_wyznia.svx")
    cave = survey_solid(survey)
    prove_watertight(cave.mesh)
    assert cave.num_wall_points > 3000
    assert [plane.name for plane in cave.entrances] == ["mietusia_wyznia.otwor.0"]
    assert cave.genus <= cave.num_loops
    # Half of the shots end within two voxels of the wall drawn: the wall is a mean of them.
    assert cave.median_misfit < 0.4
    mean_section = to_manifold(cave.mesh).volume() / np.linalg.norm(cave.legs[:, 1] - cave.legs[:, 0], axis=1).sum()
    assert 1.0 < mean_section < 6.0  # m2: a crawl to a small gallery
