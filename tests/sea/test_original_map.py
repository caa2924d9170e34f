"""The original's bays against numbers that were measured on its builds."""

from __future__ import annotations

import json
from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh

from aquanav_tools.errors import InputError
from aquanav_tools.sea.original import read_original_map

CLEARANCE = 1.545
SCENES = ("train", "eval1")


@pytest.mark.parametrize("name", SCENES)
def test_rocks_are_those_of_the_build(data_dir: Path, name: str) -> None:
    scene = data_dir / "saferlauv" / "surface" / f"{name}.json"
    table = json.loads(scene.read_text())
    sea = read_original_map(scene, CLEARANCE)
    solids = [rock.solid for rock in sea.rocks if rock.solid is not None]
    corners = np.concatenate([solid.vertices for solid in solids])
    level = float(np.median([start["position"][2] for start in table["starts"]]))
    bounds = np.stack([corners.min(axis=0), corners.max(axis=0)]) + [0.0, 0.0, level]
    np.testing.assert_allclose(bounds, table["rock_bounds"], atol=0.006)  # the file's two decimals
    assert len(solids) == len(table["rocks"])
    whole = trimesh.load(scene.with_name(f"{name}_rocks.obj"), process=False)
    assert sum(solid.volume for solid in solids) == pytest.approx(whole.volume)
    for rock in sea.rocks:
        if rock.solid is not None:
            on_level = np.column_stack([rock.outline, np.zeros(len(rock.outline))])
            squares = igl.point_mesh_squared_distance(on_level, rock.solid.vertices, rock.solid.faces)[0]
            assert squares.max() < 1e-12


@pytest.mark.parametrize("name", SCENES)
def test_every_start_has_a_way_to_the_goals_line(data_dir: Path, name: str) -> None:
    scene = data_dir / "saferlauv" / "surface" / f"{name}.json"
    table = json.loads(scene.read_text())
    sea = read_original_map(scene, CLEARANCE)
    assert len(sea.paths) == len(table["starts"])
    for start, way in zip(table["starts"], sea.paths, strict=True):
        from_start = np.array(table["goal"]["center"][:2]) - start["position"][:2]
        axis = np.array(table["goal"]["axes_columns"])[:2, 2]  # across the line
        least = abs(from_start @ axis) - table["goal"]["half_extents"][2]
        assert least - 1e-6 <= way.length < 1.2 * np.hypot(*from_start)


def test_a_file_that_is_no_scene_is_refused(tmp_path: Path) -> None:
    (tmp_path / "train.json").write_text("{}")
    (tmp_path / "train_rocks.obj").write_text("v 0 0 0\n")
    with pytest.raises(InputError, match="no surface scene"):
        read_original_map(tmp_path / "train.json", 1.0)
    with pytest.raises(InputError, match="cannot be read"):
        read_original_map(tmp_path / "absent.json", 1.0)


def upright_box(name: str, centre: list[float], half_extents: list[float]) -> dict[str, object]:
    return {"name": name, "center": centre, "half_extents": half_extents, "axes_columns": np.eye(3).tolist()}


def write_scene(folder: Path, boxes: list[dict[str, object]]) -> Path:
    """A bed of 100 x 60 m at -10 m, water at 0 m, one rock of 4 x 4 m in the middle, a way from left to right."""
    rock = trimesh.creation.box((4.0, 4.0, 12.0))
    lines = [f"v {x} {y} {z}" for x, y, z in rock.vertices] + [f"f {a} {b} {c}" for a, b, c in rock.faces + 1]
    (folder / "made_up_rocks.obj").write_text("\n".join(lines))
    table = {
        "key": "made-up",
        "source": "a test",
        "boxes": [upright_box("Floor", [0.0, 0.0, -12.0], [50.0, 30.0, 2.0]), *boxes],
        "starts": [{"position": [-40.0, 0.0, 0.0], "yaw_deg": 0.0}],
        "goal": upright_box("TargetPoint", [40.0, 0.0, 0.0], [0.5, 20.0, 5.0]),
    }
    scene = folder / "made_up.json"
    scene.write_text(json.dumps(table))
    return scene


def test_walls_of_the_same_name_are_all_there(tmp_path: Path) -> None:
    walls = [upright_box("Walls", [-10.0, y, 0.0], [1.0, 10.0, 5.0]) for y in (-20.0, 20.0)]
    sea = read_original_map(write_scene(tmp_path, walls), CLEARANCE)
    assert len(sea.rocks) == 3
    for y in (-20.0, 20.0):
        assert sea.clearance_at(np.array([-13.0, y])) == pytest.approx(2.0)


@pytest.mark.parametrize("line", ["f 1 2 99", "f 1 2 -4294967295", "v 2.0 2.0 x", "v 2.0 2.0"])
def test_rocks_that_are_damaged_are_refused(tmp_path: Path, line: str) -> None:
    scene = write_scene(tmp_path, [])
    rocks = tmp_path / "made_up_rocks.obj"
    lines = rocks.read_text().splitlines()
    first = next(number for number, old in enumerate(lines) if old[0] == line[0])
    rocks.write_text("\n".join([*lines[:first], line, *lines[first + 1 :]]))
    with pytest.raises(InputError, match="with its rocks is no surface scene"):
        read_original_map(scene, CLEARANCE)


def test_a_wall_without_extent_is_refused(tmp_path: Path) -> None:
    scene = write_scene(tmp_path, [upright_box("Walls", [0.0, 20.0, 0.0], [1.0, 0.0, 5.0])])
    with pytest.raises(InputError, match="a box has no extent in x or y"):
        read_original_map(scene, CLEARANCE)


def test_a_scene_with_two_sea_beds_is_refused(tmp_path: Path) -> None:
    scene = write_scene(tmp_path, [upright_box("Floor", [0.0, 0.0, -14.0], [50.0, 30.0, 2.0])])
    with pytest.raises(InputError, match="2 boxes named Floor"):
        read_original_map(scene, CLEARANCE)
