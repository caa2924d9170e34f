from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.envs.pictures.pixel_blocks import (
    BLOCK,
    COLOUR,
    DEPTH,
    EAST,
    FINE,
    GRAIN,
    KINDS,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    NORTH,
    NOTHING,
    NUM_INTS,
    OWN_FLOATS,
    UP,
    X,
    Y,
    faded,
    look,
    triangle_table,
    wave,
)
from aquanav_tools.envs.pictures.rock_blocks import (
    fetch_corners,
    fetch_squares,
    mix_corners,
    mix_squares,
    texture_places,
)
from aquanav_tools.envs.pictures.rock_tile import RANGE, SIDE, packed_tile, rock_tile
from aquanav_tools.envs.pictures.triangles import Eye, see
from aquanav_tools.envs.pictures.wave_grid import CELL, NEAR_WAVES, wave_grid
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.types import Array

TURN = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Camera from world: it looks along x."""


def row(values: Array, at: int) -> Array:
    return values[at : at + BLOCK]


def test_normals_in_a_block_are_those_between_a_triangles_corners() -> None:
    eye = Eye(100, 60, 90.0, np.array([1.0, 2.0, 3.0]), TURN, 30.0)
    vertices = eye.centre + np.array([[4.0, 3.0, -2.0], [5.0, -3.0, -2.5], [6.0, 0.0, 4.0]])
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # so that a normal is the corners' shares
    faces, colours = np.array([[0, 1, 2]]), np.full((3, 3), 0.5)
    seen, nearness, origins = see(eye, vertices, faces)
    table = triangle_table(origins, vertices, normals, colours, faces, np.array([2]), eye.centre, TURN)
    assert (seen == 0).any()
    assert (seen == -1).any()
    np.testing.assert_array_equal(table[0, COLOUR : COLOUR + 3], 0.5)
    floats = np.zeros(OWN_FLOATS, np.float32)
    for start in (0, BLOCK):  # the second block reaches beyond the picture
        look(floats, seen[20], nearness[20], table, np.float32(eye.focal), start, 20.5 - 30.0)
        num = min(BLOCK, 100 - start)
        is_seen = seen[20, start : start + num] == 0
        np.testing.assert_array_equal(row(floats, KINDS)[:num], np.where(is_seen, 2, NOTHING))
        x, y = row(floats, X)[:num], row(floats, Y)[:num]
        np.testing.assert_allclose(x, (np.arange(start, start + num) + 0.5 - 50.0) / 90.0, atol=1e-6)
        np.testing.assert_allclose(y, (20.5 - 30.0) / 90.0, atol=1e-6)
        depth = row(floats, DEPTH)[:num, None]
        shares = depth * np.stack([row(floats, at)[:num] for at in (NORMAL_X, NORMAL_Y, NORMAL_Z)], axis=1)
        places = eye.centre + (depth * np.stack([x, y, np.ones(num)], axis=1)) @ TURN
        # Shares of corners add up to one and give the place back; float32.
        np.testing.assert_allclose(shares[is_seen].sum(axis=1), 1.0, atol=1e-5)
        np.testing.assert_allclose((shares @ vertices)[is_seen], places[is_seen], atol=1e-4)


def test_texture_in_a_block_lies_between_its_eight_samples(rng: np.random.Generator) -> None:
    tile, words, squares = rock_tile() * (RANGE / 127.0), *packed_tile()
    floats, ints = np.zeros(OWN_FLOATS, np.float32), np.zeros(NUM_INTS, np.int32)
    floats[X : X + BLOCK], floats[Y : Y + BLOCK] = rng.uniform(-1.0, 1.0, (2, BLOCK))
    floats[DEPTH : DEPTH + BLOCK] = rng.uniform(0.5, 3.0, BLOCK)
    rays = rng.uniform(-60.0, 60.0, (3, 4)).astype(np.float32)
    x, y, depth = row(floats, X), row(floats, Y), row(floats, DEPTH)
    ahead = np.ones(BLOCK, np.float32)
    places = rays[:, 0] + depth[:, None] * (np.stack([x, y, ahead], axis=1) @ rays[:, 1:].T)
    first = np.floor(places).astype(int)
    beyond = places - first
    wanted = np.zeros((BLOCK, 4))
    for corner in np.ndindex(2, 2, 2):
        shares = np.where(corner, beyond, 1.0 - beyond).prod(axis=1)
        wanted += shares[:, None] * tile[tuple(((first + corner) % SIDE).T)]
    texture_places(floats, ints, rays, 0)
    fetch_corners(words, ints)
    mix_corners(floats, ints)
    found = np.stack([row(floats, at) for at in (GRAIN, EAST, NORTH, UP)], axis=1)
    # Places of some hundred samples in float32 are off by 3e-5 of a sample, of six deviations at most.
    np.testing.assert_allclose(found, wanted, atol=1e-3)
    fetch_squares(squares, ints)
    mix_squares(floats, ints)
    np.testing.assert_allclose(row(floats, FINE), wanted[:, 0], atol=1e-3)


def test_what_stands_for_sine_and_exponential_is_near_them() -> None:
    turns = np.linspace(-3.0, 3.0, 601)
    assert max(abs(wave(np.float32(turn)) - np.sin(2.0 * np.pi * turn)) for turn in turns) < 0.06
    depths = np.linspace(0.0, 40.0, 401)
    assert max(abs(faded(np.float32(depth)) - np.exp(-depth)) for depth in depths) < 1e-4


def test_the_sea_around_a_camera_is_the_sum_of_its_waves() -> None:
    env = SurfaceEnv(0, sea="rough")
    env.reset(seed=0)
    centre = np.array([12.0, -7.0, 2.0])
    heights, slopes = wave_grid(centre, env.water)
    along = CELL * np.arange(len(heights)) - NEAR_WAVES
    waves, phases = env.water.waves
    for i, j in ((150, 150), (140, 170), (120, 130)):
        east, north = centre[0] + along[j], centre[1] + along[i]
        fading = np.exp(-np.hypot(along[i], along[j]) / 20.0)
        height = waves[:, 4] @ np.cos(waves[:, 0] * east + waves[:, 1] * north - phases) * fading
        assert heights[i, j] == pytest.approx(height, abs=1e-4)  # 48 waves in float32
        assert slopes[i, j, 0] == pytest.approx((heights[i, j + 1] - heights[i, j - 1]) / (2.0 * CELL), abs=1e-6)
        assert slopes[i, j, 1] == pytest.approx((heights[i + 1, j] - heights[i - 1, j]) / (2.0 * CELL), abs=1e-6)
