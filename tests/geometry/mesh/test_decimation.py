"""Merging triangles, against the surface they came from."""

from __future__ import annotations

import igl
import numpy as np
import trimesh

from aquanav_tools.geometry.mesh.decimation import faces_near, merge_faces, simplify
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.types import Mesh


def bumpy_sphere(seed: int, noise: float) -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=1.0)
    rng = np.random.default_rng(seed)
    radius = 1.0 + noise * rng.standard_normal((len(sphere.vertices), 1))
    return Mesh(np.array(sphere.vertices) * radius, np.array(sphere.faces, dtype=np.int64))


def test_merging_keeps_the_surface_within_the_tolerance_and_drops_most_faces() -> None:
    sphere = bumpy_sphere(0, 0.002)
    merged = simplify(sphere, 0.01)
    assert len(merged.faces) < 0.5 * len(sphere.faces)
    assert merged.to_trimesh().is_volume
    distance = np.sqrt(igl.point_mesh_squared_distance(sphere.vertices, merged.vertices, merged.faces)[0])
    assert np.median(distance) < 0.5 * 0.01
    assert np.percentile(distance, 99) < 2.0 * 0.01


def test_where_merging_makes_faces_cross_the_wall_is_left_as_it_is() -> None:
    """The sharp rim of a lens folds over itself when its faces are merged by a sixth of the lens's thickness."""
    sphere = bumpy_sphere(0, 0.002)
    lens = Mesh(sphere.vertices * [1.0, 1.0, 0.03], sphere.faces)
    assert len(self_intersections(merge_faces(lens, np.zeros(len(lens.faces), dtype=np.int64), 0.01)))
    kept = simplify(lens, 0.01)
    assert not len(self_intersections(kept))
    assert kept.to_trimesh().is_volume
    assert len(kept.faces) < 0.5 * len(lens.faces)


def test_faces_of_their_own_label_stay_as_they_are() -> None:
    sphere = bumpy_sphere(3, 0.002)
    top = sphere.triangles.mean(axis=1)[:, 2] > 0.8
    labels = np.where(top, 1 + np.arange(len(sphere.faces)), 0)
    merged = merge_faces(sphere, labels, 0.01)
    found = {tuple(row) for row in merged.triangles.mean(axis=1).round(4)}
    expected = {tuple(row) for row in sphere.triangles[top].astype(np.float32).astype(np.float64).mean(axis=1).round(4)}
    assert len(expected - found) < 0.02 * len(expected)


def test_a_small_face_lies_at_the_large_one_whose_corners_are_far() -> None:
    box = trimesh.creation.box(extents=(10.0, 10.0, 10.0))
    speck = Mesh(np.array([[2.0, 1.0, 5.0], [2.1, 1.0, 5.0], [2.0, 1.1, 5.0]]), np.array([[0, 1, 2]]))
    is_near = faces_near(Mesh(np.array(box.vertices), np.array(box.faces)), speck, np.array([0]), 0.01)
    assert np.flatnonzero(is_near).size == 1
    assert np.allclose(box.face_normals[is_near], [0.0, 0.0, 1.0])
