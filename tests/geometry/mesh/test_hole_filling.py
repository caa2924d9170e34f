from __future__ import annotations

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.hole_filling import fill_hole
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.geometry.mesh.patches import boundary_loops
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import Mesh


def without(mesh: Mesh, is_dropped: np.ndarray) -> Mesh:
    used, faces = np.unique(mesh.faces[~is_dropped], return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int64))


def filled(mesh: Mesh, loop: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """The closed mesh and the vertices that are new."""
    vertices, faces = fill_hole(mesh.vertices, mesh.faces, loop)
    return Mesh(np.concatenate([mesh.vertices, vertices]), np.concatenate([mesh.faces, faces])), vertices


@pytest.mark.parametrize("half_angle", [10.0, 25.0, 45.0])
def test_a_sphere_without_its_cap_becomes_a_sphere_again(half_angle: float) -> None:
    sphere = trimesh.creation.icosphere(4)
    whole = Mesh(np.array(sphere.vertices), np.array(sphere.faces, dtype=np.int64))
    is_cap = whole.triangles.mean(axis=1)[:, 2] > np.cos(np.radians(half_angle))
    mesh = without(whole, is_cap)
    (loop,) = boundary_loops(mesh)
    closed, new = filled(mesh, loop)
    prove_watertight(closed)
    assert len(self_intersections(closed)) == 0
    sagitta = 1.0 - np.cos(np.radians(half_angle))  # how far a flat lid would be from the sphere
    assert np.abs(np.linalg.norm(new, axis=1) - 1.0).max() < 0.1 * sagitta + 0.001  # facets lie 0.1 % inside


def test_a_hole_in_the_side_of_a_tube_is_filled_round() -> None:
    whole = tube(1.0, 6.0, 64, 61).truth
    hole = np.linalg.norm(whole.triangles.mean(axis=1) - [3.0, 0.0, 1.0], axis=1) < 0.6
    mesh = without(whole, hole)
    (loop,) = boundary_loops(mesh)
    closed, new = filled(mesh, loop)
    prove_watertight(closed)
    assert len(self_intersections(closed)) == 0
    # A flat lid would lie 0.2 m inside the tube.
    assert np.abs(np.hypot(new[:, 1], new[:, 2]) - 1.0).max() < 0.03


def test_new_faces_are_as_large_as_those_around() -> None:
    whole = tube(1.0, 6.0, 64, 61).truth
    hole = np.linalg.norm(whole.triangles.mean(axis=1) - [3.0, 0.0, 1.0], axis=1) < 0.6
    mesh = without(whole, hole)
    (loop,) = boundary_loops(mesh)
    _, faces = fill_hole(mesh.vertices, mesh.faces, loop)
    assert len(faces) == pytest.approx(np.count_nonzero(hole), rel=0.4)


def test_a_single_missing_triangle_needs_no_new_vertex() -> None:
    whole = tube(1.0, 6.0, 64, 61).truth
    mesh = Mesh(whole.vertices, whole.faces[1:])
    (loop,) = boundary_loops(mesh)
    vertices, faces = fill_hole(mesh.vertices, mesh.faces, loop)
    assert len(vertices) == 0
    assert sorted(faces[0]) == sorted(whole.faces[0])
    prove_watertight(Mesh(mesh.vertices, np.concatenate([mesh.faces, faces])))


def test_a_rim_that_folds_over_itself_is_refused() -> None:
    eight = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.1], [1.0, 0.0, 0.0], [0.0, 1.0, 0.1]])
    with pytest.raises(MeshError, match="folds over itself"):
        fill_hole(eight, np.zeros((0, 3), dtype=np.int64), np.arange(4))
