"""The moving water: flow, gusts, eddies and waves, summed as `sim/water.py` writes it out, and their processes in time.

Every vehicle has water of its own: its episode's share of the current, and the coefficients of the gusts and eddies
around it. They are drawn from what a number is for, so that a vehicle's water does not depend on the other vehicles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.cave.water.flow import Flow as CaveFlow
from aquanav_tools.geometry.volume import field as water_field
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.batch.eddies import draw_waves, eddies_at
from aquanav_tools.sim.batch.field import Grid
from aquanav_tools.sim.batch.random import EDDIES, SHARE, SWELL, normal_pair, share_of_one, words
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device, launch_kernel
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.batch.waves import (
    EAST,
    KX,
    KY,
    NORTH,
    UP,
    cosine_and_sine,
    lanes,
    pack_waves,
    shares_below,
    total,
    vec8,
)  # fmt: skip
from aquanav_tools.sim.water import GUST_SIZE as GUSTINESS
from aquanav_tools.sim.water import GUST_TIME, WaterParts, strength_of
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
ROCK = wp.constant(water_field.ROCK)
BITS = wp.constant(water_field.BRICK_BITS)
MASK = wp.constant(water_field.BRICK - 1)
ROW = wp.constant(water_field.APRON)
PLANE = wp.constant(water_field.APRON**2)
VOLUME = wp.constant(water_field.APRON**3)
SHORTEST, LONGEST = 0.5, 60.0
"""Bounds on the correlation times of eddies, s."""
GUST_SIZE = wp.constant(wp.float64(GUSTINESS))


@wp.struct
class Flow:
    """A flow from portal to portal on the device."""

    origin: wp.vec3d
    spacing: f64
    num: wp.vec3i
    """Bricks along each axis."""
    bricks: wp.array(dtype=wp.int32)
    """Number of each brick; ROCK is still."""
    samples: wp.array(dtype=wp.vec3)
    """m/s."""


@wp.struct
class Swell:
    """The wave on the surface, which is alone in its vectors; with no amplitude there is none."""

    table: wp.array2d(dtype=vec8)
    """(9, 1) rows of `waves`."""
    rate: f64
    amplitude: f64
    surface: f64
    """z of still water, m."""


@wp.struct
class Water:
    """The water of a batch."""

    uniform: wp.vec3d
    is_constant: wp.int32
    """Whether the water has one velocity at all places and times."""
    flow: Flow
    flow_scale: f64
    eddy_scale: f64
    waves: wp.array2d(dtype=f64)
    """(W, 8) as `eddies.draw_waves` has them."""
    kept: wp.array(dtype=f64)
    """(1 + 2 W) share of each coefficient that a decision leaves."""
    fresh: wp.array(dtype=f64)
    """(1 + 2 W) share of chance that comes in its place."""
    swell: Swell
    phase_step: f64
    """Of the waves in a decision, rad."""


@dataclass(frozen=True, eq=False)
class WaterNow:
    """The water around the one vehicle of a batch as it is: arrays of `BatchState`, which later steps change."""

    water: Water
    eddies: Any
    phases: Any
    fractions: Any


def make_water(parts: WaterParts, field: DistanceField, grid: Grid, duration: float, device: Any) -> Water:
    """Return a scenario's water on a device.

    Args:
        parts: What it is made of.
        field: The cave's clearance.
        grid: The same on the device.
        duration: Of a decision, s.
        device: Warp's.
    """
    water = Water()
    water.uniform, water.is_constant = wp.vec3d(*parts.uniform), int(parts.is_constant)
    water.flow, water.swell = _make_flow(parts.flow, device), _make_swell(parts.swell, device)
    water.phase_step = water.swell.rate * duration
    water.flow_scale, water.eddy_scale = parts.flow_scale, parts.eddy_scale
    waves, times = np.zeros((0, 8)), np.zeros(0)
    if parts.eddy_scale:
        waves = draw_waves(field, grid, parts.eddy_size, np.random.default_rng(parts.eddy_seed), device)
        times = turnover_times(waves, parts.eddy_scale)
    water.waves = wp.array(waves, dtype=wp.float64, ndim=2, device=device)
    kept = np.exp(-duration / np.concatenate([[GUST_TIME], times, times]))
    water.kept = wp.array(kept, dtype=wp.float64, device=device)
    water.fresh = wp.array(np.sqrt(1.0 - kept**2), dtype=wp.float64, device=device)
    return water


def turnover_times(waves: Array, speed: float) -> Array:
    """Return the (W,) times in which eddies of (W, 8) waves turn over, s, for which each keeps its phase."""
    times: Array = np.clip(waves[:, 6] / (2.0 * np.pi * speed), SHORTEST, LONGEST)
    return times


def _make_flow(source: CaveFlow | None, device: Any) -> Flow:
    flow = Flow()
    if source is None:
        return flow
    flow.origin, flow.spacing, flow.num = wp.vec3d(*source.origin), source.spacing, wp.vec3i(*source.bricks.shape)
    flow.bricks = wp.array(source.bricks.ravel(), dtype=wp.int32, device=device)
    flow.samples = wp.array(source.samples.reshape(-1, 3), dtype=wp.vec3, device=device)
    return flow


def _make_swell(parameters: Array, device: Any) -> Swell:
    swell = Swell()
    swell.rate, swell.amplitude, swell.surface = parameters[3:6].tolist()
    if swell.amplitude:
        swell.table = wp.array(pack_waves(parameters[None], 1), dtype=vec8, ndim=2, device=device)
    return swell


@wp.func
def drawn_fraction(between: wp.vec2d, seed: int):
    """Return the fraction of the water's velocity that an episode has."""
    low, high = between[0], between[1]
    if low == high:
        return low
    return low + (high - low) * f64(share_of_one(words(seed, SHARE, 0)[0]))


@wp.func
def drawn_phase(seed: int):
    """Return the phase of the waves at the beginning of an episode, rad."""
    return f64(6.283185307179586) * f64(share_of_one(words(seed, SWELL, 0)[0]))


@wp.func
def stir(coefficients: wp.array2d(dtype=f64), water: Water, seed: int, vehicle: int, decision: int):
    """Bring a vehicle's gusts and eddies to a decision: drawn at the first, and one decision older at all others."""
    count = water.kept.shape[0]
    for block in range((count + 3) // 4):
        drawn = words(seed, EDDIES + block, decision)
        first, second = normal_pair(drawn[0], drawn[1]), normal_pair(drawn[2], drawn[3])
        for place in range(4):
            n = 4 * block + place
            chance = first[0]
            if place == 1:
                chance = first[1]
            elif place == 2:
                chance = second[0]
            elif place == 3:
                chance = second[1]
            if n < count:
                if decision == 0:
                    coefficients[vehicle, n] = f64(chance)
                else:
                    old = coefficients[vehicle, n]
                    coefficients[vehicle, n] = water.kept[n] * old + water.fresh[n] * f64(chance)


@wp.func
def flow_at(flow: Flow, position: wp.vec3d):
    """Return the flow's velocity at a place of the world, m/s, before it is scaled."""
    place = (position - flow.origin) / flow.spacing
    if place[0] < f64(0.0) or place[1] < f64(0.0) or place[2] < f64(0.0):
        return wp.vec3d()
    i, j, k = int(place[0]), int(place[1]), int(place[2])
    x, y, z = i >> BITS, j >> BITS, k >> BITS
    if x >= flow.num[0] or y >= flow.num[1] or z >= flow.num[2]:
        return wp.vec3d()
    brick = flow.bricks[(x * flow.num[1] + y) * flow.num[2] + z]
    if brick == ROCK:
        return wp.vec3d()
    fx, fy, fz = place[0] - f64(i), place[1] - f64(j), place[2] - f64(k)
    n = brick * VOLUME + (i & MASK) * PLANE + (j & MASK) * ROW + (k & MASK)
    a = wp.lerp(wp.vec3d(flow.samples[n]), wp.vec3d(flow.samples[n + 1]), fz)
    b = wp.lerp(wp.vec3d(flow.samples[n + ROW]), wp.vec3d(flow.samples[n + ROW + 1]), fz)
    n += PLANE
    c = wp.lerp(wp.vec3d(flow.samples[n]), wp.vec3d(flow.samples[n + 1]), fz)
    d = wp.lerp(wp.vec3d(flow.samples[n + ROW]), wp.vec3d(flow.samples[n + ROW + 1]), fz)
    return wp.lerp(wp.lerp(a, b, fy), wp.lerp(c, d, fy), fx)


@wp.kernel
def probe_flow(flow: Flow, places: wp.array(dtype=wp.vec3d), velocities: wp.array(dtype=wp.vec3d)):
    """Write the flow's velocity at places."""
    i = wp.tid()
    velocities[i] = flow_at(flow, places[i])


def flow_velocities(source: CaveFlow, points: Array) -> Array:
    """Return the (N, 3) velocity of a flow at (N, 3) points of the world, m/s, before it is scaled."""
    device = find_device("cpu")
    places = np.ascontiguousarray(np.atleast_2d(points), dtype=np.float64)
    velocities = wp.zeros(len(places), dtype=wp.vec3d, device=device)
    inputs = [_make_flow(source, device), wp.array(places, dtype=wp.vec3d, device=device), velocities]
    launch_kernel(probe_flow, dim=len(places), inputs=inputs, device=device)
    found: Array = velocities.numpy()
    return found


def mean_velocities(scenario: Scenario, current: Current | None, points: Array) -> Array:
    """Return the (N, 3) velocity of the water at (N, 3) places without gusts, eddies and waves, world frame, m/s.

    Args:
        scenario: the cave and its flow; without a flow only one velocity everywhere moves it.
        current: as `water_of` takes it; None takes the scenario's.
        points: world, m.
    """
    chosen = scenario.settings.water.current if current is None else current
    if np.ndim(chosen) == 0:
        still = np.zeros_like(points)
        return still if scenario.flow is None else strength_of(chosen) * flow_velocities(scenario.flow, points)
    return np.broadcast_to(np.array(chosen, dtype=np.float64), points.shape)


@wp.func
def swell_at(swell: Swell, phase: f64, position: wp.vec3d):
    """Return the velocity of the water under waves, m/s; a place in the air has that of the surface."""
    level, upright = shares_below(swell.table, 0, wp.max(swell.surface - position[2], f64(0.0)))
    cosine, sine = cosine_and_sine(swell.table[KX, 0] * position[0] + swell.table[KY, 0] * position[1] - lanes(phase))
    towards = wp.cw_mul(level, cosine)
    return wp.vec3d(
        total(wp.cw_mul(towards, swell.table[EAST, 0])),
        total(wp.cw_mul(towards, swell.table[NORTH, 0])),
        total(wp.cw_mul(wp.cw_mul(upright, sine), swell.table[UP, 0])),
    )


@wp.func
def water_at(
    water: Water, grid: Grid, coefficients: wp.array2d(dtype=f64), vehicle: int, phase: f64, position: wp.vec3d
):
    """Return the velocity of the water at a place, world frame, m/s, before the episode's fraction of it is taken.

    Args:
        water: The cave's.
        grid: Clearance.
        coefficients: (N, 1 + 2 W) of gusts and eddies.
        vehicle: Which row of the coefficients.
        phase: Of the surface's waves, rad.
        position: World, m.
    """
    velocity = f64(1.0) * water.uniform
    if water.flow_scale != f64(0.0):
        gust = f64(1.0) + GUST_SIZE * coefficients[vehicle, 0]
        velocity += water.flow_scale * gust * flow_at(water.flow, position)
    if water.eddy_scale != f64(0.0):
        velocity += water.eddy_scale * eddies_at(water.waves, grid, coefficients, vehicle, position)
    if water.swell.amplitude != f64(0.0):
        velocity += swell_at(water.swell, phase, position)
    return velocity


@wp.func
def current_around(i: int, water: Water, grid: Grid, state: BatchState, position: wp.vec3d):
    """Return the velocity of the water as vehicle `i` has it at a place, world frame, m/s."""
    return state.current_fractions[i] * water_at(water, grid, state.eddies, i, state.phases[i], position)


@wp.func
def current_at(i: int, water: Water, grid: Grid, state: BatchState):
    """Return the velocity of the water where vehicle `i` is, world frame, m/s."""
    return current_around(i, water, grid, state, state.positions[i])
