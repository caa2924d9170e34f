from __future__ import annotations

import numpy as np
import trimesh

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.distance import BAND, distance_field
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


def test_samples_in_water_and_near_walls_are_exact() -> None:
    extents = (3.0, 1.0, 2.0)
    field = distance_field(box_cavity(extents), 0.1)
    index = np.stack(np.meshgrid(*map(np.arange, field.values.shape), indexing="ij"), axis=-1)
    truth = box_clearance(field.positions(index), extents)
    expected = np.maximum(truth, -BAND * field.spacing)
    assert np.abs(field.values - expected).max() < 1e-5  # float32


def test_the_grid_ends_in_rock_on_every_side() -> None:
    values = distance_field(tube_cavity(), 0.2).values
    for axis in range(3):
        assert values.take(0, axis).max() < 0
        assert values.take(-1, axis).max() < 0


def test_interpolated_clearance_in_a_tube_errs_by_less_than_its_curvature_allows(rng: np.random.Generator) -> None:
    spacing = 0.25
    field = distance_field(tube_cavity(), spacing)
    points = rng.uniform([0, -TUBE_RADIUS, -TUBE_RADIUS], [TUBE_LENGTH, TUBE_RADIUS, TUBE_RADIUS], (5000, 3))
    points = points[tube_clearance(points) > 0]
    error = np.abs(field.clearance(points) - tube_clearance(points))
    # At edges of equal distance trilinear interpolation loses up to a cell's half diagonal; the polygon of 64 sides
    # lies up to R (1 - cos(pi / 64)) inside the circle.
    assert error.max() < 0.87 * spacing + TUBE_RADIUS * (1 - np.cos(np.pi / 64))
    assert np.median(error) < 0.02 * spacing + TUBE_RADIUS * (1 - np.cos(np.pi / 64))


def test_clearance_changes_no_faster_than_distance(rng: np.random.Generator) -> None:
    field = distance_field(box_cavity((2.0, 2.0, 2.0)), 0.1)
    a, b = rng.uniform(-0.9, 0.9, (2, 2000, 3))
    # A trilinear patch of a 1-Lipschitz function is sqrt(3)-Lipschitz.
    change = np.abs(field.clearance(a) - field.clearance(b))
    assert (change <= np.sqrt(3) * np.linalg.norm(a - b, axis=1) + 1e-6).all()
