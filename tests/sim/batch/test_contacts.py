"""Where a capsule touches walls of known shape, and how it is kept off two walls at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp
from scipy.spatial.transform import Rotation

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.bvh import FOUND, Bvh, make_bvh
from aquanav_tools.sim.batch.contact import beside_wall
from aquanav_tools.sim.batch.contact_points import OVERLAP, Hull, find_contacts
from aquanav_tools.sim.batch.field import Grid, make_grid
from aquanav_tools.sim.batch.motion import State, vec6
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device
from aquanav_tools.types import Array, Mesh
from tests.caves import tube_scenario

wp.set_module_options(OPTIONS)
RADIUS, HALF_AXIS, MARGIN = 0.17, 0.06, 0.005
DT, SPEED = 0.02, 0.3
CENTRE = np.array([10.0, 0.0, 0.0])
"""In open water by the tube's field: walls of the tests are put around it, and the field knows nothing of them."""


@wp.kernel
def look(
    positions: wp.array(dtype=wp.vec3d),
    turns: wp.array(dtype=wp.vec4d),
    hull: Hull,
    grid: Grid,
    wall: Bvh,
    gaps: wp.array(dtype=wp.float64),
    normals: wp.array(dtype=wp.vec3d),
):
    i = wp.tid()
    state = State()
    state.position = positions[i]
    state.orientation = turns[i]
    found = find_contacts(state, hull, grid, wall, wp.vec3d())
    gaps[i] = wp.float64(1.0)
    for n in range(found.count):
        if found.gaps[n] < gaps[i]:
            gaps[i] = found.gaps[n]
            normals[i] = wp.vec3d(found.normals[n, 0], found.normals[n, 1], found.normals[n, 2])


@wp.kernel
def push(
    positions: wp.array(dtype=wp.vec3d),
    turns: wp.array(dtype=wp.vec4d),
    velocity: wp.vec3d,
    hull: Hull,
    grid: Grid,
    wall: Bvh,
    speeds: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    state = State()
    state.position = positions[i]
    state.orientation = turns[i]
    free = State()
    free.position = state.position + wp.float64(0.02) * velocity
    free.orientation = state.orientation
    free.velocity = vec6(velocity[0], velocity[1], velocity[2], wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    after, _ = beside_wall(state, free, hull, grid, wall, wp.vec3d(), wp.float64(0.02))
    positions[i] = after.position
    turns[i] = after.orientation
    speeds[i] = wp.length(wp.vec3d(after.velocity[0], after.velocity[1], after.velocity[2]))


def wall_of(vertices: Array, faces: Any) -> Bvh:
    """Return a wall for hulls; normals point into rock, as those of a cave do."""
    mesh = Mesh(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))
    return make_bvh(mesh, np.zeros(3), find_device("cpu"))


def hull_and_grid(tube: Scenario) -> tuple[Hull, Grid]:
    hull = Hull()
    hull.half_axis, hull.radius, hull.margin, hull.friction = HALF_AXIS, RADIUS, MARGIN, 0.0
    hull.mass, hull.inertia, hull.masses = 20.0, 1.0, vec6(20.0, 20.0, 20.0, 1.0, 1.0, 1.0)
    return hull, make_grid(tube.field, find_device("cpu"))


def pressed(
    tube: Scenario, wall: Bvh, half_axis: float, start: Array, velocity_at: Callable[[int], Array]
) -> Iterator[Array]:
    """Yield the (2, 3) ends of a hull's axis, from the middle of the tests' wall, after each of 600 steps.

    In each the hull is made to move at `velocity_at(step)`, which the wall may only slow down.
    """
    hull, grid = hull_and_grid(tube)
    hull.half_axis = half_axis
    positions = wp.array(CENTRE + [start], dtype=wp.vec3d)
    turns, speeds = wp.array([[1.0, 0.0, 0.0, 0.0]], dtype=wp.vec4d), wp.zeros(1, dtype=wp.float64)
    for step in range(600):
        velocity = velocity_at(step)
        inputs = [positions, turns, wp.vec3d(*velocity), hull, grid, wall, speeds]
        wp.launch(push, dim=1, inputs=inputs, device="cpu")
        w, x, y, z = turns.numpy()[0]
        nose = half_axis * Rotation.from_quat([x, y, z, w]).apply([1.0, 0.0, 0.0])
        assert speeds.numpy()[0] <= np.linalg.norm(velocity) + 1e-12
        yield positions.numpy()[0] - CENTRE + np.stack([nose, -nose])


def find(tube: Scenario, wall: Bvh, positions: Array, turns: Array) -> tuple[Array, Array]:
    """Return the (N,) smallest gaps of capsules, with (N, 3) positions and (N, 4) quaternions, and the normals."""
    hull, grid = hull_and_grid(tube)
    gaps, normals = wp.zeros(len(positions), dtype=wp.float64), wp.zeros(len(positions), dtype=wp.vec3d)
    inputs = [wp.array(positions, dtype=wp.vec3d), wp.array(turns, dtype=wp.vec4d), hull, grid, wall, gaps, normals]
    wp.launch(look, dim=len(positions), inputs=inputs, device="cpu")
    return gaps.numpy(), normals.numpy()


@pytest.fixture(scope="module")
def tube() -> Scenario:
    return tube_scenario()


def test_the_smallest_gap_is_the_distance_of_the_axis_less_the_radius(tube: Scenario, rng: np.random.Generator) -> None:
    """Against trimesh's nearest points of all triangles to 41 points of the axis, on rugged rock."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(13), np.arange(13), indexing="ij"))
    vertices = np.stack([x * 0.1 - 0.6, y * 0.1 - 0.6, rng.uniform(-0.08, 0.08, len(x))], axis=1) + CENTRE
    first = (np.arange(12)[:, None] * 13 + np.arange(12)).ravel()
    faces = np.concatenate(
        [np.stack([first, first + 1, first + 13], 1), np.stack([first + 1, first + 14, first + 13], 1)]
    )
    num = 150
    positions = CENTRE + np.stack([*rng.uniform(-0.3, 0.3, (2, num)), rng.uniform(0.12, 0.3, num)], axis=1)
    turns = Rotation.random(num, rng=rng)
    gaps, _ = find(tube, wall_of(vertices, faces), positions, turns.as_quat()[:, [3, 0, 1, 2]])
    axes = positions[:, None] + np.linspace(-HALF_AXIS, HALF_AXIS, 41)[:, None] * turns.apply([1.0, 0.0, 0.0])[:, None]
    corners = vertices[faces]
    expected = np.empty(num)
    for n, axis in enumerate(axes):
        near = [trimesh.triangles.closest_point(corners, np.repeat(point[None], len(corners), 0)) for point in axis]
        expected[n] = np.linalg.norm(np.array(near) - axis[:, None], axis=2).min() - RADIUS
    is_near = (expected < MARGIN - 1e-4) & (expected > 0.05 - RADIUS)
    assert is_near.sum() > 25
    # Points of the axis lie 3 mm apart, which adds up to (1.5 mm)^2 / (2 x 0.12 m), and Warp's meshes are in float32.
    np.testing.assert_allclose(gaps[is_near], expected[is_near], atol=2e-5)
    assert (gaps[expected > MARGIN + 1e-4] == 1.0).all()


def test_the_nearest_of_many_small_triangles_is_found(tube: Scenario, rng: np.random.Generator) -> None:
    """In a ball of 81,920 triangles some hundred are within reach, in more leaves than one search returns."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.6)
    wall = wall_of(ball.vertices + CENTRE, ball.faces)
    away = rng.normal(size=(60, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    # Noses point at the wall. From inside a ball, what of a segment is nearest to it is one of its ends.
    positions = CENTRE + away * rng.uniform(0.41, 0.44, (60, 1))
    noses = positions + HALF_AXIS * away
    within = np.linalg.norm(ball.triangles_center + CENTRE - noses[:, None], axis=2) < RADIUS
    assert within.sum(axis=1).min() > 16 * FOUND  # triangles, eight to a leaf: two searches at the least
    turns = np.array([Rotation.align_vectors(one[None], [[1.0, 0.0, 0.0]])[0].as_quat() for one in away])
    gaps, normals = find(tube, wall, positions, turns[:, [3, 0, 1, 2]])
    for gap, nose, near in zip(gaps, noses - CENTRE, within, strict=True):
        points = trimesh.triangles.closest_point(ball.triangles[near], np.repeat(nose[None], near.sum(), axis=0))
        assert gap == pytest.approx(np.linalg.norm(points - nose, axis=1).min() - RADIUS, abs=2e-6)
    assert (np.sum(normals * -away, axis=1) > 0.99).all()


@pytest.mark.parametrize("tilt_deg", [-40.0, -10.0, 10.0, 40.0])
@pytest.mark.parametrize("along", [-0.05, -0.02, 0.03, 0.09])
def test_a_blade_of_rock_pushes_the_hull_off_its_edge(tube: Scenario, along: float, tilt_deg: float) -> None:
    """Its two faces enclose 10 degrees: beside its edge, one of them looks away from the water that the hull is in."""
    half = np.tan(np.radians(5.0))
    vertices = np.array([[0, -1, 0], [0, 1, 0], [half, 1, -1], [half, -1, -1], [-half, 1, -1], [-half, -1, -1]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1], [0, 5, 4]])
    normals = np.cross(vertices[faces][:, 1] - vertices[faces][:, 0], vertices[faces][:, 2] - vertices[faces][:, 0])
    assert (normals[:2, 0] < 0).all() and (normals[2:, 0] > 0).all()  # into the blade
    tilt = np.radians(tilt_deg)
    axis = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    upright = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
    place = min(abs(along), HALF_AXIS) * np.sign(along)  # of the axis, nearest to the edge
    position = CENTRE - along * axis + 0.16 * upright  # the edge is at the origin of the blade
    turn = Rotation.from_rotvec([0.0, -tilt, 0.0]).as_quat()[[3, 0, 1, 2]]
    gaps, found = find(tube, wall_of(vertices + CENTRE, faces), position[None], turn[None])
    offset = position + place * axis - CENTRE
    assert gaps[0] == pytest.approx(np.linalg.norm(offset) - RADIUS, abs=1e-5)
    np.testing.assert_allclose(found[0], offset / np.linalg.norm(offset), atol=1e-4)


@pytest.mark.parametrize("opening_deg", [40.0, 90.0, 140.0])
def test_a_hull_that_is_pressed_into_a_groove_stays_out_of_both_its_walls(tube: Scenario, opening_deg: float) -> None:
    """Along the axis of the groove and across its walls; in gets at most the allowed overlap and a step's way."""
    half = np.radians(opening_deg / 2)
    up = np.array([0.0, np.sin(half), np.cos(half)])  # along a wall, away from the groove's bottom
    ends = np.array([[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    mirrored = up * [1.0, -1.0, 1.0]
    vertices = np.concatenate([ends, ends + 2 * up, ends + 2 * mirrored]) + CENTRE
    wall = wall_of(vertices, [[0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4]])
    inwards = np.array([[0.0, -np.cos(half), np.sin(half)], [0.0, np.cos(half), np.sin(half)]])
    start = np.array([0.0, 0.004, RADIUS / np.sin(half) + 0.01])
    swaying = pressed(tube, wall, HALF_AXIS, start, lambda step: np.array([0.0, SPEED * np.sin(0.05 * step), -SPEED]))
    deepest = max(RADIUS - (ends @ inwards.T).min() for ends in swaying)
    assert -MARGIN < deepest < OVERLAP.value + DT * SPEED * np.sqrt(2.0)


@pytest.mark.parametrize(
    ("half_axis", "ridges"),
    [(0.5, [-0.3, 0.3]), (0.5, [-0.1, 0.1]), (0.5, [-0.06, 0.06]), (0.2, [-0.1, 0.1]), (0.5, [-0.3, 0.0, 0.3])],
)
def test_a_long_hull_that_is_pressed_onto_ridges_between_its_ends_stays_out_of_all(
    tube: Scenario, half_axis: float, ridges: list[float]
) -> None:
    """A ridge is a line along y at height 0, on a blade of 10 degrees.

    Kept off one alone, a hull turns about it, so that its place at another may come down twice as fast as pressed.
    """
    half = np.tan(np.radians(5.0))
    blade = np.array([[0, -1, 0], [0, 1, 0], [half, 1, -1], [half, -1, -1], [-half, 1, -1], [-half, -1, -1]])
    sides = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1], [0, 5, 4]])
    vertices = np.concatenate([blade + [x, 0.0, 0.0] for x in ridges]) + CENTRE
    wall = wall_of(vertices, np.concatenate([sides + 6 * n for n in range(len(ridges))]))
    deepest, shares = 0.0, np.linspace(0.0, 1.0, 1001)[:, None]
    for nose, tail in pressed(
        tube, wall, half_axis, np.array([0.004, 0.0, RADIUS + 0.01]), lambda _: np.array([0.0, 0.0, -SPEED])
    ):
        axis = tail + shares * (nose - tail)
        apart = min(np.hypot(axis[:, 0] - x, axis[:, 2]).min() for x in ridges)
        assert abs(axis[:, 1]).max() < 1e-6  # so the distance to a ridge is that to its line
        deepest = max(deepest, RADIUS - apart)
    assert -MARGIN < deepest < OVERLAP.value + 2.0 * DT * SPEED
