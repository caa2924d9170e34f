"""Eddies lose no water, vanish at walls, and have the speed that is asked of them."""

from __future__ import annotations

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.eddies import NUM_WAVES, draw_waves, eddies_at
from aquanav_tools.sim.batch.field import Grid, make_grid
from aquanav_tools.sim.batch.runtime import find_device
from tests.caves import TUBE_RADIUS, tube_field

FIELD = tube_field()


DEVICE = find_device("cpu")
GRID = make_grid(FIELD, DEVICE)
Slopes = tuple[np.ndarray, np.ndarray]


@wp.kernel
def _eddies(
    waves: wp.array2d(dtype=wp.float64), grid: Grid, coefficients: wp.array2d(dtype=wp.float64),
    places: wp.array(dtype=wp.vec3d), velocities: wp.array(dtype=wp.vec3d),
):  # fmt: skip
    i = wp.tid()
    velocities[i] = eddies_at(waves, grid, coefficients, 0, places[i])


def draw(usual: float, rng: np.random.Generator) -> np.ndarray:
    return draw_waves(FIELD, GRID, usual, rng, DEVICE)


def velocities(points: np.ndarray, waves: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """(N, 3) at (N, 3) places."""
    found = wp.zeros(len(points), dtype=wp.vec3d, device=DEVICE)
    rows = np.concatenate([[0.0], phases])[None]
    arrays = [wp.array(table, dtype=wp.float64, ndim=2, device=DEVICE) for table in (waves, rows)]
    places = wp.array(np.ascontiguousarray(points), dtype=wp.vec3d, device=DEVICE)
    wp.launch(_eddies, dim=len(points), inputs=[arrays[0], GRID, arrays[1], places], outputs=[found], device=DEVICE)
    result: np.ndarray = found.numpy()
    return result


def velocity(point: np.ndarray, waves: np.ndarray, phases: np.ndarray) -> np.ndarray:
    result: np.ndarray = velocities(point[None], waves, phases)[0]
    return result


def potential(point: np.ndarray, waves: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """The (3,) potential whose curl the velocity is, written out."""
    part = min(max(FIELD.clearance_at(point) / waves[0, 7], 0.0), 1.0)
    ramp = part**2 * (3.0 - 2.0 * part)
    angles = waves[:, :3] @ point
    heights = phases[:NUM_WAVES] * np.cos(angles) + phases[NUM_WAVES:] * np.sin(angles)
    total: np.ndarray = ramp * heights @ waves[:, 3:6]
    return total


def inside_a_cell(rng: np.random.Generator) -> np.ndarray:
    """A place in the tube that is not within a hundredth of a spacing of a cell's border."""
    index = np.array([rng.integers(20, 180), *(rng.integers(8, 32, size=2))])
    return FIELD.origin + FIELD.spacing * (index + rng.uniform(0.05, 0.95, size=3))


def test_velocity_is_the_curl_of_the_potential(rng: np.random.Generator) -> None:
    waves, phases = draw(0.8 * TUBE_RADIUS, rng), rng.normal(size=2 * NUM_WAVES)
    step = 1e-4 * FIELD.spacing
    for _ in range(50):
        point = inside_a_cell(rng)
        slopes = np.array(
            [
                (potential(point + step * axis, waves, phases) - potential(point - step * axis, waves, phases))
                / (2 * step)
                for axis in np.eye(3)
            ]
        )
        curl = [slopes[1, 2] - slopes[2, 1], slopes[2, 0] - slopes[0, 2], slopes[0, 1] - slopes[1, 0]]
        # The kernel's samples of 16 bits are off by 3e-5 spacings at most, so a slope of the clearance by 6e-5; central
        # differences over 1e-5 m of values of order 1 add 1e-6.
        np.testing.assert_allclose(velocity(point, waves, phases), curl, atol=6e-5)


def test_eddies_lose_no_water(rng: np.random.Generator) -> None:
    waves, phases = draw(0.8 * TUBE_RADIUS, rng), rng.normal(size=2 * NUM_WAVES)
    nodes, weights = np.polynomial.legendre.leggauss(6)
    for _ in range(10):
        low = inside_a_cell(rng)
        index = np.floor((low - FIELD.origin) / FIELD.spacing)
        size = FIELD.origin + FIELD.spacing * (index + 0.999) - low  # the rest of the cell, where all is smooth
        net, gross = 0.0, 0.0
        for axis in range(3):
            others = [other for other in range(3) if other != axis]
            for end, sign in ((0.0, -1.0), (1.0, 1.0)):
                for a, wa in zip(nodes, weights, strict=True):
                    for b, wb in zip(nodes, weights, strict=True):
                        share = np.empty(3)
                        share[axis], share[others[0]], share[others[1]] = end, 0.5 + 0.5 * a, 0.5 + 0.5 * b
                        area = 0.25 * wa * wb * np.prod(size[others])
                        flux = sign * area * velocity(low + share * size, waves, phases)[axis]
                        net, gross = net + flux, gross + abs(flux)
        assert abs(net) < 1e-6 * gross


def test_eddies_vanish_at_the_wall_and_in_rock(rng: np.random.Generator) -> None:
    waves, phases = draw(1.0, rng), rng.normal(size=2 * NUM_WAVES)
    angles = rng.uniform(0.0, 2.0 * np.pi, 40)
    for x, angle in zip(rng.uniform(2.0, 18.0, 40), angles, strict=True):
        outward = np.array([0.0, np.cos(angle), np.sin(angle)])
        near = np.array([x, 0.0, 0.0]) + (TUBE_RADIUS - 0.02) * outward
        clearance = FIELD.clearance_at(near)
        usual = np.abs(velocity(np.array([x, 0.0, 0.0]), waves, phases)).max() + 1.0
        # The ramp rises with the square of the clearance: its slope is 6 clearance / width^2 at the wall.
        assert np.abs(velocity(near, waves, phases)).max() < 20.0 * clearance * usual
        assert not velocity(np.array([x, 0.0, 0.0]) + (TUBE_RADIUS + 0.3) * outward, waves, phases).any()


def test_their_root_mean_square_speed_over_the_water_is_one(rng: np.random.Generator) -> None:
    waves = draw(1.0, rng)
    indices, _ = FIELD.water()
    squares = []
    for _ in range(60):
        points = FIELD.positions(indices[rng.choice(len(indices), 1000)])
        squares.append((velocities(points, waves, rng.normal(size=2 * NUM_WAVES)) ** 2).sum(axis=1))
    # 60 groups that share their phases, each with a relative spread of about 0.3.
    assert 0.85 < np.mean(squares) < 1.15
