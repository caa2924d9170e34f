"""The corpus' judge sees what it has to see, on a tube with known answers."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.cavity import WALL, Cavity, Portal, from_manifold, to_manifold
from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.synthetic import damage
from aquanav_tools.synthetic.damage import Truth
from aquanav_tools.types import Mesh
from eval.child import run_child
from eval.corpus.bad_inputs import bad_inputs
from eval.corpus.cases import generated_cases
from eval.corpus.files import read_truth, write_case
from eval.corpus.held_out import held_out_cases, known
from eval.corpus.judge import compare
from eval.corpus.networks import network_cases
from eval.corpus.run import faults, outcome, sentence
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_cavity

NOWHERE = np.zeros(3)


def _truth() -> Truth:
    """The tests' tube, 1 m longer at either end, with its axis."""
    axis = np.array([[-1.0, 0.0, 0.0], [TUBE_LENGTH + 1.0, 0.0, 0.0]])
    tube = tube_cavity().mesh
    x = tube.vertices[:, 0]
    longer = tube.vertices.copy()
    longer[:, 0] = np.where(x < 1e-6, -1.0, np.where(x > TUBE_LENGTH - 1e-6, TUBE_LENGTH + 1.0, x))
    return Truth(Mesh(longer, tube.faces), (axis,), num_portals=2, genus=0)


def _solid_cavity(solid: object) -> Cavity:
    mesh = from_manifold(solid)
    num = len(mesh.faces)
    return Cavity(mesh, np.full(num, WALL), np.ones(num, dtype=bool), tube_cavity().portals)


def _box(low: list[float], high: list[float]) -> object:
    import manifold3d

    size = np.subtract(high, low)
    return manifold3d.Manifold.cube(tuple(size)).translate(tuple(low))


def test_a_perfect_build_has_no_error_between_its_portals() -> None:
    found = compare(tube_cavity(), _truth(), NOWHERE, margin=0.1)
    assert found["volume_error"] == pytest.approx(0.0, abs=2e-4)  # the portals' walls take 2 mm of 20 m
    assert (found["path_points_in_rock"], found["path_segments_blocked"]) == (0, 0)
    assert found["covered"] == pytest.approx(TUBE_LENGTH / (TUBE_LENGTH + 2.0), abs=0.01)  # one step of 5 cm


def test_a_moved_scan_is_compared_where_it_is() -> None:
    shift = np.array([7.0, -3.0, 2.0])
    tube = tube_cavity()
    portals = tuple(dataclasses.replace(lid, centre=lid.centre + shift) for lid in tube.portals)
    moved = dataclasses.replace(tube, mesh=Mesh(tube.mesh.vertices + shift, tube.mesh.faces), portals=portals)
    assert compare(moved, _truth(), shift, margin=0.1)["volume_error"] == pytest.approx(0.0, abs=2e-4)


def test_a_wall_across_the_passage_is_seen() -> None:
    solid = to_manifold(tube_cavity().mesh) - _box([9.9, -1.9, -1.9], [10.1, 1.9, 1.9])
    found = compare(_solid_cavity(solid), _truth(), NOWHERE, margin=0.1)
    assert found["path_points_in_rock"] > 0 and found["path_segments_blocked"] > 0


def test_a_wall_thinner_than_the_steps_is_seen() -> None:
    solid = to_manifold(tube_cavity().mesh) - _box([10.01, -1.9, -1.9], [10.02, 1.9, 1.9])
    assert compare(_solid_cavity(solid), _truth(), NOWHERE, margin=0.1)["path_segments_blocked"] > 0


def test_lost_water_is_seen() -> None:
    solid = to_manifold(tube_cavity().mesh) - _box([5.0, -3.0, 1.0], [15.0, 3.0, 3.0])
    angle = 2.0 * np.arccos(1.0 / TUBE_RADIUS)
    lost = 10.0 * 0.5 * TUBE_RADIUS**2 * (angle - np.sin(angle)) / (np.pi * TUBE_RADIUS**2 * TUBE_LENGTH)
    found = compare(_solid_cavity(solid), _truth(), NOWHERE, margin=0.1)
    assert found["volume_error"] == pytest.approx(-lost, abs=2e-3)  # a polygon of 64 sides has 0.2 % less


def test_a_portal_in_the_middle_of_the_passage_shows_as_lost_way() -> None:
    half = to_manifold(tube_cavity().mesh) - _box([10.0, -3.0, -3.0], [25.0, 3.0, 3.0])
    east = np.array([1.0, 0.0, 0.0])
    portals = (tube_cavity().portals[0], Portal(2, 10.0 * east, east, np.pi * TUBE_RADIUS**2))
    cavity = dataclasses.replace(_solid_cavity(half), portals=portals)
    assert compare(cavity, _truth(), NOWHERE, margin=0.1)["covered"] == pytest.approx(10.0 / 22.0, abs=0.01)


def test_a_case_comes_back_from_its_files(tmp_path: Path) -> None:
    from aquanav_tools.cave.options import ScanOptions
    from aquanav_tools.cave.scan.read import read_scan

    scan = damage.intact(synthetic.tube(1.0, 5.0, 24, 21))
    cloud = damage.move_away(damage.sample_cloud(scan, 0.2, "true", seed=1), (5.0, 6.0, 7.0))
    for case in (scan, cloud):
        read = read_scan(write_case(case, tmp_path), ScanOptions()).surface
        truth, offset = read_truth(tmp_path)
        points = read.vertices if isinstance(read, Mesh) else read.points
        expected = case.surface.vertices if isinstance(case.surface, Mesh) else case.surface.points
        assert np.allclose(points, expected, atol=1e-9)
        assert (read.normals is not None) if not isinstance(read, Mesh) else (len(read.faces) == len(scan.mesh.faces))
        assert truth.solid is not None and len(truth.solid.faces) == len(scan.truth.solid.faces)  # type: ignore[union-attr]
        assert np.array_equal(truth.paths[0], scan.truth.paths[0]) and np.array_equal(offset, case.offset)


def test_the_corpus_is_large_and_names_each_case_once() -> None:
    names = [case.name for case in (*generated_cases(), *network_cases())]
    assert len(names) >= 60 and len(set(names)) == len(names)
    assert 10 <= sum(case.is_quick for case in generated_cases()) <= 20
    assert all(re.compile(bad.error) for bad in bad_inputs())


def test_the_corpus_to_judge_by_has_caves_and_seeds_of_its_own() -> None:
    cases = held_out_cases()
    assert len(cases) >= 100
    assert len({case.name for case in cases}) == len(cases)
    assert not {case.name for case in cases} & {case.name for case in (*generated_cases(), *network_cases())}
    scan = known("mine-drift")
    assert scan.truth.num_portals == 2
    assert scan.truth.solid is not None
    solid = scan.truth.solid.to_trimesh()
    assert solid.is_watertight
    (path,) = scan.truth.paths
    assert solid.contains(path[5:-5:20]).mean() > 0.9  # blocks may lie on the axis
    assert not scan.mesh.to_trimesh().is_watertight  # open at both ends


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("import sys; sys.exit('error: it is flat. Scan more.')", "crash"),  # exit code 1 is nobody's sentence
        ("import sys; print('error: it is flat. Scan more.', file=sys.stderr); sys.exit(4)", "error"),
        ("raise ValueError('bug')", "crash"),
        ("import os; os.abort()", "crash"),
        ("print('Built.')", "proven"),
    ],
)
def test_how_a_child_ends_is_told_apart(code: str, expected: str) -> None:
    import sys

    ended = run_child([sys.executable, "-c", code], timeout=60.0)
    assert outcome(ended) == expected
    if expected == "error":
        assert sentence(ended) == "error: it is flat. Scan more."


def test_a_child_that_takes_too_long_is_ended() -> None:
    import sys

    ended = run_child([sys.executable, "-c", "import time; time.sleep(60)"], timeout=0.5)
    assert outcome(ended) == "timeout" and ended.seconds < 30.0


def test_a_wrong_sentence_is_a_fault() -> None:
    result = {"outcome": "error", "error": "unit", "sentence": "error: It is flat."}
    assert faults(result) == ["should stop with a sentence about unit"]
    assert faults({**result, "sentence": "error: Are these millimetres? Check --unit."}) == []
