from __future__ import annotations

from dataclasses import replace

import igl
import numpy as np
import pytest
import trimesh
from scipy.interpolate import RegularGridInterpolator

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.distance import choose_spacing, distance_field
from aquanav_tools.geometry.volume.field import BAND, DistanceField, field_from_dense
from aquanav_tools.geometry.volume.scanline import find_crossings
from aquanav_tools.synthetic.caves import CaveOptions, demo_cave
from aquanav_tools.types import Mesh
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_cavity, tube_clearance


def box_cavity(extents: tuple[float, float, float]) -> Cavity:
    box = trimesh.creation.box(extents)
    mesh = Mesh(np.array(box.vertices), np.array(box.faces, dtype=np.int64))
    return Cavity(mesh, np.zeros(12, dtype=np.int64), np.ones(12, dtype=bool), ())


def box_clearance(points: np.ndarray, extents: tuple[float, float, float]) -> np.ndarray:
    """Signed distance to a box, positive inside."""
    beyond = np.abs(points) - np.array(extents) / 2
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return np.where(outside > 0, -outside, -beyond.max(axis=-1))


def all_points(field: DistanceField) -> np.ndarray:
    return field.positions(np.stack(np.meshgrid(*map(np.arange, field.shape), indexing="ij"), axis=-1).reshape(-1, 3))


def test_all_samples_are_exact() -> None:
    extents = (3.0, 1.0, 2.0)
    field = distance_field(box_cavity(extents).mesh, 0.1)
    points = all_points(field)
    expected = np.maximum(box_clearance(points, extents), -BAND * field.spacing)
    assert np.abs(field.clearance(points) - expected).max() < 1e-5  # float32, and the rounding of positions


def test_a_rough_caves_samples_are_those_that_libigl_finds(rng: np.random.Generator) -> None:
    mesh = demo_cave(CaveOptions(length=5.0)).truth
    field = distance_field(mesh, 0.1)
    points = rng.permutation(all_points(field))[:40_000]
    distance = np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[0])
    is_water = igl.fast_winding_number(mesh.vertices, mesh.faces, points) > 0.5
    expected = np.where(is_water, distance, np.maximum(-distance, -BAND * field.spacing))
    assert is_water.sum() > 5000
    assert np.abs(field.clearance(points) - expected).max() < 1e-5


def test_the_water_is_all_samples_with_clearance() -> None:
    field = distance_field(box_cavity((3.0, 1.0, 2.0)).mesh, 0.1)
    indices, clearance = field.water()
    assert len(indices) == (field.clearance(all_points(field)) > 0).sum()
    assert np.allclose(field.clearance(field.positions(indices)), clearance, atol=1e-6)
    assert field.max_clearance == clearance.max()


def test_no_face_need_be_in_general_position() -> None:
    # Lines through the edges and vertices of the box: the grid is moved onto them.
    corners = np.array(trimesh.creation.box((8.0, 6.0, 4.0)).triangles) + [10.0, 10.0, 10.0]
    crossings = find_crossings(corners, 20, 20)
    counts = np.diff(crossings.starts).reshape(20, 20)
    assert set(np.unique(counts)) == {0, 2}
    assert (counts == 2).sum() == 8 * 6  # half-open: of two opposite sides one counts


def test_a_surface_with_a_hole_is_refused() -> None:
    box = box_cavity((3.0, 1.0, 2.0))
    is_upward = np.isclose(box.mesh.triangles[..., 2], 1.0).all(axis=1)
    holed = replace(box, mesh=Mesh(box.mesh.vertices, np.delete(box.mesh.faces, np.argmax(is_upward), axis=0)))
    with pytest.raises(MeshError, match="surface of 11 triangles is not closed"):
        distance_field(holed.mesh, 0.1)


def test_a_dense_grid_and_its_bricks_give_the_same_clearance(rng: np.random.Generator) -> None:
    values = rng.uniform(-0.3, 1.0, (21, 13, 18)).astype(np.float32)
    field = field_from_dense(np.zeros(3), 0.1, values)
    points = rng.uniform(0, 0.1 * (np.array(values.shape) - 1), (2000, 3))
    truth = RegularGridInterpolator([0.1 * np.arange(n) for n in values.shape], values)(points)
    assert np.abs(field.clearance(points) - truth).max() < 1e-6


def test_the_grid_ends_in_rock_on_every_side() -> None:
    field = distance_field(tube_cavity().mesh, 0.2)
    indices, _ = field.water()
    assert (indices.min(axis=0) >= 1).all()
    assert (indices.max(axis=0) <= np.array(field.shape) - 2).all()


def test_spacing_follows_the_water_and_not_its_box() -> None:
    tube = tube_cavity()
    assert choose_spacing(tube.mesh, 0.3) == pytest.approx(0.1)
    # A kilometre of thin tube across a box of 10^8 m3: a dense grid of 6 million samples would be 3 m apart.
    across = np.array([[35.0, 25.0, 7.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]])
    long = replace(tube, mesh=Mesh(tube.mesh.vertices @ across, tube.mesh.faces))
    assert choose_spacing(long.mesh, 0.3) < 0.15


def test_interpolated_clearance_in_a_tube_errs_by_less_than_its_curvature_allows(rng: np.random.Generator) -> None:
    spacing = 0.25
    field = distance_field(tube_cavity().mesh, spacing)
    points = rng.uniform([0, -TUBE_RADIUS, -TUBE_RADIUS], [TUBE_LENGTH, TUBE_RADIUS, TUBE_RADIUS], (5000, 3))
    points = points[tube_clearance(points) > 0]
    error = np.abs(field.clearance(points) - tube_clearance(points))
    # At edges of equal distance trilinear interpolation loses up to a cell's half diagonal; the polygon of 64 sides
    # lies up to R (1 - cos(pi / 64)) inside the circle.
    assert error.max() < 0.87 * spacing + TUBE_RADIUS * (1 - np.cos(np.pi / 64))
    assert np.median(error) < 0.02 * spacing + TUBE_RADIUS * (1 - np.cos(np.pi / 64))


def test_clearance_changes_no_faster_than_distance(rng: np.random.Generator) -> None:
    field = distance_field(box_cavity((2.0, 2.0, 2.0)).mesh, 0.1)
    a, b = rng.uniform(-0.9, 0.9, (2, 2000, 3))
    # A trilinear patch of a 1-Lipschitz function is sqrt(3)-Lipschitz.
    change = np.abs(field.clearance(a) - field.clearance(b))
    assert (change <= np.sqrt(3) * np.linalg.norm(a - b, axis=1) + 1e-6).all()
