"""The wall coloured by the photos that show it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.cave.cavity import WALL
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.photos.coverage_sheet import COLOURS, GUESSED, LID, draw_coverage, paint
from aquanav_tools.scenario.schema import Scenario


@pytest.fixture(scope="module")
def cave(tube: Scenario) -> CaveMap:
    return CaveMap("tube", tube.cavity, tube.guide.centreline, ())


@pytest.mark.parametrize(("count", "colour"), [(0, 0), (1, 1), (2, 2), (4, 3), (5, 4), (8, 4), (9, 5), (200, 5)])
def test_seen_wall_has_the_colour_of_its_count(cave: CaveMap, count: int, colour: int) -> None:
    colours = paint(cave, np.full(len(cave.cavity.labels), count))
    np.testing.assert_array_equal(colours[cave.cavity.labels == WALL], np.broadcast_to(COLOURS[colour], (128, 3)))
    assert (colours[cave.cavity.labels != WALL] == LID).all()


def test_wall_that_is_in_photos_but_was_not_measured_is_violet(cave: CaveMap) -> None:
    blind = replace(cave, cavity=replace(cave.cavity, observed=np.zeros_like(cave.cavity.observed)))
    assert (paint(blind, np.full(len(blind.cavity.labels), 3))[blind.cavity.labels == WALL] == GUESSED).all()


def test_an_unseen_floor_is_red_from_above_and_the_ceiling_is_not(cave: CaveMap, tmp_path: Path) -> None:
    is_floor = cave.cavity.mesh.triangles.mean(axis=1)[:, 2] < 0.0
    draw_coverage(cave, np.where(is_floor, 0, 20), (), tmp_path / "coverage.png")
    picture = np.asarray(Image.open(tmp_path / "coverage.png").convert("RGB"), float) / 255.0
    is_red = (picture[..., 0] > 0.5) & (picture[..., 1] < 0.35)
    is_blue = (picture[..., 0] < 0.2) & (picture[..., 2] > 0.3)
    quarters = np.linspace(0, len(picture) - 90, 5).astype(int)  # four views of one height above the key
    red, blue = (np.array([mask[a:b].sum() for a, b in itertools.pairwise(quarters)]) for mask in (is_red, is_blue))
    assert red[0] > 50 * max(red[1], 1)
    assert blue[1] > 50 * max(blue[0], 1)
    assert (red[2:] / blue[2:] > 0.5).all()  # either side shows half of both
    assert (red[2:] / blue[2:] < 2.0).all()
