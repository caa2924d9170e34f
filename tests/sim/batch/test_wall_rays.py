"""Exact rays to the wall's triangles, beside all triangles tried in double precision."""

from __future__ import annotations

import functools
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp
from scipy.ndimage import map_coordinates

from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.cell_triangles import triangles_in_cells
from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.geometry.volume.field import BRICK, DistanceField
from aquanav_tools.sim.batch.field import Grid, make_grid, on_grid, room_at
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device, sequence
from aquanav_tools.sim.batch.wall_rays import Wall, face_normal, least_in_cells, make_wall, meet_wall
from aquanav_tools.synthetic.caves import CaveOptions, demo_cave
from aquanav_tools.types import Mesh

wp.set_module_options(OPTIONS)
LENGTH = 4.0
"""Of the rays, m."""


@wp.kernel
def cast(
    wall: Wall,
    grid: Grid,
    middle: wp.vec3d,
    origins: wp.array(dtype=wp.vec3d),
    directions: wp.array(dtype=wp.vec3),
    length: float,
    distances: wp.array(dtype=float),
    normals: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    place = on_grid(grid, origins[i])
    met = meet_wall(wall, grid, place, room_at(grid, place), wp.vec3(origins[i] - middle), directions[i], length)
    distances[i] = met.distance
    normals[i] = face_normal(wall, met)


@functools.cache
def rough_cave() -> tuple[Mesh, DistanceField]:
    mesh = demo_cave(CaveOptions(length=5.0, voxel=0.1)).truth
    return mesh, distance_field(mesh, 0.08)


def cast_all(origins: np.ndarray, directions: np.ndarray, length: float = LENGTH) -> tuple[np.ndarray, np.ndarray]:
    """Return the (R,) distances and (R, 3) normals that rays find in the rough cave."""
    device, (mesh, field) = find_device("cpu"), rough_cave()
    middle = mesh.vertices.mean(axis=0)
    wall, grid = make_wall(mesh, field, middle, device), make_grid(field, device)
    starts = wp.array(origins, dtype=wp.vec3d, device=device)
    ways = wp.array(directions.astype(np.float32), dtype=wp.vec3, device=device)
    distances = wp.zeros(len(origins), dtype=float, device=device)
    normals = wp.zeros(len(origins), dtype=wp.vec3, device=device)
    inputs = [wall, grid, wp.vec3d(*middle), starts, ways, length, distances, normals]
    wp.launch(cast, dim=len(origins), inputs=inputs, device=device)
    return distances.numpy(), normals.numpy()


def first_of_all(origin: np.ndarray, direction: np.ndarray) -> tuple[float, np.ndarray]:
    """Return how far a ray comes, and the normal of what it meets, of all triangles in turn, in float64."""
    first, second, third = np.moveaxis(rough_cave()[0].triangles, 1, 0)
    normals = np.cross(second - first, third - first)
    with np.errstate(divide="ignore", invalid="ignore"):  # rays along a face
        along = ((first - origin) * normals).sum(axis=1) / (normals @ direction)
        points = origin + along[:, None] * direction
        sides = [
            (np.cross(b - a, points - a) * normals).sum(axis=1)
            for a, b in ((first, second), (second, third), (third, first))
        ]
        is_met = (np.min(sides, axis=0) >= 0.0) & (along >= 0.0)
    along = np.where(is_met, along, np.inf)
    nearest = int(along.argmin())
    return min(float(along[nearest]), LENGTH), normals[nearest] / np.linalg.norm(normals[nearest])


def places_in_water(rng: np.random.Generator, num: int, clearance: float) -> np.ndarray:
    """Return (num, 3) places with some clearance, m, and more."""
    field = rough_cave()[1]
    indices, found = field.water()
    roomy = indices[found > clearance]
    return field.positions(roomy[rng.integers(len(roomy), size=num)])


def test_rays_meet_the_nearest_of_all_triangles(rng: np.random.Generator) -> None:
    origins, directions = places_in_water(rng, 300, 0.02), rng.normal(size=(300, 3))
    directions[:30] = np.eye(3)[rng.integers(3, size=30)]  # along the field's cells, two components zero
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions.astype(np.float32).astype(np.float64)
    distances, normals = cast_all(origins, directions)
    expected = [first_of_all(*ray) for ray in zip(origins, directions, strict=True)]
    # Float32 resolves 2e-7 m here, which along a wall that is met at a slant of 1 in 50 is 1e-5 m.
    np.testing.assert_allclose(distances, [distance for distance, _ in expected], atol=2e-5)
    is_met = distances < LENGTH
    assert 200 < is_met.sum() < 300
    np.testing.assert_allclose(normals[is_met], np.array([normal for _, normal in expected])[is_met], atol=1e-3)
    assert not normals[~is_met].any()


def test_no_ray_gets_through_an_edge_or_a_corner(rng: np.random.Generator) -> None:
    mesh, field = rough_cave()
    aims = np.concatenate([mesh.vertices, mesh.triangles[:, :2].mean(axis=1)])
    origins = places_in_water(rng, len(aims), 0.1)
    ways = aims - origins
    far = np.linalg.norm(ways, axis=1)
    distances, _ = cast_all(origins, ways / far[:, None], 20.0)
    assert (np.abs(distances - far) < 1e-4).mean() > 0.5  # others meet wall before, or pass by what juts out
    shares = np.linspace(0.0, 1.0, 60)[:, None, None]
    passed = origins + shares * (distances / far)[:, None] * ways
    # Rock is never farther in the water than the field errs at most.
    assert field.clearance(passed.reshape(-1, 3)).min() > -np.sqrt(3) / 2 * field.spacing


def test_every_place_on_the_wall_is_in_a_cell_with_its_triangle(rng: np.random.Generator) -> None:
    mesh, field = rough_cave()
    starts, members = triangles_in_cells(mesh, field, 4, 0.02)
    shares = rng.dirichlet(np.ones(3), size=len(mesh.faces))
    points = np.einsum("tc,tcx->tx", shares, mesh.triangles)
    for triangle, place in enumerate(np.floor((points - field.origin) / field.spacing).astype(int)):
        x, y, z = place % BRICK // 4
        cell = 8 * field.bricks[tuple(place // BRICK)] + 4 * x + 2 * y + z
        assert triangle in members[starts[cell] : starts[cell + 1]]
    assert len(members) < 6 * len(mesh.faces)


def test_a_wall_that_is_not_the_fields_is_refused() -> None:
    mesh, field = rough_cave()
    moved = Mesh(mesh.vertices + [0.0, 0.0, 3.0], mesh.faces)
    with pytest.raises(MeshError, match=r"\d+ of \d+ corners .* not of the same cave"):
        triangles_in_cells(moved, field, 4, 0.02)


@wp.kernel
def append(values: wp.array(dtype=float), added: float):
    values[0] = 2.0 * values[0] + added


def test_sequences_run_in_order_and_are_recorded_in_threads_at_once() -> None:
    device = find_device("cpu")

    def count() -> float:
        values = wp.zeros(1, dtype=float, device=device)
        launches = [
            wp.launch(append, dim=1, inputs=[values, added], device=device, record_cmd=True)
            for added in (1.0, 0.0, 3.0)
        ]
        run = sequence(launches, device)
        assert values.numpy()[0] == 0.0  # nothing runs while it is recorded
        run()
        run()
        return float(values.numpy()[0])

    with ThreadPoolExecutor(8) as threads:
        found = list(threads.map(lambda _: count(), range(200)))
    assert found == [63.0] * 200


def test_what_another_thread_does_meanwhile_is_no_part_of_a_sequence() -> None:
    """Warp wrote it into the recording from both threads at once, which corrupted the heap."""
    device = find_device("cpu")
    others: list[weakref.ref[object]] = []

    class Meanwhile:
        def launch(self) -> None:
            threads.submit(lambda: others.append(weakref.ref(wp.zeros(1, dtype=float, device=device)))).result()

    values = wp.zeros(1, dtype=float, device=device)
    launch = wp.launch(append, dim=1, inputs=[values, 1.0], device=device, record_cmd=True)
    with ThreadPoolExecutor(1) as threads:
        run = sequence([launch, Meanwhile(), launch], device)
    assert [other() for other in others] == [None], "the sequence keeps another thread's array"
    run()
    assert values.numpy()[0] == 3.0


def test_least_clearance_in_a_cell_is_a_bound(rng: np.random.Generator) -> None:
    """Rounding of float32 apart, interpolation between samples never goes below it, up to the cell's far faces."""
    samples = rng.normal(size=(5, 9, 9, 9)).astype(np.float32)
    least = least_in_cells(DistanceField(np.zeros(3), 1.0, np.zeros((1, 1, 1), dtype=np.int32), samples))
    for brick, cell in np.ndindex(5, 8):
        corner = 4.0 * np.array(np.unravel_index(cell, (2, 2, 2)))
        places = (corner + rng.uniform(0.0, 4.0, (200, 3))).T
        assert map_coordinates(samples[brick].astype(float), places, order=1).min() >= least[brick, cell] - 1e-6
