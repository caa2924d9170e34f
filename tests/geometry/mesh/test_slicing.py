"""Plane cuts of closed meshes with known sections."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import to_manifold
from aquanav_tools.geometry.mesh.slicing import slice_mesh
from aquanav_tools.types import Mesh

Z = np.array([0.0, 0.0, 1.0])


def area(rings: list[np.ndarray]) -> float:
    return manifold3d.CrossSection(rings, manifold3d.FillRule.EvenOdd).area()


def mesh_of(solid: trimesh.Trimesh) -> Mesh:
    return Mesh(np.array(solid.vertices), np.array(solid.faces, dtype=np.int64))


@pytest.mark.parametrize("height", [0.0, 0.3, -0.9])
def test_a_ball_is_cut_along_one_circle(height: float) -> None:
    (ring,) = slice_mesh(mesh_of(trimesh.creation.icosphere(4)), height * Z, np.eye(3))
    # Facets of 5 degrees lie within 0.1 % of the radius of their sphere.
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), np.sqrt(1 - height**2), atol=0.003)


def test_a_torus_lying_down_is_cut_along_two_circles() -> None:
    torus = mesh_of(trimesh.creation.torus(3.0, 1.0, major_sections=96, minor_sections=48))
    rings = slice_mesh(torus, np.zeros(3), np.eye(3))
    assert sorted(np.linalg.norm(ring, axis=1).mean() for ring in rings) == pytest.approx([2.0, 4.0], abs=0.01)


def test_a_plane_beside_the_mesh_cuts_nothing() -> None:
    assert slice_mesh(mesh_of(trimesh.creation.box()), 3.0 * Z, np.eye(3)) == []


@pytest.mark.parametrize(("height", "expected"), [(-0.5, 0.0), (0.5, 1.0), (0.25, 1.0)])
def test_a_plane_through_faces_and_vertices_closes_its_rings(height: float, expected: float) -> None:
    """A face in the plane counts as above it."""
    assert area(slice_mesh(mesh_of(trimesh.creation.box()), height * Z, np.eye(3))) == pytest.approx(expected)


def test_cuts_have_the_area_that_manifold_finds(rng: np.random.Generator) -> None:
    ball = trimesh.creation.icosphere(3)
    ball.vertices *= 1.0 + 0.1 * np.sin(7.0 * ball.vertices[:, [1, 2, 0]])
    mesh = mesh_of(ball)
    for _ in range(20):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        axes *= np.linalg.det(axes)
        centre = rng.uniform(-0.5, 0.5, 3)
        peer = to_manifold(mesh).transform(np.column_stack([axes, -axes @ centre])).slice(0.0)
        assert area(slice_mesh(mesh, centre, axes)) == pytest.approx(peer.area(), rel=1e-9)
