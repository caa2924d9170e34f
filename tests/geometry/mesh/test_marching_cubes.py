"""Surfaces of sampled fields: closed whatever the samples are, and where the field says."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.geometry.mesh.marching_cubes import marching_cubes
from aquanav_tools.types import Mesh


def surface(field: np.ndarray) -> Mesh:
    vertices, faces, places = marching_cubes(field.astype(np.float32))
    assert len(np.unique(places, axis=0)) == len(vertices)
    return Mesh(vertices, faces)


def test_a_sphere_has_the_volume_and_radius_of_one() -> None:
    offsets = np.indices((48, 48, 48)) - 23.3
    mesh = surface(np.linalg.norm(offsets, axis=0) - 18.2)
    # Chords of a cell's length lie at most 1 / (8 * 18.2) within the sphere, an edge's crossing is off by less.
    assert np.abs(np.linalg.norm(mesh.vertices - 23.3, axis=1) - 18.2).max() < 0.01
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * 18.2**3, rel=3e-3)


def test_noise_of_any_topology_gives_a_closed_surface_that_crosses_itself_nowhere(rng: np.random.Generator) -> None:
    field = rng.normal(size=(16, 17, 18))
    field[[0, -1]] = field[:, [0, -1]] = field[:, :, [0, -1]] = 1.0
    mesh = surface(field)
    solid = mesh.to_trimesh()
    assert solid.is_watertight and solid.is_winding_consistent
    assert not len(self_intersections(mesh))
    # Every sample lies on its own side: inside where it is negative.
    places = np.argwhere(np.abs(field) > 0.05)
    assert np.array_equal(solid.contains(places), field[tuple(places.T)] < 0.0)


def test_a_face_whose_middle_decides_joins_water_there_and_only_there() -> None:
    field = np.full((4, 4, 4), 1.0)
    field[1, 1, 1] = field[2, 2, 1] = -1.0
    apart = surface(np.where(field > 0.0, 2.0, field))
    joined = surface(np.where(field > 0.0, 0.2, field))
    assert len(apart.to_trimesh().split()) == 2
    assert len(joined.to_trimesh().split()) == 1
