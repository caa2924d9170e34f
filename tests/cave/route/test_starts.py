from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.options import PanelOptions, StartOptions
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.panels import place_panels
from aquanav_tools.cave.route.starts import Start, draw_starts
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Capsule, rotation_matrix
from tests.cave.closed_caves import BRANCH, MAIN, Cavity, DistanceField, field_of, fork, lathe, route_along, swept, walk

CAPSULE = Capsule(0.17, 0.4)
MARGIN = 0.1
Cave = tuple[Cavity, DistanceField, Guide]


def guided(cave: Cavity, line: np.ndarray, spacing: float = 0.15) -> Cave:
    field = field_of(cave, spacing)
    return cave, field, place_panels(cave, field, route_along(line, field), 0.6, PanelOptions(), CAPSULE.radius)


@pytest.fixture(scope="module")
def forked() -> Cave:
    return guided(fork(), MAIN)


@pytest.fixture(scope="module")
def turn() -> Cave:
    line = walk((0, 0, 0), (8, 0, 0), (8, 8, 0), turn=2.0)
    return guided(swept(line, 1.2), line)


def draw(cave: Cave, seed: int = 0, **options: float) -> tuple[Start, ...]:
    return draw_starts(*cave, CAPSULE, StartOptions(**options), np.random.default_rng(seed))  # type: ignore[arg-type]


def positions(starts: tuple[Start, ...]) -> np.ndarray:
    return np.array([start.pose.position for start in starts])


def test_every_start_is_free_with_its_heading(forked: Cave) -> None:
    mesh = forked[0].mesh
    for start in draw(forked, margin=MARGIN):
        ahead = rotation_matrix(start.pose.orientation)[:, 0]
        axis = start.pose.position + np.linspace(-0.5, 0.5, 81)[:, None] * CAPSULE.axis_length * ahead
        distance = np.sqrt(igl.point_mesh_squared_distance(axis, mesh.vertices, mesh.faces)[0])
        assert distance.min() - CAPSULE.radius > MARGIN - 1e-3  # samples on the axis are 5 mm apart
        assert igl.fast_winding_number(mesh.vertices, mesh.faces, axis).min() > 0.5
        assert start.clearance == pytest.approx(forked[1].clearance_at(start.pose.position))


def test_each_of_the_equal_ranges_of_the_way_to_the_goal_has_one_start(turn: Cave) -> None:
    starts = draw(turn, count=12, last_share=0.6)
    assert len(starts) == 12
    difficulty = np.array([start.difficulty for start in starts])
    assert np.all((difficulty > 0.0) & (difficulty <= 1.0))
    edges = np.linspace(0.4, 1.0, 13)
    assert np.all((difficulty >= edges[:-1]) & (difficulty <= edges[1:]))


def test_difficulty_is_the_share_of_the_longest_way_in_a_straight_tube() -> None:
    cave = guided(swept(walk((0, 0, 0), (14, 0, 0)), 1.0), walk((0, 0, 0), (14, 0, 0)))
    goal = cave[2].centres[-1]
    longest = np.linalg.norm([goal[0] - 0.27, 0.73, 0.0])  # a vehicle with its margin fits to 0.27 m before the walls
    for start in draw(cave, count=20):
        straight = np.linalg.norm(start.pose.position - goal)
        # 2 %, or half the diagonal of a sample, of which one stands for the goal.
        assert start.geodesic_to_goal == pytest.approx(straight, rel=0.02, abs=0.5 * np.sqrt(3.0) * 0.15)
        # Half a sample at either end of the longest way.
        assert start.difficulty == pytest.approx(straight / longest, abs=0.03)


def test_starts_keep_away_from_the_goal(turn: Cave) -> None:
    near = draw(turn, count=30, last_share=1.0, min_goal_distance=1.5)
    ways = [start.geodesic_to_goal for start in near]
    assert 1.5 <= min(ways) < 2.5
    with pytest.raises(MeshError, match=r"farthest place .* is 1\d\.\d\d m from the goal, and starts keep 50\.00 m"):
        draw(turn, min_goal_distance=50.0)


def test_the_same_seed_draws_the_same_starts_and_another_seed_others(turn: Cave) -> None:
    assert np.array_equal(positions(draw(turn, 1, count=10)), positions(draw(turn, 1, count=10)))
    assert np.abs(positions(draw(turn, 1, count=10)) - positions(draw(turn, 2, count=10))).max(axis=1).min() > 1e-6


def test_starts_fill_the_cross_section_and_not_only_its_middle(turn: Cave) -> None:
    offsets = np.linalg.norm(positions(draw(turn, count=200, last_share=1.0))[:, None] - turn[2].centreline, axis=2)
    # Of a disc of radius 1.2 - 0.27 m, three quarters of the area lie beyond half its radius. 200 draws: +- 3 %.
    assert (offsets.min(axis=1) > 0.5 * 0.93).mean() == pytest.approx(0.75, abs=0.1)


def test_dead_ends_have_starts_that_are_located_where_they_leave_the_route(forked: Cave) -> None:
    _, field, guide = forked
    starts = draw(forked, count=60, last_share=1.0)
    places = positions(starts)
    deep = places[places[:, 1] > 3.0]
    assert np.linalg.norm(deep[:, None] - BRANCH, axis=2).min(axis=1).max() < 1.0
    # The dead end holds about 13 of 29 m of passage, and as many ways to the goal are only found in it.
    assert len(deep) > 10
    for place in deep:
        gate = guide.locate(place, field)
        assert 2.0 <= guide.arc_lengths[gate] <= 5.5


def test_starts_lie_in_all_the_water_that_a_flood_reaches_and_in_no_other() -> None:
    # A passage, and beside it a chamber behind a gap of 0.2 m, which is too narrow for the vehicle.
    def radius(x: np.ndarray) -> np.ndarray:
        return np.asarray(1.0 - 0.9 * np.exp(-(((x - 4.0) / 0.4) ** 2)))

    def room_at(points: np.ndarray) -> np.ndarray:  # by the formula: to the nearest of 3201 circles, and to the ends
        along = np.linspace(0.0, 16.0, 3201)
        aside = np.hypot(points[:, 1], points[:, 2])
        to_wall = np.min(
            [np.hypot(points[:, 0] - x, aside - r) for x, r in zip(along, radius(along), strict=True)], axis=0
        )
        to_ends = np.minimum(points[:, 0], 16.0 - points[:, 0])
        return np.where((aside < radius(points[:, 0])) & (to_ends > 0.0), np.minimum(to_wall, to_ends), -1.0)

    cave = lathe(16.0, radius)
    field = field_of(cave, 0.1)
    line = walk((5.0, 0, 0), (16, 0, 0))
    guide = place_panels(cave, field, route_along(line, field), 0.6, PanelOptions(), CAPSULE.radius)
    starts = draw((cave, field, guide), count=30)
    triangles, places = cave.mesh.to_trimesh().triangles, positions(starts)
    rooms = []
    for place in places:
        nearest = trimesh.triangles.closest_point(triangles, np.broadcast_to(place, (len(triangles), 3)))
        rooms.append(np.linalg.norm(nearest - place, axis=1).min())
    assert min(rooms) >= CAPSULE.radius + MARGIN - 1e-6
    assert [start.clearance for start in starts] == pytest.approx(rooms, abs=0.01)  # of the field's samples at 0.1 m
    # The flood: places on a grid of 0.2 m with room for the vehicle, from the goal to its six neighbours and on.
    step, goal = 0.2, guide.centres[-1]
    axes = [goal[n] + step * np.arange(-80 if n == 0 else -5, 6) for n in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    has_room = room_at(grid.reshape(-1, 3)).reshape(grid.shape[:3]) >= CAPSULE.radius
    ways = flood(has_room, (80, 5, 5)) * step
    reached = np.isfinite(ways)
    assert has_room[~reached].any()  # behind the gap
    nearest = np.linalg.norm(places[:, None] - grid[reached], axis=2).min(axis=1)
    assert nearest.max() <= 0.5 * step * np.sqrt(3.0)
    # Each third of what is reached has its share of the starts; 2 m before the goal there are none.
    farthest = ways[reached].max() / 1.05  # steps along the axes are longer than the way; this tube is straight
    lengths = np.linalg.norm(places - goal, axis=1)
    counts = np.histogram(lengths, np.linspace(2.0, farthest, 4))[0]
    assert counts.sum() >= 29 and counts.min() >= 8


def flood(is_free: np.ndarray, start: tuple[int, ...]) -> np.ndarray:
    """Return the steps from one cell to every other through free cells; inf for those that are not reached."""
    steps = np.full(is_free.shape, np.inf)
    steps[start], front, count = 0.0, [start], 0
    while front:
        count += 1
        ahead = []
        for cell in front:
            for axis in range(3):
                for move in (-1, 1):
                    other = tuple(c + move * (n == axis) for n, c in enumerate(cell))
                    inside = all(0 <= c < size for c, size in zip(other, is_free.shape, strict=True))
                    if inside and is_free[other] and np.isinf(steps[other]):
                        steps[other] = count
                        ahead.append(other)
        front = ahead
    return steps


def test_starts_look_along_the_way_to_the_goal(forked: Cave) -> None:
    for start in draw(forked, count=60, last_share=1.0, max_yaw_error_deg=20.0):
        ahead = rotation_matrix(start.pose.orientation)[:2, 0]
        x, y, _ = start.pose.position
        if y < 1.0 and x > 7.0:  # the goal is in sight
            to_goal = forked[2].centres[-1][:2] - [x, y]
            assert ahead @ to_goal / np.linalg.norm(to_goal) > np.cos(np.deg2rad(20.0 + 5.0))  # a sample beside it
        if y > 5.0 and x > 12.0:  # in the dead end the way leads back, at most 20 degrees off its axis
            assert ahead[0] < -np.cos(np.deg2rad(20.0 + 20.0))


def test_water_behind_a_squeeze_that_is_too_tight_has_no_starts() -> None:
    cave = lathe(16.0, lambda x: 1.0 - 0.9 * np.exp(-(((x - 5.0) / 0.5) ** 2)))
    field = field_of(cave, 0.1)
    line = walk((5.5, 0, 0), (16, 0, 0))
    guide = place_panels(cave, field, route_along(line, field), 0.6, PanelOptions(), CAPSULE.radius)
    assert positions(draw((cave, field, guide), count=20))[:, 0].min() > 5.0


def test_a_cave_too_tight_for_the_margin_is_refused(turn: Cave) -> None:
    with pytest.raises(MeshError, match=r"no place from which the goal can be reached has 1\.67 m of clearance"):
        draw(turn, margin=1.5)


def test_ranges_without_a_free_pose_are_left_out_until_most_are() -> None:
    # A tube with room for the vehicle but not for its margin, and a chamber before its far end.
    def wide(near: float) -> Cave:
        cave = lathe(16.0, lambda x: np.where(x < near, 1.0, 0.24))
        return guided(cave, walk((0, 0, 0), (16, 0, 0)), 0.08)

    assert 10 <= len(draw(wide(9.0), count=20, last_share=1.0)) < 20
    with pytest.raises(MeshError, match=r"Only \d of 20 starts have a free pose"):
        draw(wide(5.0), count=20, last_share=1.0)
