"""How an episode begins: its seed, its start and its water, and a vehicle at rest."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.caves import Cave, Starts
from aquanav_tools.sim.batch.craft import Craft
from aquanav_tools.sim.batch.disturbance import fill_queue
from aquanav_tools.sim.batch.guide import remaining_at
from aquanav_tools.sim.batch.motion import rotation_of, vec6
from aquanav_tools.sim.batch.progress import begin_measure, to_go
from aquanav_tools.sim.batch.random import NEXT, START, choice, words
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.starts import DRAWN, UNLISTED
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.batch.water import current_at, drawn_fraction, drawn_phase, stir

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.func
def axis_of(orientation: wp.vec4d):
    """Return the unit vector along the vehicle's axis, world frame."""
    rotation = rotation_of(orientation)
    return wp.vec3d(rotation[0, 0], rotation[1, 0], rotation[2, 0])


@wp.func
def put_at(i: int, start: int, state: BatchState, starts: Starts):
    """Put vehicle `i` at a start."""
    state.positions[i] = starts.positions[start]
    state.orientations[i] = starts.orientations[start]
    for n in range(starts.extra.shape[1]):
        state.extra[i, n] = starts.extra[start, n]
    state.gates[i] = starts.gates[start]


@wp.func
def begin_water(i: int, seed: int, state: BatchState, cave: Cave):
    """Draw the water of vehicle `i` for an episode."""
    state.current_fractions[i] = drawn_fraction(state.current_ranges[i], seed)
    state.currents[i] = state.current_fractions[i] * cave.water.uniform
    if cave.water.is_constant == 0:
        state.phases[i] = drawn_phase(seed)
        stir(state.eddies, cave.water, seed, i, 0)
        state.currents[i] = current_at(i, cave.water, cave.grid, state)


@wp.func
def begin(i: int, state: BatchState, unlisted: Starts, cave: Cave, craft: Craft):
    """Put vehicle `i` at rest at the start of its next episode, whose seed follows from the last one's."""
    if state.episodes[i] > 0:
        state.seeds[i] = int(words(state.seeds[i], NEXT, 0)[0])
    seed = state.seeds[i]
    start = state.wanted_starts[i]
    if start == DRAWN:
        start = cave.start_numbers[choice(words(seed, START, 0)[0], cave.start_numbers.shape[0])]
    state.wanted_starts[i] = DRAWN
    state.episodes[i] = state.episodes[i] + 1
    if start == UNLISTED:
        put_at(i, i, state, unlisted)
    else:
        put_at(i, start, state, cave.starts)
    state.start_indices[i] = wp.max(start, -1)
    state.beginnings[i] = state.positions[i]
    state.previous_positions[i] = state.positions[i]
    state.previous_orientations[i] = state.orientations[i]
    state.remaining[i] = remaining_at(state.positions[i], cave.measure.panels, state.gates[i])
    begin_measure(i, state)
    ahead = axis_of(state.orientations[i])
    state.to_go[i] = to_go(i, state.positions[i], ahead, state.remaining[i], craft.hull, cave.measure, state)
    state.velocities[i] = vec6()
    state.levels[i] = craft.controls.neutral
    state.gained[i] = f64(0.0)
    state.decisions[i] = 0
    state.ages[i] = 0
    state.touched[i] = 0
    state.is_touching[i] = 0
    state.collisions[i] = 0
    state.outcomes[i] = 0
    state.restarted[i] = 1
    state.returns[i] = 0.0
    begin_water(i, seed, state, cave)
    for n in range(3):
        state.commands[i, n] = 0.0
        state.acting[i, n] = 0.0
    fill_queue(state.acting, state.waiting_commands, i)
