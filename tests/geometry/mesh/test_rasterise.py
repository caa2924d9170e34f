from __future__ import annotations

import igl
import numba
import numpy as np
import pytest

from aquanav_tools.geometry.mesh.rasterise import NO_TRIANGLE, band_distances
from aquanav_tools.synthetic.caves import CaveOptions, demo_cave
from aquanav_tools.types import Array

FLOAT32 = 1e-6  # half a unit in the last place of distances up to 2 m, with room for one sum


def grid(origin: Array, spacing: float, shape: tuple[int, int, int]) -> Array:
    return origin + spacing * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)


def soup(rng: np.random.Generator, count: int) -> Array:
    """Triangles of all sizes and shapes."""
    return rng.uniform(0, 4, (count, 1, 3)) + rng.normal(size=(count, 3, 3)) * rng.uniform(0, 1, (count, 1, 1)) ** 3


def test_every_sample_in_the_band_has_the_distance_that_libigl_finds(rng: np.random.Generator) -> None:
    triangles, origin, spacing, shape, reach = soup(rng, 300), np.array([-0.5, -0.3, -0.4]), 0.11, (43, 37, 45), 0.35
    distances, nearest = band_distances(triangles, origin, spacing, shape, reach)
    points = grid(origin, spacing, shape).reshape(-1, 3)
    faces = np.arange(900).reshape(-1, 3)
    truth = np.sqrt(igl.point_mesh_squared_distance(points, triangles.reshape(-1, 3), faces)[0])
    assert np.abs(distances.ravel() - np.minimum(truth, reach)).max() < FLOAT32
    clear = np.abs(truth - reach) > FLOAT32
    assert ((nearest.ravel() != NO_TRIANGLE) == (truth < reach))[clear].all()


def test_the_nearest_triangle_is_at_the_distance_given(rng: np.random.Generator) -> None:
    triangles, origin, spacing, shape = soup(rng, 100), np.zeros(3), 0.2, (21, 21, 21)
    distances, nearest = band_distances(triangles, origin, spacing, shape, 0.5)
    points = grid(origin, spacing, shape)
    for index in np.unique(nearest[nearest >= 0])[:20]:
        near = nearest == index
        own = igl.point_mesh_squared_distance(points[near], triangles[index], np.array([[0, 1, 2]]))[0]
        assert np.abs(np.sqrt(own) - distances[near]).max() < FLOAT32


def test_a_triangle_without_area_is_the_segment_or_the_point_that_it_is() -> None:
    # libigl 2.6.3 gives some of these segments distances that are too large.
    points = grid(np.zeros(3), 0.2, (21, 21, 21))
    for a, b, c in (((1, 1, 1), (2, 3, 1.5), (2.3, 3.6, 1.65)), ((3, 1, 2), (1, 1, 2), (2, 1, 2)), ((2, 2, 2),) * 3):
        triangle = np.array([a, b, c], dtype=float)
        low, high = triangle[np.argsort(triangle[:, 0])[[0, 2]]]
        along = high - low
        share = np.clip((points - low) @ along / max(along @ along, 1e-9), 0, 1)
        truth = np.linalg.norm(points - low - share[..., None] * along, axis=-1)
        distances, _ = band_distances(triangle[None], np.zeros(3), 0.2, (21, 21, 21), 5.0)
        assert np.abs(distances - truth).max() < FLOAT32


def test_one_thread_finds_what_many_find() -> None:
    mesh = demo_cave(CaveOptions(length=4.0)).truth
    arguments = (mesh.triangles, mesh.vertices.min(axis=0) - 0.3, 0.1, (45, 60, 50), 0.3)
    many = band_distances(*arguments)
    numba.set_num_threads(1)
    try:
        one = band_distances(*arguments)
    finally:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    assert np.array_equal(one[0], many[0])
    assert np.array_equal(one[1], many[1])


@pytest.mark.parametrize("triangles", [np.empty((0, 3, 3)), np.full((1, 3, 3), 99.0), np.full((1, 3, 3), -99.0)])
def test_triangles_out_of_reach_leave_the_grid_clipped(triangles: Array) -> None:
    distances, nearest = band_distances(triangles, np.zeros(3), 0.5, (9, 8, 7), 1.5)
    assert (distances == 1.5).all()
    assert (nearest == NO_TRIANGLE).all()
