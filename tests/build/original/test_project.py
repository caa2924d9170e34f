"""From a Unity project to placed caves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.build.original.import_project import ImportOptions, choose_caves
from aquanav_tools.build.original.placement import turned
from aquanav_tools.build.original.project import read_project
from aquanav_tools.build.original.tube import tube_of
from aquanav_tools.cli import info
from aquanav_tools.errors import InputError
from aquanav_tools.synthetic.caves import sweep
from aquanav_tools.types import Array
from tests.build.original.files import prefab_of, winding_line, write_cave

SCALE = np.array([2.0, 4.0, 4.0])
MOVE = np.array([-9.0, 20.0, 5.0])
STATIONS = [15, 30, 45, 60, 72, 85]


def world_from_cave(points: Array) -> Array:
    """Where the test's scene put its cave: turned by a quarter, twice as long and four times as wide, and moved."""
    x, y, z = points.T
    return np.stack([-y, x, z], axis=1) * SCALE[[1, 0, 2]] + MOVE


@pytest.fixture
def project(tmp_path: Path) -> Path:
    prefabs = tmp_path / "clone" / "Assets" / "Prefabs"
    prefabs.mkdir(parents=True)
    write_cave(prefabs / "Some Cave.fbx", winding_line())
    (prefabs / "Panels.prefab").write_text(prefab_of(world_from_cave(winding_line()[STATIONS])))
    return tmp_path / "clone"


def test_middle_line_of_a_bent_tube_is_its_axis() -> None:
    line = winding_line()
    tube = tube_of(sweep(line, 1.0, 32).mesh)
    assert tube is not None
    dense = np.stack([np.interp(np.linspace(0, 90, 9001), np.arange(91), column) for column in line.T], axis=1)
    misses = np.array([np.linalg.norm(dense - point, axis=1).min() for point in tube.line])
    assert misses.max() < 0.05  # sections tilt in bends: a twentieth of the radius
    assert np.abs(tube.radii - 1.0).max() < 0.05


def test_a_closed_surface_is_no_tube() -> None:
    assert tube_of(sweep(winding_line(), 1.0, 16).truth) is None


def test_a_cave_is_placed_as_its_panels_say(project: Path) -> None:
    (cave,) = read_project(project)
    assert cave.name == "some-cave"
    assert cave.rewarder is not None
    # The panels stand on the axis, so only the polyline's and the sections' errors are left: 0.05 radii of 4 m.
    assert cave.placement.misfit < 0.2
    truth = world_from_cave(winding_line())
    np.testing.assert_allclose(cave.line[[0, -1]], truth[[0, -1]], atol=1.0)
    np.testing.assert_allclose(cave.placement.scale, SCALE[[1, 0, 2]], rtol=0.02)
    np.testing.assert_allclose(cave.goal, truth[STATIONS[-1]], atol=1e-6)


def test_quarter_turns_go_counter_clockwise() -> None:
    points = np.array([[1.0, 0.0, 5.0], [0.0, 2.0, 6.0]])
    np.testing.assert_allclose(turned(points, 1), [[0.0, 1.0, 5.0], [-2.0, 0.0, 6.0]])
    np.testing.assert_allclose(turned(points, 4), points)


def test_the_way_runs_from_the_first_panel_to_the_last(project: Path) -> None:
    backwards = world_from_cave(winding_line()[STATIONS[::-1]])
    (project / "Assets" / "Prefabs" / "Panels.prefab").write_text(prefab_of(backwards))
    (cave,) = read_project(project)
    np.testing.assert_allclose(cave.line[-1], world_from_cave(winding_line()[:1])[0], atol=1.0)


def test_a_cave_without_panels_becomes_as_wide_and_long_as_the_others(project: Path) -> None:
    x = np.linspace(0.0, 90.0, 181)
    line = np.stack([x, 6.0 * np.cos(0.2 * x), 3.0 * np.sin(0.3 * x)], axis=1)
    write_cave(project / "Assets" / "Other.fbx", line)
    other, cave = read_project(project)
    assert other.rewarder is None
    assert other.line[0, 0] < other.line[-1, 0]  # looking along +x, as the original's vehicle starts
    assert np.linalg.norm(other.goal - other.line[-1]) == pytest.approx(3.5, abs=0.6)
    assert np.ptp(other.line, axis=0).max() == pytest.approx(np.ptp(cave.line, axis=0).max(), rel=0.03)
    assert other.placement.radius == pytest.approx(cave.placement.radius, rel=0.03)


def test_models_of_one_name_get_scenarios_of_two(project: Path) -> None:
    write_cave(project / "Assets" / "Some Cave.fbx", winding_line())
    assert sorted(cave.name for cave in read_project(project)) == ["some-cave", "some-cave--2"]


def test_what_is_no_such_project_is_refused_with_advice(project: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="There is no folder"):
        read_project(tmp_path / "nowhere")
    with pytest.raises(InputError, match="no Unity project: it has no folder Assets"):
        read_project(tmp_path)
    for prefab in project.rglob("*.prefab"):
        prefab.unlink()
    with pytest.raises(InputError, match="no prefab with the panels of a DistanceRewarder"):
        read_project(project)


def test_panels_without_a_cave_are_refused(project: Path) -> None:
    for model in project.rglob("*.fbx"):
        model.unlink()
    with pytest.raises(InputError, match="no FBX model of a cave"):
        read_project(project)


def test_panels_of_another_cave_are_refused(project: Path) -> None:
    zigzag = np.array([[0.0, 0.0, 0.0], [10.0, 30.0, 9.0], [20.0, -30.0, -9.0], [30.0, 30.0, 9.0], [40.0, -30.0, 0.0]])
    (project / "Assets" / "Prefabs" / "Panels.prefab").write_text(prefab_of(zigzag))
    with pytest.raises(InputError, match="None of the 1 DistanceRewarders"):
        read_project(project)


def test_an_unknown_cave_gets_the_closest_name(project: Path) -> None:
    with pytest.raises(InputError, match=r"no cave 'some-cove'\. Did you mean 'some-cave'"):
        choose_caves(ImportOptions(project, project, ("some-cove",)))


def test_the_command_lists_caves_without_building_them(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    info.main(["import-original", str(project), "--list"])
    assert "some-cave: Some Cave.fbx with the 6 panels of Panels" in capsys.readouterr().out


def test_the_originals_caves_stand_where_they_were_fitted_by_hand(data_dir: Path) -> None:
    """Truth: the placements in saferlauv/scenes, which another program fitted to panels, starts and goals."""
    caves = {cave.name: cave for cave in read_project(data_dir / "saferlauv_unity")}
    for name, key in (("cave-easy", "easy"), ("cave-eval1", "eval1")):
        scene = json.loads((data_dir / "saferlauv" / "scenes" / f"{key}.json").read_text())
        cave = caves[name]
        middle = np.array(scene["centreline"]["points"])[2:-2]  # the two lines end at different sections
        misses = np.array([np.linalg.norm(cave.line - point, axis=1).min() for point in middle])
        assert np.sqrt((misses**2).mean()) < 0.7  # both are known to 0.5 m
        assert cave.placement.misfit <= scene["placement"]["rms_m"]  # the same panels, fitted at least as well
        assert np.linalg.norm(np.asarray(cave.goal) - scene["goal"]["position"]) < 0.7


def test_every_cave_of_the_original_is_placed(data_dir: Path) -> None:
    caves = read_project(data_dir / "saferlauv_unity")
    models = {path.stem for path in (data_dir / "saferlauv_unity").rglob("Cave_*.fbx")}
    assert {cave.model.stem for cave in caves} == models
