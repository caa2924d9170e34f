from __future__ import annotations

import re

import numpy as np
import pytest

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.closing.ambient_occlusion import (
    MIN_FACING,
    ambient_occlusion,
    check_occlusion,
    facing,
    free_height,
)
from aquanav_tools.cave.closing.ends import find_ends
from aquanav_tools.cave.closing.openings import find_openings
from aquanav_tools.cave.closing.portals import cut_portals
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_surface
from aquanav_tools.cave.options import PanelOptions, StartOptions
from aquanav_tools.cave.route.capsule_checker import CapsuleChecker
from aquanav_tools.cave.route.panels import place_panels
from aquanav_tools.cave.route.route import find_route
from aquanav_tools.cave.route.starts import draw_starts
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.errors import InputError, MeshError, UnseenWallsError
from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.geometry.volume.geodesic import WaterGraph, shortest_length
from aquanav_tools.types import Capsule, Mesh, Pose, yaw_quaternion
from tests.cave.open_caves import LENGTH, RADIUS, bend, straight
from tests.caves import tube_cavity, tube_field, tube_guide
from tests.sim.batch.guides import swum

CAPSULE = Capsule(0.2, 0.2)
TURN_RADIUS = 4.0


def cavity_of(mesh: Mesh) -> Cavity:
    surface = surface_from_mesh(mesh, 0.1).mesh
    closed = close_surface(surface, ReconstructionOptions(0.1, 0.8))
    return cut_portals(closed, surface, find_ends(find_openings(closed, 0.8), closed.mesh, 0.1), 0.1)


@pytest.fixture(scope="module")
def turn() -> Cavity:
    return cavity_of(bend(TURN_RADIUS))


def test_the_route_through_a_bend_follows_its_axis(turn: Cavity) -> None:
    field = distance_field(turn.mesh, 0.08)
    route = find_route(turn, field, CAPSULE.radius)
    radii = np.linalg.norm(route.points[:, :2] - [0.0, TURN_RADIUS], axis=1)
    inner = slice(8, -8)  # the ends begin in the roomiest place behind a portal
    assert np.abs(radii[inner] - TURN_RADIUS).max() < 0.35
    assert np.abs(route.points[inner, 2]).max() < 0.2
    assert route.clearance[inner].min() > 0.7 * RADIUS


def test_progress_rises_along_the_centreline_and_panels_do_not_cross(turn: Cavity) -> None:
    field = distance_field(turn.mesh, 0.08)
    route = find_route(turn, field, CAPSULE.radius)
    guide = place_panels(turn, field, route, 0.5, PanelOptions(spacing=0.5))
    progress = guide.length - swum(guide, guide.centreline)
    assert progress[0] == 0.0
    assert progress[-1] == pytest.approx(guide.length)
    assert np.diff(progress).min() > 0.0
    for before, after in zip(guide.panels, guide.panels[1:], strict=False):
        assert ((after.polygon - before.centre) @ before.normal > 0).mean() > 0.97


def test_a_panel_is_the_passages_cross_section(turn: Cavity) -> None:
    field = distance_field(turn.mesh, 0.08)
    guide = place_panels(turn, field, find_route(turn, field, CAPSULE.radius), 0.5, PanelOptions())
    panel = guide.panels[len(guide.panels) // 2]
    # A plane through the bend's axis meets the tube in its polygon of 48 sides.
    to_axis = np.hypot(
        np.linalg.norm(panel.polygon[:, :2] - [0.0, TURN_RADIUS], axis=1) - TURN_RADIUS, panel.polygon[:, 2]
    )
    assert np.allclose(to_axis, RADIUS, atol=0.05)


def test_the_shortest_way_in_a_straight_tube_is_the_straight_line() -> None:
    ways = WaterGraph(tube_field(0.2), 0.2).ways_from(np.array([1.0, 0.0, 0.0]))
    end = np.array([18.0, 1.2, -0.5])
    assert shortest_length(ways, end) == pytest.approx(np.linalg.norm(end - [1.0, 0.0, 0.0]), rel=0.01)


def test_the_shortest_way_around_a_bend_hugs_its_inside(turn: Cavity) -> None:
    clearance = 0.3
    ways = WaterGraph(distance_field(turn.mesh, 0.08), clearance).ways_from(np.array([0.5, 0.0, 0.0]))
    start, end = np.array([0.5, 0.0, 0.0]), np.array([TURN_RADIUS, TURN_RADIUS - 0.5, 0.0])
    # Two tangents to the inner circle of radius r and the arc between them.
    r, centre = TURN_RADIUS - RADIUS + clearance, np.array([0.0, TURN_RADIUS, 0.0])
    a, b = np.linalg.norm(start - centre), np.linalg.norm(end - centre)
    between = np.arccos((start - centre) @ (end - centre) / a / b)
    arc = between - np.arccos(r / a) - np.arccos(r / b)
    truth = np.sqrt(a**2 - r**2) + np.sqrt(b**2 - r**2) + r * arc
    assert shortest_length(ways, end) == pytest.approx(truth, rel=0.01)


def test_a_passage_too_tight_for_the_vehicle_is_refused_with_both_numbers(turn: Cavity) -> None:
    field = distance_field(turn.mesh, 0.08)
    with pytest.raises(MeshError, match=r"1\.20 m of clearance are needed, the widest place has 0\.9\d m"):
        find_route(turn, field, 1.2)


def test_the_route_joins_the_ends_that_are_named() -> None:
    cavity, field = tube_cavity(), tube_field()
    entrance, goal = np.array([4.0, 0.5, 0.0]), np.array([12.0, 0.0, -0.5])
    route = find_route(cavity, field, CAPSULE.radius, entrance, goal)
    assert np.allclose(route.points[[0, -1]], [entrance, goal])
    backwards = find_route(cavity, field, CAPSULE.radius, entrance=np.array([20.0, 0.3, 0.0]))  # on the far portal
    assert backwards.points[0, 0] > 17.0
    assert backwards.points[-1, 0] < 3.0
    onwards = find_route(cavity, field, CAPSULE.radius, goal=goal)  # from the portal that is farther away
    assert onwards.points[0, 0] < 3.0
    assert np.allclose(onwards.points[-1], goal)


def test_an_end_in_rock_is_refused() -> None:
    with pytest.raises(InputError, match=r"goal \[10\. +0\. +2\.15\] m lies in rock, 0\.15 m from the water"):
        find_route(tube_cavity(), tube_field(), CAPSULE.radius, goal=np.array([10.0, 0.0, 2.15]))
    with pytest.raises(InputError, match=r"entrance .* lies in rock, more than 0\.30 m from the water"):
        find_route(tube_cavity(), tube_field(), CAPSULE.radius, entrance=np.array([10.0, 0.0, 9.0]))


def test_starts_touch_nothing_and_look_along_the_tube(rng: np.random.Generator) -> None:
    options = StartOptions(count=20, margin=0.1, max_yaw_error_deg=20.0)
    starts = draw_starts(tube_cavity(), tube_field(), tube_guide(), CAPSULE, options, rng)
    assert len(starts) == 20
    for start in starts:
        yaw = 2 * np.arctan2(start.pose.orientation[3], start.pose.orientation[0])
        ahead = np.array([19.0, 0.0]) - start.pose.position[:2]
        off = yaw - np.arctan2(ahead[1], ahead[0])
        # The way ends at the sample nearest to the goal, at most half a cell's face diagonal beside it.
        assert abs(np.rad2deg(off)) <= 20.0 + np.rad2deg(0.071 / np.linalg.norm(ahead))
        axis = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        ends = start.pose.position + 0.1 * np.array([[-1], [1]]) * axis
        gap = 2.0 * np.cos(np.pi / 64) - np.linalg.norm(ends[:, 1:], axis=1).max() - CAPSULE.radius
        assert gap > 0.1 - 0.01
        assert start.geodesic_to_goal == pytest.approx(np.linalg.norm(start.pose.position - [19, 0, 0]), rel=0.02)


def test_the_capsule_checker_measures_the_gap_to_a_tube() -> None:
    checker = CapsuleChecker(tube_cavity(), tube_field(), CAPSULE)
    beside = Pose(np.array([10.0, 1.0, 0.0]), yaw_quaternion(0.0))
    across = Pose(np.array([10.0, 1.0, 0.0]), yaw_quaternion(np.pi / 2))
    polygon = 2.0 * (1 - np.cos(np.pi / 64))
    assert checker.distance(beside) == pytest.approx(2.0 - 1.0 - 0.2, abs=polygon + 1e-3)
    assert checker.distance(across) == pytest.approx(2.0 - 1.1 - 0.2, abs=polygon + 1e-3)
    assert checker.distance(Pose(np.array([10.0, 1.9, 0.0]), yaw_quaternion(0.0))) == 0.0
    assert checker.distance(Pose(np.array([10.0, 5.0, 0.0]), yaw_quaternion(0.0))) == 0.0


def test_ambient_occlusion_of_an_open_tube_is_the_solid_angle_of_its_wall() -> None:
    share = ambient_occlusion(straight(), np.array([[LENGTH / 2, 0.0, 0.0]]))[0]
    ends = 1 - (LENGTH / 2) / np.hypot(LENGTH / 2, RADIUS)  # two caps of a cone
    assert share == pytest.approx(1 - ends, abs=0.01)


def test_in_the_middle_of_an_open_tube_wall_that_is_seen_faces_wall() -> None:
    middle = np.array([[LENGTH / 2, 0.0, 0.0]])
    assert facing(straight(), middle)[0] == pytest.approx(ambient_occlusion(straight(), middle)[0], abs=0.01)


def test_outside_of_the_hull_of_a_surface_no_line_meets_it_on_both_sides(rng: np.random.Generator) -> None:
    corners = rng.uniform(-1.0, 1.0, (3 * 200, 3))
    soup = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    around = rng.normal(size=(200, 3))
    around *= 1.01 * np.sqrt(3.0) / np.linalg.norm(around, axis=1, keepdims=True)  # the cube's corners lie at sqrt(3)
    assert ambient_occlusion(soup, around).max() > 0.1
    assert not facing(soup, around).any()


def test_floor_and_facade_do_not_face_each_other() -> None:
    facade = facing_square(2.0, 20.0)
    floor = Mesh(facade.vertices[:, [2, 1, 0]] * [1.0, 1.0, -1.0], facade.faces)
    corner = Mesh(np.concatenate([facade.vertices, floor.vertices]), np.concatenate([facade.faces, floor.faces + 4]))
    middle = np.zeros((1, 3))
    assert ambient_occlusion(corner, middle)[0] > 0.6  # two of six sides, and more where they reach beyond them
    assert facing(corner, middle)[0] == 0.0


def test_between_two_walls_somebody_who_looked_through_there_is_in_a_cave_and_a_guessed_middle_is_not() -> None:
    one, other = facing_square(2.0, 2.0), facing_square(-2.0, 2.0)
    walls = Mesh(np.concatenate([one.vertices, other.vertices]), np.concatenate([one.faces, other.faces[:, ::-1] + 4]))
    middle, beside = np.zeros((1, 3)), np.array([[0.0, 6.0, 0.0]])
    # A square of half width a at a distance d fills 4 asin(a^2 / (a^2 + d^2)) of the 4 pi of all directions.
    share = 2.0 * np.arcsin(4.0 / 8.0) / np.pi
    assert facing(walls, middle)[0] == pytest.approx(share, abs=0.02)  # 128 lines
    assert check_occlusion(walls, middle, "the cameras", before=middle) == pytest.approx(share, abs=0.02)
    with pytest.raises(UnseenWallsError, match="a passage needs 60%"):
        check_occlusion(walls, middle, "the middle of the passage")
    with pytest.raises(UnseenWallsError, match=rf"0% of all lines meet walls .* between walls {MIN_FACING:.0%}"):
        check_occlusion(walls, beside, "the cameras", before=beside)


def facing_square(x: float, half: float) -> Mesh:
    """A square across x, around the axis."""
    square = np.array([[x, -half, -half], [x, half, -half], [x, half, half], [x, -half, half]])
    return Mesh(square, np.array([[0, 1, 2], [0, 2, 3]]))


def test_a_wall_seen_from_one_side_is_no_cave() -> None:
    wall = facing_square(5.0, 50.0)
    places = np.array([[-5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    with pytest.raises(UnseenWallsError, match=r"no cave.*: from the cameras, .* fills only \d+%") as caught:
        check_occlusion(wall, places, "the cameras", ("a.jpg", "b.jpg", "c.jpg"))
    sentence = str(caught.value)
    assert "the median at (0.00, 0.00, 0.00) m (b.jpg)" in sentence
    assert "+x 100%, -x 0%" in sentence
    assert "--accept-open" in sentence
    (viewpoint, _), *unseen = caught.value.places
    assert viewpoint == (0.0, 0.0, 0.0)
    assert [np.sign(place).tolist() for place, _ in unseen] == [
        [0, 0, 1],
        [0, 0, -1],
        [-1, 0, 0],
        [0, 1, 0],
        [0, -1, 0],
    ]


def test_free_height_in_a_tube_is_its_diameter() -> None:
    assert free_height(straight(), np.array([[5.0, 0.0, 0.3]])) == pytest.approx(2 * RADIUS, rel=0.01)


def test_a_passage_with_room_between_the_samples_alone_is_not_called_narrower_than_the_vehicle() -> None:
    tube = straight()
    squeeze = 1.0 - 0.77 * np.exp(-(((tube.vertices[:, :1] - 0.5 * LENGTH) / 0.8) ** 4))
    cavity = cavity_of(Mesh(tube.vertices * np.hstack([np.ones_like(squeeze), squeeze, squeeze]), tube.faces))
    with pytest.raises(MeshError, match=r"0\.400 m wide, all but fits: .* 0\.4\d m are free, .* every 0\.20 m none"):
        find_route(cavity, distance_field(cavity.mesh, 0.2), CAPSULE.radius)


def test_a_passage_that_is_too_tight_names_the_place_and_the_largest_vehicle() -> None:
    tube = straight()
    squeeze = 1.0 - 0.85 * np.exp(-(((tube.vertices[:, :1] - 0.5 * LENGTH) / 0.8) ** 2))
    cavity = cavity_of(Mesh(tube.vertices * np.hstack([np.ones_like(squeeze), squeeze, squeeze]), tube.faces))
    with pytest.raises(MeshError, match=r"too tight .* narrower than the vehicle's 0\.400 m") as refusal:
        find_route(cavity, distance_field(cavity.mesh, 0.05), CAPSULE.radius)
    width = float(re.search(r"largest vehicle that fits is (.*) m wide", str(refusal.value))[1])
    assert width == pytest.approx(2 * 0.15 * RADIUS, abs=0.02)  # a prism of 48 sides, and two digits
    (place, what) = refusal.value.places[0]
    assert place == pytest.approx((0.5 * LENGTH, 0.0, 0.0), abs=0.15)
    assert what.endswith("m wide")
