"""Progress along the guide on shapes whose lengths are known: no jumps, right in dead ends, loops and beside rock."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import manifold3d
import numpy as np
import pytest

from aquanav_tools.cave.cavity import Cavity, from_manifold, to_manifold
from aquanav_tools.cave.options import PanelOptions
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.panels import place_panels
from aquanav_tools.types import Array
from tests.cave.closed_caves import closed, field_of, joined, route_along, swept, walk
from tests.cave.roaming import FINEST, MOVE, ROOM, largest_change
from tests.sim.batch.guides import Tracker

INSET = 0.6


def guide_of(cave: Cavity, line: Array) -> Guide:
    field = field_of(cave, 0.3)
    return place_panels(cave, field, route_along(line, field), INSET, PanelOptions(), 0.25)


def fine(line: Array) -> Array:
    """The points of a polyline MOVE apart."""
    walked = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    return np.stack([np.interp(np.arange(0, walked[-1], MOVE), walked, line[:, axis]) for axis in range(3)], axis=1)


def swim(guide: Guide, points: Array, gate: int | None = None) -> Array:
    """The metres to go all along some points."""
    tracker = Tracker(guide)
    gates, remaining = tracker.follow(points, guide.locate(points[0]) if gate is None else gate)
    assert remaining[-1] == tracker.remaining(points[-1], int(gates[-1]))
    return remaining


ARC = np.stack([3 * np.sin(t := np.linspace(0, np.pi / 2, 60)), 3 - 3 * np.cos(t), 0 * t], axis=1)
"""A quarter of a circle of 3 m about (0, 3)."""
BEND = np.concatenate([[[-6.0, 0, 0]], ARC, [[3.0, 9.0, 0]]])
TURN = np.linspace(0.0, 4 * np.pi, 400)
HELIX = np.stack([3 * np.cos(TURN), 3 * np.sin(TURN), 0.5 * TURN], axis=1)
TUBE = walk((0, 0, 0), (14, 0, 0))
LENGTHS = {
    "tube": (TUBE, 14.0),
    "bend": (BEND, 12.0 + 1.5 * np.pi),
    "helix": (HELIX, 4 * np.pi * np.sqrt(9.25)),
}


@cache
def guide_in(shape: str) -> Guide:
    line = LENGTHS[shape][0]
    return guide_of(swept(line, 1.0), line)


@pytest.mark.parametrize("shape", LENGTHS)
def test_the_guide_is_as_long_as_the_passage_without_its_ends(shape: str) -> None:
    # both insets are rounded to the route's points, 0.1 m apart; chords of the helix are 1e-4 shorter
    assert guide_in(shape).length == pytest.approx(LENGTHS[shape][1] - 2 * INSET, abs=0.1)


@pytest.mark.parametrize("shape", LENGTHS)
def test_on_the_route_a_centimetre_is_a_centimetre(shape: str) -> None:
    guide = guide_in(shape)
    steps = -np.diff(swim(guide, fine(guide.centreline)))
    # Panels cut the angle evenly; what is left is a sixteenth of a gate's own unevenness where bends begin.
    assert steps.min() > 0.98 * MOVE
    assert steps.max() < 1.02 * MOVE


@pytest.mark.parametrize("aside", [-0.7, 0.7])
def test_off_the_axis_of_a_bend_progress_goes_by_the_angle_and_never_jumps(aside: float) -> None:
    guide = guide_in("bend")
    angle = np.linspace(np.deg2rad(10), np.deg2rad(80), 2000)
    radius = 3.0 - aside
    points = np.stack([radius * np.sin(angle), 3 - radius * np.cos(angle), np.full(2000, 0.3)], axis=1)
    remaining = swim(guide, points)
    # Round the middle of the bend the same angle is the same way to go as on the axis.
    assert remaining[0] - remaining[-1] == pytest.approx(3 * np.deg2rad(70), abs=0.05)
    moves = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert (-np.diff(remaining) / moves).max() < 1.05 * 3.0 / radius
    assert np.diff(remaining).max() <= 0.0


def test_in_a_tube_no_move_changes_the_way_by_more_than_its_length(rng: np.random.Generator) -> None:
    guide = guide_in("tube")
    for _ in range(20):
        ends = np.stack([rng.uniform(0.6, 13.4, 2), *(rng.uniform(-0.6, 0.6, 2) for _ in range(2))], axis=1)
        assert np.abs(np.diff(swim(guide, fine(ends)))).max() <= MOVE * (1 + 1e-6)


MAIN = walk((0, 0, 0), (16, 0, 0))
BESIDE = walk((3, 0, 0), (3, 2.3, 0), (14, 2.3, 0), turn=1.0)
"""A dead end that leaves MAIN at x = 3 and runs beside it behind 0.3 m of rock."""


@cache
def guide_with_dead_end() -> Guide:
    return guide_of(joined(swept(MAIN, 1.0), swept(BESIDE, 1.0)), MAIN)


def test_a_dead_end_behind_thin_rock_brings_no_progress() -> None:
    guide = guide_with_dead_end()
    way = np.concatenate([fine(np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 1.0, 0]])), fine(BESIDE[12:-6])])
    progress = guide.length - swim(guide, way)
    in_branch = way[:, 1] > 1.2
    # The mouth reaches from x = 2 to x = 4; progress ends with the gate that it opens into, at most 2 m long.
    assert progress[in_branch].max() < 4.0 - INSET + 2.0
    assert np.ptp(progress[way[:, 0] > 6.0]) < 2.0  # eight metres into it, within one gate
    back = guide.length - swim(guide, np.concatenate([way, way[::-1]]))
    assert back[-1] == pytest.approx(back[0], abs=1e-6)


def test_past_the_mouth_of_a_dead_end_the_route_goes_on_evenly() -> None:
    guide = guide_with_dead_end()
    assert guide.length == pytest.approx(16.0 - 2 * INSET, abs=0.1)
    points = fine(MAIN)[60:-60]
    np.testing.assert_allclose(swim(guide, points), 16.0 - INSET - points[:, 0], atol=0.1)


NEAR = walk((0, 0, 0), (16, 0, 0))
FAR = walk((3, 0, 0), (3, 4, 0), (13, 4, 0), (13, 0, 0), turn=1.0)
"""With NEAR a loop: another way from x = 3 to x = 13."""


def test_around_the_other_side_of_a_loop_it_is_right_where_the_ways_meet_again() -> None:
    guide = guide_of(joined(swept(NEAR, 0.9), swept(FAR, 0.9)), NEAR)
    other_way = np.concatenate([fine(NEAR[6:31]), fine(FAR), fine(NEAR[130:155])])
    remaining = swim(guide, other_way)
    is_back = (np.abs(other_way[:, 1]) < 0.5) & (other_way[:, 0] > 13.5)
    np.testing.assert_allclose(remaining[is_back], 16.0 - INSET - other_way[is_back][:, 0], atol=0.1)
    # once around and back on the near side: the same way to go as before
    round_trip = np.concatenate([other_way, fine(NEAR[6:155])[::-1]])
    assert swim(guide, round_trip)[-1] == pytest.approx(remaining[0], abs=0.02)


HAIRPIN = walk((0, 0, 0), (9, 0, 0), (9, 2.3, 0), (0, 2.3, 0), turn=1.14)


def test_a_passage_that_comes_back_behind_thin_rock_is_not_taken_for_it() -> None:
    guide = guide_of(swept(HAIRPIN, 1.0), HAIRPIN)
    for line in (fine(guide.centreline), fine(guide.centreline) + [0.0, 0.6, 0.0]):
        remaining = swim(guide, line[line[:, 0] < 7.0][: int(6.0 / MOVE)])  # all of the first leg
        np.testing.assert_allclose(-np.diff(remaining), MOVE, rtol=0.02)


def test_the_goal_is_reached_at_its_panel_and_not_beside_or_behind_it() -> None:
    guide = guide_of(swept(TUBE, 1.0), walk((0, 0, 0), (9, 0, 0)))  # 5 m of the tube lie behind the goal
    goal = guide.centres[-1, 0]
    ahead = goal + np.array([-0.55, -0.45, 0.0, 0.45, 0.55, 3.0])
    reached = [False, True, True, True, False, False]
    for aside in (0.0, 0.9):
        places = np.stack([ahead, np.full(6, aside), np.zeros(6)], axis=1)
        assert Tracker(guide).are_at_goal(places, 0.5).tolist() == reached
    # In a passage beside it, 1.6 m from the middle: farther than the wall and the tolerance.
    assert not Tracker(guide).are_at_goal([[goal - 0.2, 1.6, 0.0], [goal + 0.2, -1.6, 0.0]], 0.5).any()
    # Without a tolerance, a quarter of a metre behind it is there, too.
    assert Tracker(guide).are_at_goal([[goal - 0.01, 0, 0], [goal + 0.2, 0, 0]], 0.0).tolist() == [False, True]


def test_it_is_followed_at_five_metres_per_second() -> None:
    guide = guide_in("bend")
    points = fine(guide.centreline)[::50]  # half a metre per decision
    assert swim(guide, points)[-1] == pytest.approx(np.linalg.norm(points[-1] - guide.centreline[-1]), abs=0.05)


def test_every_panel_of_the_route_is_met_in_its_order() -> None:
    guide = guide_in("helix")
    gates = [0, *Tracker(guide).follow(fine(guide.centreline), 0)[0].tolist()]
    assert all(0 <= after - before <= 1 for before, after in pairwise(gates))
    assert gates[-1] == guide.num_gates - 1


def with_pillar() -> tuple[Cavity, Array]:
    """A passage with a pillar from wall to wall, and a way around it."""
    pillar = manifold3d.Manifold.cube((3.0, 0.8, 6.0), center=True).translate((8.0, 0.0, 0.0))
    tube = swept(walk((0, 0, 0), (16, 0, 0)), 2.0)
    way = walk((0, 0, 0), (6, 1.2, 0), (10, 1.2, 0), (16, 0, 0), turn=3.0)
    return closed(from_manifold(to_manifold(tube.mesh) - pillar)), way


CONTINUOUS = {
    "tube": (lambda: (swept(TUBE, 1.0), TUBE), 1.0),
    "dead end": (lambda: (joined(swept(MAIN, 1.0), swept(BESIDE, 1.0)), MAIN), 1.0),
    "bend": (lambda: (swept(BEND, 1.0), BEND), 3.0 / 2.0),
    "helix": (lambda: (swept(HELIX, 1.0), HELIX), 3.083 / 2.083),  # the radius of its curvature
    "hairpin": (lambda: (swept(HAIRPIN, 1.0), HAIRPIN), 1.14 / (0.14 + ROOM)),
    "pillar": (with_pillar, 1.7),  # panels before it lean with the route: 3.2 m behind, 1.4 m stand 0.6 m closer
}
"""Caves with a route, and the steepest that progress may be: in a bend as much more as its inside is shorter."""


@pytest.mark.parametrize("shape", CONTINUOUS)
def test_wherever_a_vehicle_roams_progress_is_continuous(shape: str, rng: np.random.Generator) -> None:
    make, slope = CONTINUOUS[shape]
    cave, line = make()
    change, refined = largest_change(guide_of(cave, line), field_of(cave, 0.1), rng)
    # 2 % as on the route. A jump would stay whole when moves shrink.
    assert change < 1.02 * slope * MOVE
    assert refined < 1.02 * slope * FINEST
