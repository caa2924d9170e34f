from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.report.relief import LIGHT, View, _rasterised, cut_away, plan_and_section
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Mesh
from tests.caves import TUBE_LENGTH, TUBE_RADIUS

X, Y, Z = np.eye(3)


def turned_about_z(points: np.ndarray, angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])


def test_plan_looks_down_and_section_looks_from_below_the_plan() -> None:
    plan, section = plan_and_section(np.array([[0.0, 0, 0], [10.0, 0, 1]]))
    np.testing.assert_allclose([plan.right, plan.up, plan.towards], [X, Y, Z], atol=1e-12)
    np.testing.assert_allclose([section.right, section.up, section.towards], [X, Z, -Y], atol=1e-12)


@pytest.mark.parametrize("angle", [0.3, 2.0, 4.0])
def test_views_turn_with_the_cave_and_the_goal_stays_right(angle: float) -> None:
    line = np.array([[0.0, 0, 0], [4.0, 1, 1], [10.0, 0, 1]])
    plan, section = plan_and_section(line)
    turned_plan, turned_section = plan_and_section(turned_about_z(line, angle))
    np.testing.assert_allclose(turned_plan.right, turned_about_z(plan.right, angle), atol=1e-12)
    np.testing.assert_allclose(turned_section.towards, turned_about_z(section.towards, angle), atol=1e-12)
    assert (turned_plan.project(turned_about_z(line, angle))[-1, 0]) > 0.0


def test_view_from_above_into_the_tube_sees_its_floor(tube: Scenario) -> None:
    view = View(X, Y)
    low, pixel = np.array([0.0, -TUBE_RADIUS]), 0.1
    heights, light = _rasterised(tube.cavity.mesh, view, low, pixel, (200, 40))
    across = low[1] + pixel * (np.arange(40)[::-1] + 0.5)
    floor = -np.sqrt(TUBE_RADIUS**2 - across**2)
    # The 64-sided polygon lies up to R (1 - cos(pi / 64)) = 2.4 mm inside its circle, more where the wall is steep.
    np.testing.assert_allclose(heights[8:32, 100], floor[8:32], atol=0.005)
    inward = -np.stack([np.zeros(40), across, floor], axis=1) / TUBE_RADIUS
    lambert = np.clip(inward @ LIGHT / np.linalg.norm(LIGHT), 0.0, 1.0)
    np.testing.assert_allclose(light[8:32, 100], lambert[8:32], atol=0.05)  # facets are up to 2.8 degrees off


def test_relief_covers_the_tubes_outline_and_nothing_else(tube: Scenario) -> None:
    relief = cut_away(tube.cavity.mesh, View(X, Z), pixel=0.02)
    assert relief.width == pytest.approx(TUBE_LENGTH, abs=0.12)  # two pixels of margin on each side, rounded up
    covered = relief.colours[..., 3].mean() * relief.width * relief.height
    assert covered == pytest.approx(TUBE_LENGTH * 2 * TUBE_RADIUS, rel=0.01)


def test_number_of_pixels_is_bounded(tube: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aquanav_tools.report.relief.MAX_PIXELS", 10_000)
    assert np.prod(cut_away(tube.cavity.mesh, View(X, Y), pixel=1e-6).colours.shape[:2]) < 10_600


def test_moving_the_cave_changes_nothing_but_the_extent(tube: Scenario) -> None:
    mesh = tube.cavity.mesh
    moved = Mesh(mesh.vertices + [0.0, 0.0, 64.0], mesh.faces)
    # Turned, since the rank of a whole row of pixels on one height would be a matter of rounding.
    view = View(turned_about_z(X, 0.3), turned_about_z(Y, 0.3))
    first, second = (cut_away(m, view, pixel=0.1) for m in (mesh, moved))
    np.testing.assert_allclose(first.colours, second.colours, atol=1e-6)
