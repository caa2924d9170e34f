"""Rays in turns beside rays alone, and the field in blocks beside the field as it is stored."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

from aquanav_tools.sim.batch.field import (
    TURNS,
    Grid,
    make_grid,
    mat_turns,
    room_at,
    traced,
    traced_in_turns,
    vec_turns,
)
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device
from tests.sim.batch.sensors.rooms import room_field

wp.set_module_options(OPTIONS)
DEVICE = find_device("cpu")
FIELD = room_field()


@wp.kernel
def read_rooms(grid: Grid, places: wp.array(dtype=wp.vec3), rooms: wp.array(dtype=wp.float32)):  # type: ignore[valid-type]
    rooms[wp.tid()] = room_at(grid, places[wp.tid()])


@wp.kernel
def trace_both(
    grid: Grid,
    start: wp.vec3,
    count: int,
    ways: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
    alone: wp.array(dtype=wp.float32),  # type: ignore[valid-type]
    turns: wp.array(dtype=wp.float32),  # type: ignore[valid-type]
):
    room = room_at(grid, start)
    directions, lengths = mat_turns(), vec_turns()
    for ray in range(count):
        directions[ray] = ways[ray]
        lengths[ray] = 20.0 + 3.0 * float(ray)
        alone[ray] = traced(grid, start, ways[ray], lengths[ray], room)
    come = traced_in_turns(grid, start, directions, lengths, room)
    for ray in range(turns.shape[0]):
        turns[ray] = come[ray]


@pytest.mark.parametrize("count", [1, 3, 7, 13, TURNS])
def test_rays_in_turns_come_as_far_as_alone(count: int, rng: np.random.Generator) -> None:
    ways = rng.normal(size=(TURNS, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    alone: Any = wp.zeros(TURNS, dtype=wp.float32, device=DEVICE)
    turns: Any = wp.zeros(TURNS, dtype=wp.float32, device=DEVICE)
    start = wp.vec3(50.0, 30.0, 25.0)
    inputs = [make_grid(FIELD, DEVICE), start, count, wp.array(ways, dtype=wp.vec3, device=DEVICE), alone, turns]
    wp.launch(trace_both, dim=1, inputs=inputs, device=DEVICE)
    assert (alone.numpy()[:count] > 10.0).all()
    np.testing.assert_array_equal(turns.numpy(), alone.numpy())


def test_blocks_hold_the_field_within_their_shares(rng: np.random.Generator) -> None:
    places = rng.uniform(0.0, np.array(FIELD.shape) - 1.0, (20_000, 3)).astype(np.float32)
    rooms: Any = wp.zeros(len(places), dtype=wp.float32, device=DEVICE)
    on_device = wp.array(places, dtype=wp.vec3, device=DEVICE)
    wp.launch(read_rooms, dim=len(places), inputs=[make_grid(FIELD, DEVICE), on_device, rooms], device=DEVICE)
    exact = FIELD.clearance(FIELD.origin + FIELD.spacing * places.astype(np.float64)) / FIELD.spacing
    # Half a share of a range of 3.5 spacings is 2.7e-5; float32 places resolve 4e-6.
    np.testing.assert_allclose(rooms.numpy(), exact, atol=4e-5)
