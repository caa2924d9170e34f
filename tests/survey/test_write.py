"""The Survex writer. Truth: what goes in comes out, in our reader and in Survex."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.survey.legs import SurveyLegs
from aquanav_tools.survey.svx import read_svx
from aquanav_tools.survey.write import write_svx
from tests.survey.example import cavern


def line(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    points = np.cumsum(rng.normal(size=(50, 3)), axis=0) + [419_540.0, 5_455_331.0, 1397.0]
    lrud = rng.uniform(0.1, 9.0, (50, 4))
    lrud[3, 1] = np.nan
    return points, lrud


def test_our_reader_finds_what_was_written(tmp_path: Path, rng: np.random.Generator) -> None:
    points, lrud = line(rng)
    write_svx(tmp_path / "out.svx", 'The "big" one', points, lrud, {"Otwór główny": 0, "south": 49})
    survey = read_svx(tmp_path / "out.svx")
    assert np.abs(survey.positions - points).max() < 1e-4  # four decimals
    assert survey.passages[0].lrud == pytest.approx(lrud, abs=1e-4, nan_ok=True)
    assert [station.position[0] for station in survey.entrances] == pytest.approx(points[[0, 49], 0], abs=1e-4)
    assert survey.title == "The 'big' one"
    assert survey.warnings == ()


def test_survex_reads_it_as_well(tmp_path: Path, rng: np.random.Generator) -> None:
    points, lrud = line(rng)
    write_svx(tmp_path / "out.svx", "out", points, lrud, {"north": 0})
    positions, length = cavern(tmp_path / "out.svx", tmp_path)
    found = np.array([positions["centreline.north_0"], *(positions[f"centreline.{i}"] for i in range(1, 50))])
    assert np.abs(found - points).max() <= 0.005 + 1e-4  # Survex prints centimetres
    assert length == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum(), abs=0.005 + 0.001)


def test_a_survey_beside_it_keeps_its_names_legs_and_length(tmp_path: Path, rng: np.random.Generator) -> None:
    names = ("hall.A1", "hall.a1", "hall.2", "", "dry passage.3")
    positions = 1000.0 * rng.normal(size=(5, 3))
    legs = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 0]])  # a loop: it must close
    survey = SurveyLegs(names, positions, legs, np.array([True, False, False, False, False]))
    points, _ = line(rng)
    write_svx(tmp_path / "out.svx", "out", points, survey=survey)
    found = read_svx(tmp_path / "out.svx")
    for name, position in zip(("hall_A1", "hall_a1", "hall_2", "unnamed_3", "dry_passage_3"), positions, strict=True):
        assert np.abs(found.find(f"survey.{name}").position - position).max() < 1e-4
    assert [station.name for station in found.entrances] == ["survey.hall_A1"]
    ends = positions[legs]
    metres = (
        np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() + np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    )
    assert found.length == pytest.approx(metres, abs=0.01)  # 54 legs, rounded to a tenth of a millimetre


def test_shapes_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least 2"):
        write_svx(tmp_path / "x.svx", "x", np.zeros((1, 3)))
    with pytest.raises(ValueError, match=r"\(3, 4\)"):
        write_svx(tmp_path / "x.svx", "x", np.eye(3), np.zeros((2, 4)))
    with pytest.raises(ValueError, match="point 7"):
        write_svx(tmp_path / "x.svx", "x", np.eye(3), None, {"gone": 7})
