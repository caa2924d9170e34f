"""Therion centrelines. Truth: closed forms, and the same survey written for Survex."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.survey.model import StationFlag, Survey
from aquanav_tools.survey.read import read_survey

CAVE = """\
encoding utf-8
survey system -title "The System"  # a comment
  survey upper -declination [90 deg]
    centreline
      date 2020.01.02
      team "Ann Other" notes
      units length feet
      units compass clino degrees
      data normal from to length compass \\
        clino
      1 2 10 0 0
      2 - 3 0 90
      2 . 3 90 0
      group
        flags surface
        1 hill 50 90 0
      endgroup
      station 1 "way in" entrance
      fix 1 100 200 300
    endcentreline
    centerline
      data dimensions station left right up down
      1 1 2 3 4
      2 1 2 - 4
    endcenterline
  endsurvey upper
  survey lower
    centreline
      station-names a b
      data diving station depth newline tape compass
      1 0
        5 0
      2 -4
    endcentreline
  endsurvey
  equate 2@upper a1b@lower
  scrap s1 -projection plan
    line wall
      1 2
    endline
  endscrap
  map m
    s1
  endmap
endsurvey system
"""


def read(tmp_path: Path, text: str) -> Survey:
    path = tmp_path / "cave.th"
    path.write_text(text)
    return read_survey(path)


def test_a_centreline_in_nested_surveys_is_read(tmp_path: Path) -> None:
    survey = read(tmp_path, CAVE)
    assert survey.title == "The System"
    assert survey.find("system.upper.1").position == pytest.approx([100, 200, 300])
    assert survey.find("system.upper.2").position == pytest.approx([103.048, 200, 300])
    assert survey.find("system.lower.a2b").position == pytest.approx([103.048, 203, 296])
    assert survey.length == pytest.approx(3.048 + 5.0)
    assert len(survey.splays) == 2
    assert [station.name for station in survey.entrances] == ["system.upper.1"]
    assert survey.find("system.upper.hill").flags == StationFlag.SURFACE
    assert survey.passages[0].lrud[0] == pytest.approx([1, 2, 3, 4])
    assert survey.warnings == ()


def test_files_are_taken_in(tmp_path: Path) -> None:
    (tmp_path / "part.th").write_text("survey s\ncentreline\n1 2 10 90 0\nendcentreline\nendsurvey\n")
    assert read(tmp_path, "input part\n").find("s.2").position == pytest.approx([10, 0, 0])


def test_longitude_and_latitude_become_the_zone_they_are_in(tmp_path: Path) -> None:
    text = "centreline\ncs lat-long\nfix 1 49.245350 19.894801 1383\n1 2 1 0 0\nendcentreline\n"
    survey = read(tmp_path, text)
    assert survey.coordinate_system == "UTM34N"
    # As cavern 1.4.4 (PROJ) prints them, to the centimetre.
    assert survey.find("1").position == pytest.approx([419561.49, 5455318.47, 1383.0], abs=0.0051)


def test_what_is_set_aside_is_said(tmp_path: Path) -> None:
    text = "centreline\ngrade BCRA5\ndata normal from to tape compass clino left right\n1 2 9 90 0 1 1\nendcentreline\n"
    survey = read(tmp_path, text)
    assert "'grade' is not read" in survey.warnings[0]
    assert "dimensions on the lines of shots" in survey.warnings[1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("survay x\n", ["cave.th:1", "Did you mean 'survey'?"]),
        ("survey x\n", ["the file ends before endsurvey"]),
        ("scrap x\n", ["the file ends before endscrap"]),
        ("endsurvey\n", ["no survey is open"]),
        ("centreline\n1 2 3\nendcentreline\n", ["cave.th:2", "lacks 'compass'"]),
        ("centreline\nunits tape degrees\nendcentreline\n", ["no unit of tape"]),
        ("input ../x\n", ["no such file"]),
        ("input cave\n", ["itself"]),
        ("centreline\ndata normal from too\nendcentreline\n", ["'too' is not known"]),
    ],
)
def test_each_fault_gets_its_sentence(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    for word in words:
        assert word in str(error.value)
