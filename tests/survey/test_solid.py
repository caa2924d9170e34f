"""Caves made of surveys. Truth: tubes whose volume is known in closed form, and topology."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import pytest

from aquanav_tools.cave.cavity import prove_watertight, to_manifold
from aquanav_tools.errors import InputError
from aquanav_tools.geometry.mesh.patches import boundary_loops
from aquanav_tools.survey.model import Leg, LegFlag, Passage, Station, StationFlag, Survey
from aquanav_tools.survey.shapes import LONG_SHOT
from aquanav_tools.survey.solid import SurveyCave, survey_solid
from aquanav_tools.survey.svx import read_svx
from aquanav_tools.types import Array

VOXEL = 0.2


def straight(radius: float, length: float, entrances: tuple[int, ...] = ()) -> Survey:
    """Return five stations along +x with left, right, up, down all alike."""
    places = np.zeros((5, 3))
    places[:, 0] = np.linspace(0.0, length, 5)
    flags = [StationFlag.ENTRANCE if i in entrances else StationFlag.UNDERGROUND for i in range(5)]
    stations = tuple(Station(f"s.{i}", place, flag) for i, (place, flag) in enumerate(zip(places, flags, strict=True)))
    legs = tuple(Leg(i, i + 1) for i in range(4))
    return Survey("tube", stations, legs, (Passage(np.arange(5), np.full((5, 4), radius)),))


def with_splays(survey: Survey, start: int, ends: Array) -> Survey:
    count = len(survey.stations)
    stations = tuple(Station("", end, StationFlag.ANONYMOUS | StationFlag.WALL) for end in ends)
    legs = tuple(Leg(start, count + i, LegFlag.SPLAY) for i in range(len(ends)))
    return Survey(survey.title, survey.stations + stations, survey.legs + legs, survey.passages)


def legs_inside(cave: SurveyCave) -> bool:
    share = np.linspace(0.0, 1.0, 101)[:, None, None]
    points = ((1 - share) * cave.legs[:, 0] + share * cave.legs[:, 1]).reshape(-1, 3)
    return bool(cave.mesh.to_trimesh().contains(points).all())


def test_equal_sides_make_a_round_tube_cut_flat_at_both_entrances() -> None:
    cave = survey_solid(straight(1.5, 20.0, (0, 4)), VOXEL)
    prove_watertight(cave.mesh)
    # The planes lie ENTRANCE_MARGIN outside both ends. Rounding by one voxel draws a wall of radius r in by about
    # voxel^2 / (2 r), 0.9 % of its radius; where it is cut, by its end's roundness: 3 % in all.
    assert to_manifold(cave.mesh).volume() == pytest.approx(np.pi * 1.5**2 * 20.2, rel=0.03)
    assert cave.genus == 0
    assert cave.measured_share == 1.0
    assert legs_inside(cave)
    assert sorted(plane.point[0] for plane in cave.entrances) == pytest.approx([-0.1, 20.1])
    assert cave.mesh.vertices[:, 0].min() == pytest.approx(-0.1, abs=1e-6)
    assert cave.mesh.vertices[:, 0].max() == pytest.approx(20.1, abs=1e-6)
    assert cave.warnings == ()


def test_without_its_lids_the_tube_is_open_at_both_entrances_and_nowhere_else() -> None:
    cave = survey_solid(straight(1.5, 20.0, (0, 4)), VOXEL)
    loops = [cave.open_surface.vertices[loop] for loop in boundary_loops(cave.open_surface)]
    assert sorted(float(loop[:, 0].mean()) for loop in loops) == pytest.approx([-0.1, 20.1])
    assert all(np.ptp(loop[:, 0]) < 1e-6 for loop in loops)


def test_a_long_shot_down_the_passage_widens_nothing() -> None:
    survey = straight(1.0, 20.0)
    plain = to_manifold(survey_solid(survey, VOXEL).mesh).volume()
    shot = survey_solid(with_splays(survey, 0, np.array([[14.0, 0.0, 1.0]])), VOXEL)
    # It ends on the wall as it is drawn; half a percent is the noise of the grid.
    assert to_manifold(shot.mesh).volume() == pytest.approx(plain, rel=0.005)


def test_a_shot_into_a_passage_that_was_not_surveyed_is_cut() -> None:
    cave = survey_solid(with_splays(straight(1.0, 20.0), 2, np.array([[10.0, 15.0, 0.0]])), VOXEL)
    assert cave.mesh.vertices[:, 1].max() < LONG_SHOT * 1.0 + VOXEL
    assert legs_inside(cave)


def test_a_ring_of_passages_is_one_handle_and_loops_are_counted() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    places = 10.0 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    stations = tuple(Station(str(i), place) for i, place in enumerate(places))
    ring = Survey("ring", stations, tuple(Leg(i, (i + 1) % 12) for i in range(12)))
    cave = survey_solid(ring, 0.25)
    assert (cave.genus, cave.num_loops) == (1, 1)
    assert "12 of 12 stations have neither splays" in cave.warnings[0]
    assert "No station is marked as an entrance" in cave.warnings[1]
    assert np.isnan(cave.median_misfit)


def test_stations_on_the_wall_seal_no_passage(rng: np.random.Generator) -> None:
    survey = straight(1.0, 12.0)
    lrud = np.array([[0.0, 1.0, 1.0, 0.0], [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 2.0, 0.0], [0.01, 0, 0, 0], [1, 0, 0, 1]])
    cave = survey_solid(Survey("crawl", survey.stations, survey.legs, (Passage(np.arange(5), lrud),)), VOXEL)
    prove_watertight(cave.mesh)
    assert legs_inside(cave)


def test_parts_that_hang_together_with_nothing_are_named(tmp_path: Path) -> None:
    path = tmp_path / "two.svx"
    path.write_text("*fix a\n*fix x 100 0 0\na b 10 90 0\nb c 10 90 0\nx y 4 90 0\n")
    cave = survey_solid(read_svx(path), 0.25)
    assert len(cave.legs) == 2
    assert any("those of: x" in warning for warning in cave.warnings)


def test_the_way_in_is_found_where_the_surface_survey_ends(tmp_path: Path) -> None:
    path = tmp_path / "in.svx"
    path.write_text("*fix gps\n*flags surface\ngps 0 10 90 0\n*flags not surface\n0 1 10 90 0\n1 2 10 90 0\n")
    (plane,) = survey_solid(read_svx(path), 0.25).entrances
    assert plane.name == "0"
    assert plane.normal == pytest.approx([-1, 0, 0])


def test_a_surface_survey_is_no_cave(tmp_path: Path) -> None:
    path = tmp_path / "hill.svx"
    path.write_text("*flags surface\na b 10 90 0\n")
    with pytest.raises(InputError, match="none of them along a passage under ground"):
        survey_solid(read_svx(path))


def test_pieces_of_blocks_are_joined_without_seams() -> None:
    # 70 m at 0.2 m spans eight blocks of 48 cells; the surface must be one closed piece all the same.
    cave = survey_solid(straight(2.0, 70.0), VOXEL)
    assert to_manifold(cave.mesh).status() == manifold3d.Error.NoError
    assert cave.mesh.to_trimesh().body_count == 1
