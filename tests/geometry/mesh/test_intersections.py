from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog

from aquanav_tools.geometry.mesh.box_tree import build_tree, next_leaf
from aquanav_tools.geometry.mesh.intersections import faces_cross, self_intersections
from aquanav_tools.geometry.mesh.predicates import side_of_line, side_of_plane
from aquanav_tools.types import Mesh

TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
TETRAHEDRON_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def pairs(vertices: object, faces: object) -> list[list[int]]:
    return self_intersections(Mesh(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64))).tolist()


def interiors_meet(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether a point of both triangles has only positive weights in both: a linear programme for the least weight."""
    on_both = np.hstack([first.T, -second.T, np.zeros((3, 1))])
    sums = np.array([[1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0]])
    least = np.hstack([-np.eye(6), np.ones((6, 1))])
    best = linprog(
        [0.0] * 6 + [-1.0],
        A_ub=least,
        b_ub=np.zeros(6),
        A_eq=np.vstack([on_both, sums]),
        b_eq=[0.0, 0.0, 0.0, 1.0, 1.0],
        bounds=[(None, None)] * 7,
    )
    return best.status == 0 and best.x[6] > 1e-7  # least weights of triangles on a grid of 4 are fractions above 1e-4


def exact_sign(rows: np.ndarray) -> int:
    a, b, c, d = ([Fraction(float(x)) for x in row] for row in rows)
    u, v, w = ([x - y for x, y in zip(point, a, strict=True)] for point in (b, c, d))
    value = sum(w[i] * (u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3]) for i in range(3))
    return (value > 0) - (value < 0)


def test_a_sphere_does_not_cross_itself() -> None:
    sphere = trimesh.creation.icosphere(4)
    assert pairs(sphere.vertices, sphere.faces) == []


def test_two_tetrahedra_cross_where_one_pokes_into_the_other() -> None:
    # The tip of the second, upside down and shifted, goes through one face of the first and stays inside it: the
    # three faces around the tip cross that face and no other.
    tip = np.array([0.2, 0.2, 0.2])
    second = tip + np.array([[0.0, 0.0, 0.0], [2.0, 2.0, 1.0], [1.0, 2.0, 2.0], [2.0, 1.0, 2.0]])
    vertices = np.vstack([TETRAHEDRON, second])
    found = pairs(vertices, np.vstack([TETRAHEDRON_FACES, TETRAHEDRON_FACES[:, ::-1] + 4]))
    assert found == [[3, 4], [3, 5], [3, 6]]


def test_an_edge_neighbour_folded_flat_counts_and_an_open_one_does_not() -> None:
    corners = [[0, 0, 0], [2, 0, 0], [1, 1, 0]]
    assert pairs([*corners, [1, 0.5, 0]], [[0, 1, 2], [1, 0, 3]]) == [[0, 1]]
    assert pairs([*corners, [1, -0.5, 0]], [[0, 1, 2], [1, 0, 3]]) == []
    assert pairs([*corners, [1, 0.5, 1e-90]], [[0, 1, 2], [1, 0, 3]]) == []


def test_a_vertex_neighbour_counts_only_where_it_crosses_beyond_the_vertex() -> None:
    flat = [[0, 0, 0], [2, 0, 0], [0, 2, 0]]
    assert pairs([*flat, [1, 0.2, 1], [0.2, 1, -1]], [[0, 1, 2], [0, 3, 4]]) == [[0, 1]]
    assert pairs([*flat, [1, 0.2, 1], [0.2, 1, 1]], [[0, 1, 2], [0, 3, 4]]) == []


@pytest.mark.parametrize(
    "other",
    [
        [[0.5, 0.5, 0], [0.5, 0.5, 1], [0.7, 0.5, 1]],  # stands on a corner
        [[0.4, 0.5, 0], [0.6, 0.5, 0], [0.5, 0.5, 1]],  # stands on an edge
        [[1, 1, 0], [2, 2, 0], [2, 1, 0]],  # leans on an edge from outside, in the same plane
        [[2, 0, 0], [3, 0, 0], [2, 1, 0]],  # shares a corner that is not welded
        [[0.1, 0.1, 0], [0.2, 0.2, 0], [0.3, 0.3, 0]],  # has no area
    ],
)
def test_faces_that_only_touch_do_not_count(other: list[list[float]]) -> None:
    assert pairs([[0, 0, 0], [2, 0, 0], [0, 2, 0], *other], [[0, 1, 2], [3, 4, 5]]) == []


def test_a_doubled_face_counts() -> None:
    assert pairs(TETRAHEDRON, [*TETRAHEDRON_FACES, [1, 3, 2]]) == [[3, 4]]


def test_random_triangles_on_a_coarse_grid_agree_with_a_linear_programme(rng: np.random.Generator) -> None:
    # A grid of 4 makes every kind of degenerate contact common.
    triangles = rng.integers(0, 4, (300, 2, 3, 3)).astype(np.float64)
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    found = [faces_cross(pair.reshape(6, 3), faces, 0, 1) for pair in triangles]
    expected = [_has_area(pair) and interiors_meet(*pair) for pair in triangles]
    assert found == expected
    assert 20 < sum(expected) < 280


def _has_area(pair: np.ndarray) -> bool:
    sides = pair[:, 1:] - pair[:, :1]
    return bool(np.all(np.any(np.cross(sides[:, 0], sides[:, 1]) != 0, axis=1)))


def test_signs_are_exact_where_floats_round(rng: np.random.Generator) -> None:
    corners = rng.normal(size=(300, 3, 3))
    weights = rng.dirichlet([1.0, 1.0, 1.0], 300)
    fourth = np.einsum("nij,ni->nj", corners, weights)  # in the plane but for rounding
    points = np.concatenate([corners, fourth[:, None]], axis=1)
    expected = [exact_sign(rows) for rows in points]
    assert [side_of_plane(rows, 0, 1, 2, 3) for rows in points] == expected
    assert len(set(expected)) > 1
    with_x_one = np.array([[0.1, 0.1, 0.0], [0.3, 0.3, 0.0], [0.7, 0.7, 0.0]])
    assert side_of_line(with_x_one, 0, 1, 2, 0, 1) == 0
    with_x_one[2, 1] = np.nextafter(0.7, 1.0)
    assert side_of_line(with_x_one, 0, 1, 2, 0, 1) == 1


@pytest.mark.parametrize("step", [1.0, 0.1, 2.0**-20])
def test_signs_of_points_on_a_grid_are_exact(rng: np.random.Generator, step: float) -> None:
    # Corners of parallelograms: in one plane where the step is a power of two, and but for rounding where it is none.
    whole = rng.integers(-30, 30, (300, 3, 3))
    points = step * np.concatenate([whole, (whole[:, 1] + whole[:, 2] - whole[:, 0])[:, None]], axis=1)
    expected = [exact_sign(rows) for rows in points]
    assert [side_of_plane(rows, 0, 1, 2, 3) for rows in points] == expected
    assert (len(set(expected)) > 1) == (step == 0.1)


def test_the_box_tree_finds_all_pairs_of_boxes_that_meet(rng: np.random.Generator) -> None:
    low = rng.uniform(size=(137, 3))
    high = low + 0.4 * rng.uniform(size=(137, 3)) ** 3
    tree, order = build_tree(low, high)
    found = set()
    for leaf in range(137):
        other = next_leaf(tree, leaf, leaf)
        while other >= 0:
            found.add(frozenset((int(order[leaf]), int(order[other]))))
            other = next_leaf(tree, leaf, other)
    meet = np.all((low[:, None] <= high) & (low <= high[:, None]), axis=2)
    expected = {frozenset((int(a), int(b))) for a, b in np.argwhere(np.triu(meet, 1))}
    assert found == expected


def test_a_crumpled_sphere_agrees_with_brute_force(rng: np.random.Generator) -> None:
    sphere = trimesh.creation.icosphere(2)
    vertices = sphere.vertices + 0.15 * rng.normal(size=sphere.vertices.shape)
    faces = np.array(sphere.faces, dtype=np.int64)
    expected = [
        [i, j] for i in range(len(faces)) for j in range(i + 1, len(faces)) if faces_cross(vertices, faces, i, j)
    ]
    assert len(expected) > 50
    assert pairs(vertices, faces) == expected
