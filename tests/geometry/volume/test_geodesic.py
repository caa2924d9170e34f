from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.bottleneck_path import bottleneck_path
from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.geometry.volume.field import DistanceField, field_from_dense
from aquanav_tools.geometry.volume.geodesic import WaterGraph, distance_to
from aquanav_tools.types import Array, Mesh
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_cavity, tube_field


def solid(mesh: trimesh.Trimesh) -> Cavity:
    labels = np.zeros(len(mesh.faces), dtype=np.int64)
    return Cavity(Mesh(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)), labels, labels == 0, ())


def corner_field(spacing: float) -> DistanceField:
    """Two galleries, 10 m long and 2 m square, that meet in a right angle at the origin; clearance in closed form."""
    axes = [np.arange(-1.4, 9.4, spacing), np.arange(-1.4, 9.4, spacing), np.arange(-1.4, 1.4, spacing)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    to_sides = np.minimum(np.minimum(x + 1, y + 1), np.minimum(9 - x, 9 - y))
    inner = np.where((x > 1) & (y > 1), -np.minimum(x - 1, y - 1), np.hypot(np.maximum(1 - x, 0), np.maximum(1 - y, 0)))
    values = np.minimum(np.minimum(to_sides, inner), 1 - np.abs(z))
    return field_from_dense(np.array([-1.4, -1.4, -1.4]), spacing, values.astype(np.float32))


def test_distances_in_a_straight_tube_are_straight_lines(rng: np.random.Generator) -> None:
    goal = np.array([19.0, 0.3, 0.2])
    points = rng.uniform([1, -1.2, -1.2], [17, 1.2, 1.2], (300, 3))
    lengths = distance_to(tube_field(0.2), goal, 0.2).lengths_to(points)
    truth = np.linalg.norm(points - goal, axis=1)
    # The ways end at the sample nearest to the goal, up to half a cell's diagonal beside it.
    assert np.abs(lengths - truth).max() < 0.01 * 2.0 + 0.5 * np.sqrt(3) * 0.2
    assert np.median(np.abs(lengths / truth - 1)) < 0.01


@pytest.mark.parametrize("max_nodes", [300_000, 10_000])
def test_distances_around_a_corner_touch_it_at_the_clearance_kept(rng: np.random.Generator, max_nodes: int) -> None:
    clearance, goal = 0.3, np.array([8.5, 0.0, 0.0])
    ways = WaterGraph(corner_field(0.1), clearance, max_nodes).ways_from(goal)
    starts = np.column_stack([rng.uniform(-0.6, 0.3, 50), rng.uniform(4, 8.5, 50), rng.uniform(-0.6, 0.6, 50)])
    truth = []
    for start in starts:  # unrolled onto a plane: two tangents to the circle around the corner, and the arc between
        a, b = np.hypot(*(start[:2] - 1)), np.hypot(*(goal[:2] - 1))
        between = 2 * np.pi - np.arctan2(start[1] - 1, start[0] - 1) + np.arctan2(goal[1] - 1, goal[0] - 1)
        arc = between - np.arccos(clearance / a) - np.arccos(clearance / b)
        flat = np.sqrt(a**2 - clearance**2) + np.sqrt(b**2 - clearance**2) + clearance * arc
        truth.append(np.hypot(flat, start[2] - goal[2]))
    assert np.abs(ways.lengths_to(starts) / truth - 1).max() < 0.01


def test_a_path_begins_and_ends_where_it_is_asked_to_and_keeps_its_clearance() -> None:
    field = corner_field(0.1)
    ways = WaterGraph(field, 0.3).ways_from(np.array([8.0, 0.0, 0.0]))
    point = np.array([0.02, 7.77, 0.31])
    path = ways.path_to(point)
    assert path is not None
    assert np.allclose(path[-1], point)
    assert np.linalg.norm(path[0] - [8.0, 0.0, 0.0]) <= 0.5 * np.sqrt(3) * 0.1
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() == pytest.approx(ways.lengths_to(point)[0])
    dense = np.concatenate([a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in pairwise(path)])
    # Between the places looked at, half a spacing apart, a trilinear distance falls by sqrt(3) / 4 spacings at most.
    assert field.clearance(dense).min() >= 0.3 - 0.25 * np.sqrt(3) * 0.1


def test_there_is_no_way_into_water_that_is_shut_off() -> None:
    x = np.meshgrid(*[np.arange(-1.5, 1.55, 0.1)] * 3, indexing="ij")[0]
    ball = lambda cx: 0.6 - np.sqrt((x - cx) ** 2 + x.transpose(1, 0, 2) ** 2 + x.transpose(2, 1, 0) ** 2)  # noqa: E731
    field = field_from_dense(np.full(3, -1.5), 0.1, np.maximum(ball(-0.8), ball(0.8)).astype(np.float32))
    ways = WaterGraph(field, 0.1).ways_from(np.array([-0.8, 0.0, 0.0]))
    assert ways.lengths_to(np.array([[0.8, 0.0, 0.0]]))[0] == np.inf
    assert ways.path_to(np.array([0.8, 0.0, 0.0])) is None


def test_parts_of_the_water_are_the_components_that_scipy_finds(rng: np.random.Generator) -> None:
    graph = WaterGraph(tube_field(), 0.1)
    count = len(graph.points)
    edges = np.stack([np.repeat(np.arange(count), np.diff(graph.starts)), graph.neighbours], axis=1)
    for share in (0.0, 0.05, 0.5):
        sides = rng.random(count) < share
        a, b = edges[sides[edges[:, 0]] == sides[edges[:, 1]]].T
        number, truth = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(count, count)), directed=False)
        together = np.unique(np.stack([graph.parts(sides), truth]), axis=1)
        assert together.shape[1] == number  # each of the parts is one of the components
        assert len(np.unique(together[0])) == number


def test_too_little_room_is_refused_with_both_numbers() -> None:
    with pytest.raises(MeshError, match=r"3\.00 m of clearance are needed, the widest place has 2\.0\d m"):
        WaterGraph(tube_field(0.2), 3.0)


def hourglass(throat: float) -> Cavity:
    """Two chambers of radius 1.5 m that narrow to a throat, turned so that nothing lies along the grid."""
    z = np.linspace(-3.0, 3.0, 121)
    radius = throat + (1.5 - throat) * np.sin(0.5 * np.pi * np.abs(z) / 3.0) ** 2
    outline = np.column_stack([radius, z])
    shape = trimesh.creation.revolve(np.vstack([[0.0, -3.0], outline, [0.0, 3.0]]), sections=96)
    shape.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1.0, 0.4, 0.2]))
    return solid(shape)


@pytest.mark.parametrize("throat", [0.2, 0.33])
def test_the_bottleneck_path_through_an_hourglass_is_as_wide_as_its_throat(throat: float) -> None:
    cavity = hourglass(throat)
    field = distance_field(cavity.mesh, 0.1)
    axis = trimesh.transformations.rotation_matrix(0.7, [1.0, 0.4, 0.2])[:3, 2]
    found = bottleneck_path(cavity.wall_surface, field, -2.0 * axis, 2.0 * axis)
    assert found is not None
    # The turned polygon of 96 sides, and a last move of 1 % of a spacing.
    assert found.width == pytest.approx(2.0 * throat * np.cos(np.pi / 96), abs=0.04 * field.spacing)
    narrowest: Array = found.tightest
    assert abs(narrowest @ axis) < field.spacing
    assert np.linalg.norm(narrowest - (narrowest @ axis) * axis) < 0.25 * field.spacing


def test_the_bottleneck_path_in_a_tube_is_its_axis() -> None:
    cavity = tube_cavity()
    found = bottleneck_path(
        cavity.wall_surface, distance_field(cavity.mesh, 0.2), np.array([3.0, 1, 0]), np.array([TUBE_LENGTH - 3, 0, 1])
    )
    assert found is not None
    # From 1 m off the axis on, the way can only widen: its ends are its narrowest places, moved a spacing inwards.
    assert TUBE_RADIUS - 1.2 < 0.5 * found.width < TUBE_RADIUS - 1.0 + 1.87 * 0.2
    assert np.linalg.norm(found.points[len(found.points) // 2, 1:]) < 0.2


def test_a_lid_beside_the_end_of_the_bottleneck_path_is_no_wall() -> None:
    found = bottleneck_path(
        tube_cavity().wall_surface, tube_field(0.2), np.array([0.3, 0, 0]), np.array([TUBE_LENGTH - 0.3, 0, 0])
    )
    assert found is not None
    assert found.width > TUBE_RADIUS  # as near as they are, lids would leave 0.6 m
