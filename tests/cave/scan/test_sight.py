"""What cameras inside a sphere look through, in closed form."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.scan.sight import (
    NO_WALL,
    OUTSIDE,
    RELATIVE_MARGIN,
    UNSURE,
    Sight,
    believed,
    coarse_depth,
    make_sight,
)
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.types import Array, Sim3, rotation_matrix

RADIUS, WIDTH, HEIGHT, FOCAL = 2.0, 80, 60, 40.0
CENTRES = np.array([[0.0, -0.2, 0.0], [0.0, 0.2, 0.1], [0.1, 0.0, -0.1]])


def sphere_sight() -> Sight:
    """Three cameras that look along x."""
    u, v = np.meshgrid((np.arange(WIDTH) + 0.5 - WIDTH / 2) / FOCAL, (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / FOCAL)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1)
    rotation, maps, poses = look(0.0, 0.0), [], []
    for centre in CENTRES:
        middle = rotation @ -centre
        a, b, c = (rays * rays).sum(-1), rays @ middle, middle @ middle - RADIUS**2
        maps.append(((b + np.sqrt(b * b - a * c)) / a).astype(np.float32))
        poses.append(np.column_stack([rotation, -rotation @ centre]))
    return make_sight(np.array(poses), np.tile([FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2], (3, 1)), maps)


def in_frames(points: Array) -> Array:
    """Return the (N, 3) flags of points before each camera and in its frame."""
    ahead = points[:, None] - CENTRES  # x ahead, y to the left, z up
    with np.errstate(divide="ignore", invalid="ignore"):
        across, up = np.abs(ahead[..., 1] / ahead[..., 0]), np.abs(ahead[..., 2] / ahead[..., 0])
    return (ahead[..., 0] > 0.0) & (across < WIDTH / 2 / FOCAL) & (up < HEIGHT / 2 / FOCAL)


def test_a_point_is_seen_through_by_the_cameras_that_have_it_in_their_frame(rng: np.random.Generator) -> None:
    points = rng.uniform(-2.5, 2.5, (20_000, 3))
    counts = sphere_sight().votes(points, 0.05)[:, 0]
    radius = np.linalg.norm(points, axis=1)
    # A cell is 5 cm wide on the wall: so far beside the point the depth was seen.
    water = radius < (RADIUS - 0.05 - 0.1) * (1.0 - 2.0 * RELATIVE_MARGIN)
    np.testing.assert_array_equal(counts[water], in_frames(points)[water].sum(axis=1))
    assert (counts[water] > 0).sum() > 300


def test_no_rock_is_ever_seen_through(rng: np.random.Generator) -> None:
    points = rng.uniform(-4.0, 4.0, (20_000, 3))
    counts = sphere_sight().votes(points, 0.05)[:, 0]
    assert not counts[np.linalg.norm(points, axis=1) > RADIUS].any()


def test_wall_is_shown_by_the_cameras_that_have_it_in_their_frame(rng: np.random.Generator) -> None:
    directions = rng.normal(size=(5_000, 3))
    points = RADIUS * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    # A cell is 5 cm wide on the wall, and at its edges seen at a slant.
    through, shown = sphere_sight().votes(points, 0.2).T
    assert not through.any()
    np.testing.assert_array_equal(shown, in_frames(points).sum(axis=1))
    assert (shown > 0).sum() > 300
    for rock in (1.3 * points, 0.7 * points):
        assert not sphere_sight().votes(rock, 0.2)[:, 1].any()


def test_only_cameras_that_reach_a_box_are_asked_about_it(rng: np.random.Generator) -> None:
    sight, far = sphere_sight(), np.array([0.0, 0.0, 50.0])
    apart = sight.moved(Sim3(1.0, np.eye(3), far))
    both = make_sight(
        np.concatenate([sight.poses, apart.poses]),
        np.concatenate([sight.pinholes, apart.pinholes]),
        [*sight.depth, *apart.depth],
    )
    low, high = np.array([0.0, -1.0, -1.0]), np.array([2.0, 1.0, 1.0])
    points = rng.uniform(low, high, (500, 3))
    assert len(both.near(low, high).poses) == 3
    assert len(both.near(low + 20.0, high + 20.0).poses) == 0
    counts = both.votes(points, 0.05)
    np.testing.assert_array_equal(both.near(low, high).votes(points, 0.05), counts)
    assert not both.near(low + 20.0, high + 20.0).votes(points, 0.05).any()


def test_a_moved_sight_sees_the_same(rng: np.random.Generator) -> None:
    points = rng.uniform(-2.5, 2.5, (2000, 3))
    turn = rotation_matrix(np.array([0.5, -0.5, 0.5, 0.5]))
    b_from_a = Sim3(3.0, turn, np.array([5.0, -7.0, 1.0]))
    sight = sphere_sight()
    moved = sight.moved(b_from_a)
    np.testing.assert_allclose(moved.centres, b_from_a.apply(CENTRES), atol=1e-12)
    counts = sight.votes(points, 0.05)
    np.testing.assert_array_equal(moved.votes(b_from_a.apply(points), 0.15), counts)


def test_looking_tells_the_distance_and_what_is_seen_there() -> None:
    ahead, seen = sphere_sight().look(np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.1, 1.9, 0.0]]))
    np.testing.assert_allclose(ahead[0], 1.0 - CENTRES[:, 0])
    np.testing.assert_allclose(seen[0], RADIUS - CENTRES[:, 0], atol=0.05)
    assert (seen[1:] == OUTSIDE).all()


def test_a_coarse_map_claims_no_more_water() -> None:
    depth = np.zeros((4, 12), np.float32)
    depth[:, :4] = 3.0
    depth[1, 2] = 2.0  # the nearest counts
    depth[0, 4:8] = 5.0  # a quarter of the cell is sure: neither wall nor none
    np.testing.assert_array_equal(coarse_depth(depth, 4), np.array([[2.0, UNSURE, NO_WALL]], np.float32))


def test_maps_of_different_sizes_are_padded_with_nothing() -> None:
    small, large = np.ones((2, 3), np.float32), np.ones((3, 2), np.float32)
    sight = make_sight(np.tile(np.eye(3, 4), (2, 1, 1)), np.ones((2, 4)), [small, large])
    assert sight.depth.shape == (2, 3, 3)
    assert (sight.depth[0, 2] == OUTSIDE).all() and (sight.depth[1, :, 2] == OUTSIDE).all()


def test_what_is_shown_where_no_wall_is_claims_no_water(rng: np.random.Generator) -> None:
    sight, asked = sphere_sight(), []

    def is_upper_half(places: Array) -> np.ndarray:
        asked.append(places)
        return np.asarray(places[:, 2] > 0.0)

    upper = believed(sight, is_upper_half)
    np.testing.assert_allclose(np.linalg.norm(np.concatenate(asked), axis=1), RADIUS, rtol=1e-5)  # depths are float32
    assert (upper.depth == UNSURE).sum() == sum((places[:, 2] <= 0.0).sum() for places in asked)
    np.testing.assert_array_equal(upper.depth[upper.depth != UNSURE], sight.depth[upper.depth != UNSURE])
    assert (sight.depth > UNSURE).all()  # as it was
    points = rng.uniform(-1.0, 1.0, (5_000, 3)) + [1.0, 0.0, 0.0]
    # Seen from about the middle, places below look at wall below.
    below = points[:, 2] < -0.3 * points[:, 0] - 0.2
    assert sight.votes(points[below], 0.05)[:, 0].any()
    assert not upper.votes(points[below], 0.05)[:, 0].any()
