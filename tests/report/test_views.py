from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.measure.sections import cross_sections
from aquanav_tools.report.cave_map import CaveMap, Mark
from aquanav_tools.report.faults import MAX_LISTED, draw_faults
from aquanav_tools.report.views import FILLED, LID, ROCK, draw_views, paint
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Mesh


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aquanav_tools.report.views.DPI", 50)
    monkeypatch.setattr("aquanav_tools.report.faults.DPI", 50)


def read(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB")).astype(float) / 255.0


def share_of_hue(pixels: np.ndarray, colour: np.ndarray) -> float:
    """Share of pixels that are the colour in some light."""
    brightness = pixels.max(axis=-1, keepdims=True)
    hue = pixels / np.maximum(brightness, 1e-6)
    return float(((np.abs(hue - colour / colour.max()).max(axis=-1) < 0.08) & (brightness[..., 0] > 0.15)).mean())


def half_seen(tube: Scenario) -> CaveMap:
    """The tube, of which the scan saw the upper half."""
    cavity = tube.cavity
    is_upper = cavity.mesh.triangles[..., 2].mean(axis=1) > 0.0
    seen = Cavity(cavity.mesh, cavity.labels, cavity.observed & is_upper, cavity.portals)
    line = tube.guide.centreline
    return CaveMap("Tube", seen, line, cross_sections(seen, line, 2.0), (Mark(line[90], "0.40 m", 0.4),))


def test_every_face_has_the_colour_of_what_it_is(tube: Scenario) -> None:
    cave = half_seen(tube)
    colours = paint(cave.cavity)
    assert (colours[cave.cavity.labels > 0] == LID).all()
    assert (colours[cave.cavity.observed] == ROCK).all()
    assert (colours[~cave.cavity.observed & (cave.cavity.labels == 0)] == FILLED).all()


def test_views_show_seen_and_unseen_wall_and_portals(tube: Scenario, tmp_path: Path) -> None:
    outlines = tuple(panel.polygon for panel in tube.guide.panels)
    draw_views(half_seen(tube), outlines, tmp_path / "views.png")
    pixels = read(tmp_path / "views.png")
    assert share_of_hue(pixels, ROCK) > 0.02
    assert share_of_hue(pixels, FILLED) > 0.02
    draw_views(half_seen(tube), outlines, tmp_path / "again.png")
    assert (tmp_path / "views.png").read_bytes() == (tmp_path / "again.png").read_bytes()


def test_faults_are_marked_in_every_view(tmp_path: Path) -> None:
    solid = trimesh.creation.box((10.0, 4.0, 3.0))
    surface = Mesh(np.array(solid.vertices), np.array(solid.faces)[:-2])
    points = np.array([[-4.0, 1.0, 1.0], [4.0, -1.0, -1.0]])
    draw_faults(surface, points, ("hole, 0.42 m wide", "open edge"), tmp_path / "faults.png")
    draw_faults(surface, np.empty((0, 3)), (), tmp_path / "none.png")
    red = np.abs(read(tmp_path / "faults.png") - np.array([229, 56, 59]) / 255.0).max(axis=-1) < 0.1
    rows = np.flatnonzero(red.any(axis=1))
    assert np.count_nonzero(np.diff(rows) > 8) >= 2  # three groups of rows: three views
    nothing = np.abs(read(tmp_path / "none.png") - np.array([229, 56, 59]) / 255.0).max(axis=-1) < 0.1
    assert not nothing.any()


def test_more_faults_than_can_be_listed_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = []
    monkeypatch.setattr("aquanav_tools.report.faults.save_figure", lambda figure, *_: figures.append(figure))
    solid = trimesh.creation.box((10.0, 4.0, 3.0))
    points = np.linspace([-4.0, 0, 0], [4.0, 0, 0], MAX_LISTED + 7)
    draw_faults(
        Mesh(np.array(solid.vertices), np.array(solid.faces)), points, ["hole"] * len(points), tmp_path / "a.png"
    )
    texts = [text.get_text() for text in figures[0].texts]
    assert texts[0] == f"{MAX_LISTED + 7} places"
    assert any("and 7 more" in text for text in texts)
    assert "  1   (-4.00, 0.00, 0.00) m   hole" in texts


def test_every_fault_has_a_label(tmp_path: Path) -> None:
    solid = trimesh.creation.box()
    mesh = Mesh(np.array(solid.vertices), np.array(solid.faces))
    with pytest.raises(ValueError, match="2 faults have 1 labels"):
        draw_faults(mesh, np.zeros((2, 3)), ("hole",), tmp_path / "a.png")
