from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from aquanav_tools.cave.options import PanelOptions
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.panels import place_panels
from tests.cave.closed_caves import BRANCH, MAIN, field_of, fork, route_along
from tests.caves import tube_guide
from tests.sim.batch.guides import Tracker, swum


def swim(guide: Guide, points: np.ndarray) -> list[float]:
    progress: list[float] = (guide.length - swum(guide, points)).tolist()
    return progress


def test_progress_in_a_straight_tube_is_the_distance_along_it() -> None:
    points = np.stack([np.linspace(1, 19, 200), np.full(200, 0.7), np.full(200, -0.4)], axis=1)
    assert np.allclose(swim(tube_guide(), points), points[:, 0] - 1.0)


def test_progress_does_not_jump_at_panels_away_from_their_centres() -> None:
    points = np.stack([np.linspace(1, 19, 2000), np.full(2000, 1.5), np.zeros(2000)], axis=1)
    steps = np.diff(swim(tube_guide(), points))
    assert np.allclose(steps, 18.0 / 1999)


def test_swimming_back_takes_back_all_progress() -> None:
    there = np.stack([np.linspace(2, 17, 300)] + [np.zeros(300)] * 2, axis=1)
    progress = swim(tube_guide(), np.concatenate([there, there[::-1]]))
    assert progress[-1] == pytest.approx(progress[0])


def test_progress_is_zero_before_the_first_panel_and_full_after_the_last() -> None:
    guide = tube_guide()
    assert Tracker(guide).remaining(np.array([0.2, 0.0, 0.0]), 0) == guide.length
    assert Tracker(guide).remaining(np.array([19.9, 0.0, 0.0]), guide.num_gates - 1) == 0.0


def test_a_start_is_located_in_the_gate_around_it() -> None:
    guide = tube_guide()
    for gate in range(guide.num_gates):
        middle = 0.5 * (guide.centres[gate] + guide.centres[gate + 1])
        assert guide.locate(middle + [0.0, 0.8, 0.0]) == gate


def test_a_guide_of_one_panel_is_refused() -> None:
    guide = tube_guide()
    with pytest.raises(ValueError, match="at least 2 panels"):
        Guide(guide.centreline, guide.panels[:1])


def test_a_vehicle_that_takes_another_way_is_found_again_where_it_comes_back() -> None:
    guide = tube_guide()
    corners = np.array([[3.0, 0, 0], [4.0, 0, 0], [4.0, 8, 0], [14.5, 8, 0], [14.5, 0, 0], [18.9, 0, 0]])
    points = np.concatenate([np.linspace(a, b, 100) for a, b in pairwise(corners)])
    progress = np.array(swim(guide, points))
    is_back = (points[:, 0] > 14.8) & (points[:, 1] == 0.0)  # a panel stands at x = 15
    assert np.allclose(progress[is_back], points[is_back, 0] - 1.0)


def test_a_dead_end_is_located_where_it_leaves_the_route_and_not_where_it_runs_beside_it() -> None:
    cave = fork()
    field = field_of(cave)
    guide = place_panels(cave, field, route_along(MAIN, field), 0.5, PanelOptions())
    for position in BRANCH[30::10]:
        gate = guide.locate(position, field)
        # The mouth of the branch reaches from x = 4 to x = 6; the guide begins at x = 0.5, gates are up to 2 m long.
        assert guide.arc_lengths[gate] <= 5.5 <= guide.arc_lengths[gate + 1] + 1.0
        assert guide.arc_lengths[gate] >= 2.0
    way_out = np.concatenate([BRANCH[::-1], MAIN[MAIN[:, 0] > 5.0]])
    gate = guide.locate(way_out[0], field)
    assert swum(guide, way_out, gate)[-1] == 0.0
