"""`from aquanav_tools.cave import ...` is quick, and what it measures is what formulas say."""

from __future__ import annotations

import importlib.util
import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import aquanav_tools.cave as cave
from aquanav_tools.cave import centreline, close, largest_vehicle, read_scan, sections, write
from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.errors import AquanavError, InputError, MeshError
from aquanav_tools.synthetic.caves import tube
from tests.test_imports import HEAVY

RADIUS, LENGTH, CORNERS = 1.0, 8.0, 48
INNER = RADIUS * np.cos(np.pi / CORNERS)
"""Of the circle in the tube's polygon: the largest sphere inside, m."""
POLYGON = 0.5 * CORNERS * RADIUS**2 * np.sin(2.0 * np.pi / CORNERS)
"""Its area, m^2."""


@pytest.fixture(scope="module")
def water(tmp_path_factory: pytest.TempPathFactory) -> Cavity:
    path = tmp_path_factory.mktemp("scan") / "tube.stl"
    tube(RADIUS, LENGTH, CORNERS, 33).mesh.to_trimesh().apply_scale(100.0).export(path)
    scan = read_scan(path, unit="cm", up="z")
    assert scan.normals is None and scan.faces is not None
    return close(scan.points, scan.faces)


def test_importing_the_functions_loads_no_heavy_library() -> None:
    code = f"import sys, aquanav_tools.cave as c; dir(c); print(*set({sorted(HEAVY)}) & sys.modules.keys())"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split() == []


def test_centreline_stays_a_function_when_the_package_of_its_name_is_imported() -> None:
    code = (
        "import aquanav_tools.cave.centreline.graph, inspect; from aquanav_tools.cave import centreline;"
        " import aquanav_tools.cave as c; print(inspect.isfunction(centreline), inspect.isfunction(c.centreline))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


@pytest.mark.parametrize("name", cave.__all__)
def test_the_docstring_tells_of_each_parameter_and_of_errors(name: str) -> None:
    function = getattr(cave, name)
    documentation = inspect.getdoc(function) or ""
    assert "Raises:" in documentation and "Return" in documentation
    for parameter in inspect.signature(function).parameters:
        assert f"{parameter}: " in documentation


def test_an_open_tube_is_closed_at_its_ends_and_has_the_volume_of_its_prism(water: Cavity) -> None:
    assert water.volume == pytest.approx(POLYGON * LENGTH, rel=1e-3)  # portals lie up to a millimetre from the rim
    centres = np.array(sorted(portal.centre.tolist() for portal in water.portals))
    assert np.abs(centres - [[0.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]]).max() < 0.01
    assert [portal.area for portal in water.portals] == pytest.approx([POLYGON] * 2, rel=1e-3)


def test_points_without_triangles_are_closed_too(rng: np.random.Generator) -> None:
    if importlib.util.find_spec("open3d") is None:
        pytest.skip("needs open3d, which is not installed")
    angle, along = rng.uniform(0.0, 2.0 * np.pi, 20_000), rng.uniform(0.0, LENGTH, 20_000)
    points = np.stack([along, RADIUS * np.cos(angle), RADIUS * np.sin(angle)], axis=1)
    found = close(points)
    # The cells have 4 to 9 cm, of which a surface may be off by a tenth, and each end by one.
    assert found.volume == pytest.approx(np.pi * RADIUS**2 * LENGTH, rel=0.05)
    assert len(found.portals) == 2


def test_lrud_and_sections_of_a_tube_are_those_of_its_polygon(water: Cavity) -> None:
    line = np.array([[0.0, 0.2, -0.1], [LENGTH, 0.2, -0.1]])
    found = sections(water, line, 0.999)  # its ends lie on the portals, as those of a centreline do
    assert [one.arc_length for one in found] == pytest.approx(0.999 * np.arange(9))
    for one in found:
        assert one.area == pytest.approx(POLYGON, rel=1e-4)
        reach = np.sqrt(RADIUS**2 - 0.1**2), np.sqrt(RADIUS**2 - 0.2**2)
        told = (one.left + 0.2, one.right - 0.2, one.up - 0.1, one.down + 0.1)
        assert told == pytest.approx(
            (reach[0], reach[0], reach[1], reach[1]), abs=(RADIUS - INNER) / np.sqrt(1.0 - 0.2**2) + 1e-6
        )


def test_the_centreline_runs_from_portal_to_portal_through_the_middle(water: Cavity) -> None:
    graph = centreline(water)
    assert graph.length == pytest.approx(LENGTH, rel=0.01)
    path = graph.path(*(portal.centre for portal in water.portals))
    assert path is not None
    assert np.abs(path.points[:, 1:]).max() < 0.06  # a sample: a sixth of 0.35 m


def test_the_largest_vehicle_is_the_circle_in_the_polygon(water: Cavity) -> None:
    line = np.array([water.portals[0].centre, [4.0, 0.1, 0.0], water.portals[1].centre])
    assert largest_vehicle(water, line) == pytest.approx(2.0 * INNER, rel=0.01)


@pytest.mark.parametrize("ending", ["ply", "obj", "stl", "off", "glb"])
def test_a_written_file_holds_the_same_closed_surface(water: Cavity, tmp_path: Path, ending: str) -> None:
    path = write(water, tmp_path / f"closed.{ending}")
    found = trimesh.load(path, force="mesh", process=False)
    found.merge_vertices()
    assert found.is_watertight and found.volume == pytest.approx(water.volume, rel=1e-6)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


SQUARE: Any = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
WRONG: list[tuple[tuple[Any, ...], dict[str, Any], str]] = [
    (([[0, 0]],), {}, r"points has shape \(1, 2\); it must be \(N, 3\)"),
    (([[0, 0, "a"]],), {}, "points is no array of numbers"),
    ((np.full((5, 3), np.nan),), {}, "points holds 15 numbers that are not finite"),
    ((np.zeros((3, 3)),), {}, "points has 3 rows; a surface needs at least 4"),
    ((SQUARE, [[0, 1, 4]]), {}, "faces names other than the 4 points"),
    ((SQUARE, [[0.0, 1.0, 2.0]]), {}, "it must be .F, 3. whole numbers"),
    ((SQUARE,), {"normals": [[0, 0, 1]]}, "There are 1 normals for 4 points"),
    ((SQUARE, [[0, 1, 2]]), {"cuts": [[0, 0, 0, 0, 0, 0]]}, "has no direction"),
    ((SQUARE, [[0, 1, 2]]), {"narrowest": 0.0}, "narrowest is 0.0; it must be a positive number"),
]


@pytest.mark.parametrize(("arguments", "options", "sentence"), WRONG)
def test_senseless_arrays_are_told_in_a_sentence(
    arguments: tuple[Any, ...], options: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        close(*arguments, **options)


def test_other_wrong_arguments_are_told_in_a_sentence(water: Cavity, tmp_path: Path) -> None:
    wrong: list[tuple[Any, type[AquanavError], str]] = [
        (lambda: read_scan(tmp_path / "none.ply"), InputError, "There is no file"),
        (lambda: write(water, tmp_path / "closed.doc"), InputError, "ends in none of .glb"),
        (lambda: write(water, tmp_path / "no" / "closed.ply"), InputError, "There is no folder"),
        (lambda: sections(water, [[1.0, 0.0, 0.0]], 1.0), InputError, "1 points in one place"),
        (lambda: sections(water, np.eye(3), 0.0), InputError, "spacing is 0.0"),
        (lambda: largest_vehicle(water, []), InputError, "0 points in one place"),
        (lambda: close(SQUARE, [[0, 1, 2]]), AquanavError, "."),
    ]
    for call, error, sentence in wrong:
        with pytest.raises(error, match=sentence):
            call()
    apart = Cavity(*_two_boxes())
    with pytest.raises(MeshError, match="No water joins"):
        largest_vehicle(apart, [[0.0, 0, 0], [5.0, 0, 0]])


def _two_boxes() -> tuple[Any, ...]:
    from aquanav_tools.types import Mesh

    both = trimesh.util.concatenate([trimesh.creation.box((2, 2, 2)).apply_translation((x, 0, 0)) for x in (0.0, 5.0)])
    faces = np.array(both.faces, dtype=np.int64)
    return Mesh(np.array(both.vertices), faces), np.zeros(len(faces), dtype=np.int64), np.ones(len(faces), bool), ()
