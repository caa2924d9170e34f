"""Scans of which much wall is missing: refused with the place and a picture, and built where that is accepted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.build.cave_stages import build_scenario
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.cave.options import ClosingOptions
from aquanav_tools.types import Mesh, silent
from tests.build.test_scan_build import run
from tests.cave.open_caves import RADIUS, straight
from tests.lighter import lighten_builds

WIDTH = 1.5
"""Of an ellipse over its height. Scanned wall fills 56 % of the view from within its lower half, of a circle's 60 %."""
ARC = 0.5 * 7.9327 * RADIUS
"""Half the circumference of an ellipse with half axes of 1.5 and 1 m, m (by its elliptic integral)."""


@pytest.fixture
def light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare builds that are not refused what is not looked at here."""
    lighten_builds(monkeypatch)


def half_pipe() -> Mesh:
    """A level tube, wider than high, of which the upper half was not scanned."""
    tube = straight()
    return Mesh(tube.vertices * [1.0, WIDTH, 1.0], tube.faces[tube.triangles[:, :, 2].mean(axis=1) < 0.0])


def test_the_refusal_names_side_threshold_way_on_and_a_picture(tmp_path: Path) -> None:
    half_pipe().to_trimesh().export(tmp_path / "half.stl")
    result = run(tmp_path / "half.stl", "-o", tmp_path / "out")
    assert result.returncode == 4
    for part in ("a passage needs 60%", "up 0%", "Of 256 rays", "--accept-open", "Kept in", "faults.png"):
        assert part in result.stderr
    assert (tmp_path / "out" / "faults.png").stat().st_size > 10_000
    assert "towards up: 0% of the view is wall" in (tmp_path / "out" / "report.html").read_text()
    assert "simulation" not in json.loads((tmp_path / "out" / "report.json").read_text())["error"]


@pytest.mark.usefixtures("light")
def test_what_is_accepted_becomes_a_proven_cavity_with_its_unseen_wall_marked(tmp_path: Path) -> None:
    journal = Journal(silent)
    options = BuildOptions(tmp_path / "half.stl", tmp_path / "out", closing=ClosingOptions(accept_open=True))
    built = build_scenario(half_pipe(), options, journal)
    cavity = built.scenario.cavity
    prove_watertight(cavity.mesh)
    half = 0.5 * np.pi * WIDTH * RADIUS**2 * 10.0
    assert half < cavity.volume < 1.5 * half  # the unseen roof is a low vault: no water is taken, and a whole pipe is 2
    assert {"open-walls", "unobserved-wall"} <= {code for code, _ in journal.notices}
    middles, areas = cavity.mesh.triangles.mean(axis=1), cavity.mesh.areas
    is_lid = middles[:, 2] > -0.01 * RADIUS
    assert not cavity.observed[is_lid & (np.abs(middles[:, 1]) < 0.5 * RADIUS)].any()
    # An arc was scanned, its chord was not; a strip on either side of it lies within reach of the scan.
    chord = 2.0 * WIDTH * RADIUS
    assert areas[cavity.observed].sum() / areas.sum() == pytest.approx(ARC / (ARC + chord), abs=0.1)


@pytest.mark.usefixtures("light")
def test_how_much_photos_show_is_told_from_their_cameras_and_what_is_guessed_elsewhere_is_named(tmp_path: Path) -> None:
    tmp_path.joinpath("photos").mkdir()
    journal, options = Journal(silent), BuildOptions(tmp_path / "photos", tmp_path / "out")
    cavity = build_scenario(half_pipe(), options, journal).scenario.cavity
    prove_watertight(cavity.mesh)
    sentence = dict(journal.notices)["guessed-space"]
    assert "towards up: 0% of the view is wall" in sentence
    assert "marked as unobserved" in sentence
