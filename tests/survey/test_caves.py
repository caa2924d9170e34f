"""A file of several caves: what they are called, and choosing one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.survey.caves import caves_in, choose_cave
from aquanav_tools.survey.legs import survey_legs
from aquanav_tools.survey.model import Survey, shared_levels
from aquanav_tools.survey.passage_graph import passage_graph
from aquanav_tools.survey.svx import read_svx
from aquanav_tools.survey.therion import read_th

TWO_CAVES = """
*begin hills
*begin upper
*begin entrance
*entrance 0
*fix 0 0 0 0
*alias station - ..
*data cartesian from to easting northing altitude
0 1 10 0 0
1 - 0 2 0
*end entrance
*begin chamber
*data cartesian from to easting northing altitude
1 2 0 30 0
*end chamber
*equate entrance.1 chamber.1
*end upper
*begin lower
*fix a 500 0 0
*data cartesian from to easting northing altitude
a b 0 0 -25
*data passage station left right up down
a 1 1 1 1
b 1 1 1 1
*end lower
*flags surface
*data cartesian from to easting northing altitude
upper.entrance.0 lower.a 500 0 0
*end hills
"""


@pytest.fixture
def two(tmp_path: Path) -> Survey:
    (tmp_path / "two.svx").write_text(TWO_CAVES)
    return read_svx(tmp_path / "two.svx")


def test_caves_are_what_no_leg_under_ground_joins_and_bear_the_names_of_their_surveys(two: Survey) -> None:
    caves = caves_in(two)
    assert [(cave.name, round(cave.length)) for cave in caves] == [("hills.upper", 40), ("hills.lower", 25)]


def test_a_file_of_several_caves_asks_which_one(two: Survey) -> None:
    with pytest.raises(InputError, match=r"2 caves .*: hills\.upper \(40 m\), hills\.lower \(25 m\).* --cave NAME"):
        choose_cave(two)


def test_a_cave_comes_with_its_splays_and_dimensions_and_nothing_of_the_others(two: Survey) -> None:
    upper, lower = choose_cave(two, "hills.upper"), choose_cave(two, "HILLS.LOWER")
    assert (upper.length, lower.length) == pytest.approx((40.0, 25.0))
    assert (len(upper.splays), len(lower.splays)) == (1, 0)
    assert (len(upper.passages), len(lower.passages)) == (0, 1)
    assert passage_graph(upper).others == passage_graph(lower).others == ()


def test_a_survey_inside_a_cave_can_be_chosen_as_well(two: Survey) -> None:
    assert choose_cave(two, "hills.upper.chamber").length == pytest.approx(30.0)


def test_a_mistyped_name_is_met_with_the_nearest(two: Survey) -> None:
    with pytest.raises(InputError, match=r"'hills\.uper'\. Did you mean 'hills\.upper'\?.*Its caves: hills\.upper"):
        choose_cave(two, "hills.uper")


def test_a_loose_leg_is_no_second_cave(tmp_path: Path) -> None:
    text = "*data cartesian from to dx dy dz\n*fix 0 0 0 0\n0 1 0 0 30\n*fix x 90 0 0\nx y 1 0 0\n"
    (tmp_path / "one.svx").write_text(text)
    survey = read_svx(tmp_path / "one.svx")
    assert choose_cave(survey) is survey
    assert [cave.name for cave in caves_in(survey)] == ["0", "x"]


def test_caves_of_a_therion_file_are_told_apart_by_its_surveys(tmp_path: Path) -> None:
    blocks = "".join(
        f"survey {name}\ncentreline\nfix 0 {east} 0 0\ndata normal from to length compass clino\n0 1 {metres} 90 0\n"
        f"endcentreline\nendsurvey\n"
        for name, east, metres in (("west", 0, 12), ("east", 900, 20))
    )
    (tmp_path / "two.th").write_text(f"encoding utf-8\nsurvey karst\n{blocks}endsurvey\n")
    survey = read_th(tmp_path / "two.th")
    assert [cave.name for cave in caves_in(survey)] == ["karst.east", "karst.west"]
    assert choose_cave(survey, "karst.west").length == pytest.approx(12.0)


def test_names_in_drawings_are_without_the_surveys_that_all_stations_are_in(two: Survey) -> None:
    offset = np.array([100.0, 0.0, 0.0])
    legs = survey_legs(choose_cave(two, "hills.upper"), offset)
    found = {name: position.tolist() for name, position in zip(legs.names, legs.positions, strict=True)}
    assert found == {"entrance.0": [-100, 0, 0], "entrance.1": [-90, 0, 0], "chamber.2": [-90, 30, 0]}
    assert legs.is_entrance.tolist() == [name == "entrance.0" for name in legs.names]
    assert sorted(legs.num_neighbours.tolist()) == [1, 1, 2]


@pytest.mark.parametrize(
    ("names", "levels"),
    [((), []), (("a.b.1", "a.c.1"), ["a"]), (("a.b.1", "a.b.2"), ["a", "b"]), (("a.b.1", "a"), []), (("1", "2"), [])],
)
def test_shared_levels_are_those_before_the_first_difference(names: tuple[str, ...], levels: list[str]) -> None:
    assert shared_levels(names, ".") == levels


def test_the_tatra_file_holds_the_five_caves_of_its_folders(data_dir: Path) -> None:
    folder = data_dir / "survey_tatra_jaskinie"
    if not folder.is_dir():
        pytest.skip(f"No real data: {folder} does not exist.")
    survey = read_svx(folder / "all.svx")
    named = {cave.name: cave.length for cave in caves_in(survey)}
    assert set(named) == {"mietusia", "czarna", "mietusia_wyznia", "zimna", "piwnica_mietusia"}
    # All lengths but duplicates, which Survex does not count: its total is 5488.30 m (SOURCE.md).
    assert 5488.3 <= sum(named.values()) < 6100.0
    with pytest.raises(InputError, match="Did you mean 'mietusia_wyznia'"):
        choose_cave(survey, "mietusia_wyzna")
    alone = read_svx(folder / "Surveys" / "Jaskinia_Mietusia_Wyznia" / "mietusia_wyznia.svx")
    chosen = choose_cave(survey, "Mietusia_Wyznia")
    assert chosen.length == pytest.approx(alone.length, abs=1e-3)
    assert len(chosen.splays) == pytest.approx(len(alone.splays), abs=20)  # all but those above ground
