from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.scan.orientation import FacingSurface, face_areas, is_gap, orient_outward
from aquanav_tools.geometry.mesh.patches import find_patches
from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.types import Mesh
from tests.cave.open_caves import RADIUS, straight

OFFSET = 0.01


def face(mesh: Mesh) -> FacingSurface:
    return orient_outward(find_patches(mesh), OFFSET)


def radial_normals(mesh: Mesh) -> np.ndarray:
    """How far the normals of a tube along x point away from its axis, in [-1, 1]."""
    _, normals = face_areas(mesh)
    middles = mesh.triangles.mean(axis=1)[:, 1:]
    return np.einsum("fi,fi->f", normals[:, 1:], middles) / np.linalg.norm(middles, axis=1)


def soup(mesh: Mesh) -> Mesh:
    return Mesh(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))


@pytest.mark.parametrize("is_inverted", [False, True])
def test_normals_of_a_tube_point_out_of_its_water(is_inverted: bool) -> None:
    tube = straight()
    facing = face(Mesh(tube.vertices, tube.faces[:, ::-1] if is_inverted else tube.faces))
    assert radial_normals(facing.mesh).min() > 0.9
    assert facing.turned_share == pytest.approx(float(is_inverted))
    assert facing.hidden_share == 0.0


def test_a_soup_of_triangles_wound_at_random_faces_the_water(rng: np.random.Generator) -> None:
    loose = soup(straight())
    is_turned = rng.random(len(loose.faces)) < 0.5
    facing = face(Mesh(loose.vertices, np.where(is_turned[:, None], loose.faces[:, ::-1], loose.faces)))
    # Every triangle decides for itself; those at the very ends see the open on both sides.
    inner = np.abs(facing.mesh.triangles.mean(axis=1)[:, 0] - 5.0) < 4.5
    assert radial_normals(facing.mesh)[inner].min() > 0.9


def test_of_two_layers_of_a_wall_the_inner_one_stays() -> None:
    tube = straight()
    outer = tube.vertices * [1.0, 1.05, 1.05]
    facing = face(Mesh(np.vstack([tube.vertices, outer]), np.vstack([tube.faces, tube.faces + len(outer)])))
    radii = np.linalg.norm(facing.mesh.triangles.mean(axis=1)[:, 1:], axis=1)
    assert radii.max() <= RADIUS
    # Pappus: areas of coaxial tubes are as their radii.
    assert facing.hidden_share == pytest.approx(1.05 / 2.05, abs=0.01)


def test_a_real_looking_cave_is_turned_as_a_whole() -> None:
    cave = synthetic.demo_cave(synthetic.CaveOptions(voxel=0.12))
    facing = face(Mesh(cave.mesh.vertices, cave.mesh.faces[:, ::-1]))
    assert np.array_equal(facing.mesh.faces, cave.mesh.faces)


def test_a_gap_is_told_from_a_passage() -> None:
    tube = straight()
    faces = np.flatnonzero(np.abs(tube.triangles.mean(axis=1)[:, 0] - 5.0) < 2.0)
    assert not is_gap(tube, faces, 0.5, OFFSET).any()
    # The same wall looked at from the rock, with a second layer around it, 5 cm away.
    outer = Mesh(tube.vertices * [1.0, 1.05, 1.05], tube.faces)
    both = Mesh(np.vstack([outer.vertices, tube.vertices]), np.vstack([outer.faces, tube.faces + len(tube.vertices)]))
    assert is_gap(both, faces, 0.5, OFFSET).all()
