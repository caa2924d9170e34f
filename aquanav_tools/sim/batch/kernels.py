"""The kernels of a decision: move, sense, score, and begin anew what has ended."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.contact import axis_clearance, beside_wall, largest_move
from aquanav_tools.sim.batch.disturbance import exchange, fill_queue, measured
from aquanav_tools.sim.batch.field import Grid, on_grid, room_at, surely_at, traced
from aquanav_tools.sim.batch.fleet_arrays import (
    DRAWN,
    UNLISTED,
    Beginnings,
    Controls,
    Craft,
    Fans,
    Fleet,
    Rules,
    Starts,
)
from aquanav_tools.sim.batch.guide import remaining_at, tracked
from aquanav_tools.sim.batch.motion import State, rotation_of, swim, thrust, vec6
from aquanav_tools.sim.batch.original import drag_along
from aquanav_tools.sim.batch.progress import Measure, begin_measure, to_go
from aquanav_tools.sim.batch.random import NEXT, START, choice, words
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.water import Water, current_at, drawn_phase, drawn_share, stir

wp.set_module_options(OPTIONS)

f64 = wp.float64
PI = wp.constant(wp.float64(3.141592653589793))
SUCCESS, COLLISION, TIMEOUT = wp.constant(1), wp.constant(2), wp.constant(3)
NUM_RAYS = wp.constant(28)


@wp.func
def axis_of(orientation: wp.vec4d):
    """Return the unit vector along the vehicle's axis, world frame."""
    rotation = rotation_of(orientation)
    return wp.vec3d(rotation[0, 0], rotation[1, 0], rotation[2, 0])


@wp.func
def put_at(i: int, start: int, fleet: Fleet, starts: Starts):
    """Put vehicle `i` at a start."""
    fleet.positions[i] = starts.positions[start]
    fleet.orientations[i] = starts.orientations[start]
    for n in range(starts.extra.shape[1]):
        fleet.extra[i, n] = starts.extra[start, n]
    fleet.gates[i] = starts.gates[start]
    fleet.remaining[i] = starts.remaining[start]


@wp.func
def begin(i: int, fleet: Fleet, beginnings: Beginnings, craft: Craft, water: Water, measure: Measure):
    """Put vehicle `i` at rest at the start of its next episode, whose seed follows from the last one's."""
    if fleet.episodes[i] > 0:
        fleet.seeds[i] = int(words(fleet.seeds[i], NEXT, 0)[0])
    seed = fleet.seeds[i]
    start = fleet.wanted_starts[i]
    if start == DRAWN:
        start = choice(words(seed, START, 0)[0], beginnings.listed.gates.shape[0])
    fleet.wanted_starts[i] = DRAWN
    fleet.episodes[i] = fleet.episodes[i] + 1
    if start == UNLISTED:
        put_at(i, i, fleet, beginnings.unlisted)
    else:
        put_at(i, start, fleet, beginnings.listed)
    fleet.start_indices[i] = wp.max(start, -1)
    fleet.beginnings[i] = fleet.positions[i]
    begin_measure(i, measure)
    ahead = axis_of(fleet.orientations[i])
    fleet.to_go[i] = to_go(i, fleet.positions[i], ahead, fleet.remaining[i], craft.hull, measure)
    fleet.velocities[i] = vec6()
    fleet.levels[i] = craft.controls.neutral
    fleet.gained[i] = f64(0.0)
    fleet.decisions[i] = 0
    fleet.ages[i] = 0
    fleet.touched[i] = 0
    fleet.is_touching[i] = 0
    fleet.collisions[i] = 0
    fleet.outcomes[i] = 0
    fleet.restarted[i] = 1
    fleet.returns[i] = 0.0
    fleet.shares[i] = drawn_share(water, seed)
    if water.is_constant == 0:
        fleet.phases[i] = drawn_phase(seed)
        stir(fleet.eddies, water, seed, i, 0)
    for n in range(3):
        fleet.commands[i, n] = 0.0
        fleet.acting[i, n] = 0.0
    fill_queue(fleet.acting, fleet.waiting_commands, i)


@wp.func
def advanced(i: int, state: State, command: vec6, current: wp.vec3d, fleet: Fleet, craft: Craft, dt: f64):
    """Return the state of vehicle `i` one physics step later were there no wall."""
    if craft.is_original == 1:
        return drag_along(state, command, fleet.extra[i, 0], current, craft.dragged, dt)
    acting = command
    if craft.body.num_thrusters > 0:
        acting = thrust(state, command, craft.body, fleet.extra, i)
    return swim(state, acting, current, craft.body, dt)


@wp.func
def glide(
    i: int, fleet: Fleet, craft: Craft, water: Water, rules: Rules, grid: Grid, mesh: wp.uint64, middle: wp.vec3d
):
    """Hold the command of vehicle `i` for one decision; return its state, and in how many steps it touched the wall."""
    state = State()
    state.position = fleet.positions[i]
    state.orientation = fleet.orientations[i]
    state.velocity = fleet.velocities[i]
    current = fleet.shares[i] * water.uniform
    if water.is_constant == 0:
        share, phase = fleet.shares[i], fleet.phases[i]
        current = current_at(water, grid, fleet.eddies, share, phase, i, state.position)
    fleet.currents[i] = current
    for n in range(3):
        fleet.acting[i, n] = fleet.commands[i, n]
    if rules.disturbance.action_delay > 0:
        exchange(fleet.acting, fleet.waiting_commands, i, fleet.decisions[i])
    ballast, steer, ahead = f64(fleet.acting[i, 0]), f64(fleet.acting[i, 1]), f64(fleet.acting[i, 2])
    controls = craft.controls
    surge, yaw = controls.surge * ahead, controls.yaw * steer
    if ahead < f64(0.0):
        surge *= controls.reverse_share
    if controls.steers_at_rest == 0:
        yaw *= ahead
    level = fleet.levels[i]
    touched = int(0)
    zero = f64(0.0)
    room = f64(surely_at(grid, on_grid(grid, state.position))) * grid.spacing - craft.hull.half_axis - craft.hull.reach
    for _ in range(rules.substeps):
        level = wp.clamp(level + ballast * controls.level_step, controls.lowest, controls.highest)
        command = vec6(surge, zero, controls.heave_per_level * level, zero, zero, yaw)
        free = advanced(i, state, command, current, fleet, craft, rules.dt)
        way = largest_move(state, free, craft.hull)
        if room <= way:
            room = axis_clearance(grid, state, craft.hull) - craft.hull.reach
        if room <= way:
            after, is_touched = beside_wall(state, free, craft.hull, grid, mesh, middle, rules.dt)
            state = after
            touched += int(is_touched)
            room = zero
        else:
            state = free
            room -= way  # what is surely left; looked up again when it is too little
    fleet.levels[i] = level
    return state, touched


@wp.kernel
def move(
    first: int,
    fleet: Fleet,
    beginnings: Beginnings,
    craft: Craft,
    water: Water,
    rules: Rules,
    grid: Grid,
    measure: Measure,
    mesh: wp.uint64,
    middle: wp.vec3d,
):
    """Hold each vehicle's command for a decision; where the last one ended an episode, begin the next instead."""
    i = fleet.order[first + wp.tid()]
    if rules.next_step == 1 and fleet.outcomes[i] > 0:
        begin(i, fleet, beginnings, craft, water, measure)
        return
    state, touched = glide(i, fleet, craft, water, rules, grid, mesh, middle)
    fleet.positions[i] = state.position
    fleet.orientations[i] = state.orientation
    fleet.velocities[i] = state.velocity
    gate = tracked(state.position, measure.panels, fleet.gates[i])
    remaining = remaining_at(state.position, measure.panels, gate)
    fleet.gates[i] = gate
    still = to_go(i, state.position, axis_of(state.orientation), remaining, craft.hull, measure)
    fleet.gained[i] = fleet.to_go[i] - still
    fleet.to_go[i] = still
    fleet.remaining[i] = remaining
    fleet.restarted[i] = 0
    fleet.touched[i] = touched
    is_touching = int(touched > 0)
    if is_touching == 1 and fleet.is_touching[i] == 0:
        fleet.collisions[i] = fleet.collisions[i] + 1
    fleet.is_touching[i] = is_touching
    fleet.decisions[i] = fleet.decisions[i] + 1
    if water.is_constant == 0:
        fleet.phases[i] = fleet.phases[i] + water.phase_step
        stir(fleet.eddies, water, fleet.seeds[i], i, fleet.decisions[i])
    outcome = int(0)
    if rules.ends_on_collision == 1 and is_touching == 1:
        outcome = COLLISION
    elif remaining <= rules.tolerance:
        outcome = SUCCESS
    elif fleet.ages[i] + fleet.decisions[i] >= rules.max_decisions:
        outcome = TIMEOUT
    fleet.outcomes[i] = outcome


@wp.func
def within(value: f64):
    """Return a value as the observation has it."""
    return wp.float32(wp.clamp(value, f64(-1.0), f64(1.0)))


@wp.func
def soft(value: f64, scale: f64):
    """Return value / (|value| + scale), as the observation has it."""
    return wp.float32(value / (wp.abs(value) + scale))


@wp.func
def trim_of(level: f64, controls: Controls):
    """Return the state of the ballast in [-1, 1]."""
    limit = controls.lowest
    if level > controls.neutral:
        limit = controls.highest
    if limit == controls.neutral:
        return f64(0.0)  # a vehicle afloat
    return (level - controls.neutral) / wp.abs(limit - controls.neutral)


@wp.func
def show_motion(i: int, fleet: Fleet, craft: Craft, rules: Rules, rotation: wp.mat33d):
    """Write what the full observation has behind the goal."""
    velocity = fleet.velocities[i]
    for axis in range(3):
        fleet.observations[i, 31 + axis] = soft(velocity[axis], rules.scales[1])
        fleet.observations[i, 34 + axis] = soft(velocity[3 + axis], rules.scales[2])
        fleet.observations[i, 41 + axis] = fleet.commands[i, axis]
    fleet.observations[i, 37] = soft(rules.entrance_height - fleet.positions[i][2], rules.scales[0])
    fleet.observations[i, 38] = within(rotation[2, 0])
    fleet.observations[i, 39] = within(rotation[2, 1])
    fleet.observations[i, 40] = within(trim_of(fleet.levels[i], craft.controls))


@wp.func
def show_goal(i: int, fleet: Fleet, rules: Rules, rotation: wp.mat33d):
    """Write the goal's distance, azimuth and elevation."""
    offset = rules.goal - fleet.positions[i]
    flat = wp.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
    azimuth = wp.atan2(offset[1], offset[0]) - wp.atan2(rotation[1, 0], rotation[0, 0])
    azimuth -= f64(2.0) * PI * wp.rint(azimuth / (f64(2.0) * PI))
    fleet.observations[i, 28] = soft(wp.length(offset), rules.scales[0])
    fleet.observations[i, 29] = within(azimuth / PI)
    fleet.observations[i, 30] = within(wp.atan2(offset[2], flat) / (f64(0.5) * PI))


@wp.kernel
def sense(
    first: int,
    only_restarted: int,
    num_parts: int,
    fleet: Fleet,
    craft: Craft,
    rules: Rules,
    grid: Grid,
    fans: Fans,
    mesh: wp.uint64,
    middle: wp.vec3d,
):
    """Observe; a thread casts a share of its vehicle's rays, and the first of them writes all else."""
    n, part = wp.tid()
    i = fleet.order[first + n]
    if only_restarted == 1 and fleet.restarted[i] == 0:
        return
    position, rotation = fleet.positions[i], rotation_of(fleet.orientations[i])
    place = on_grid(grid, position)
    room = room_at(grid, place)
    turn = wp.mat33(rotation)
    per_spacing = float(grid.spacing)
    per_metre = 1.0 / per_spacing
    centre = wp.vec3(position - middle)
    is_disturbed = rules.disturbance.noise > 0.0 or rules.disturbance.dropout > 0.0
    for ray in range(part, 28, num_parts):
        length, way = fans.lengths[ray], turn * fans.directions[ray]
        distance = length
        if fans.exact == 1:
            hit = wp.mesh_query_ray(mesh, centre, way, length)
            if hit.result:
                distance = hit.t
        else:
            distance = per_spacing * traced(grid, place, way, length * per_metre, room)
        fleet.rays[i, ray] = distance
        if is_disturbed:
            distance = measured(distance, length, rules.disturbance, fleet.seeds[i], ray, fleet.decisions[i])
        fleet.observations[i, ray] = distance / length
    if part == 0:
        show_goal(i, fleet, rules, rotation)
        if fleet.observations.shape[1] > 31:
            show_motion(i, fleet, craft, rules, rotation)
        nose = wp.vec3(craft.hull.half_axis / grid.spacing * wp.vec3d(rotation[0, 0], rotation[1, 0], rotation[2, 0]))
        nearest = wp.min(room, wp.min(room_at(grid, place + nose), room_at(grid, place - nose)))
        fleet.clearances[i] = per_spacing * nearest - float(craft.hull.radius)


@wp.kernel
def deliver(first: int, only_restarted: int, fleet: Fleet):
    """Let observations wait their turn; those of an episode's beginning fill the queue and are seen at once."""
    i = fleet.order[first + wp.tid()]
    if fleet.restarted[i] == 1:
        fill_queue(fleet.observations, fleet.waiting_observations, i)
    elif only_restarted == 0:
        exchange(fleet.observations, fleet.waiting_observations, i, fleet.decisions[i])


@wp.kernel
def score(first: int, fleet: Fleet, rules: Rules, fans: Fans):
    """Write the reward's terms and the episode's end."""
    i = fleet.order[first + wp.tid()]
    outcome = fleet.outcomes[i]
    total = f64(0.0)
    if fleet.restarted[i] == 1:
        for n in range(7):
            fleet.terms[i, n] = 0.0
    else:
        cut_off = f64(0.0)
        for ray in range(28):
            cut_off += f64(1.0) - f64(fleet.rays[i, ray] / fans.lengths[ray])
        steps = f64(rules.substeps)
        for n in range(7):
            amount = f64(outcome == n - 3)  # goal, collision and timeout, in the order of the outcomes
            if n == 0:
                amount = fleet.gained[i]
            elif n == 1:
                amount = steps
            elif n == 2:
                amount = f64(fleet.touched[i])
            elif n == 3:
                amount = steps * cut_off
            term = rules.weights[n] * amount
            fleet.terms[i, n] = float(term)
            total += term
    fleet.rewards[i] = float(total)
    fleet.returns[i] = fleet.returns[i] + float(total)
    fleet.last_outcomes[i] = outcome
    fleet.last_returns[i] = fleet.returns[i]
    fleet.last_lengths[i] = fleet.decisions[i]
    fleet.last_collisions[i] = fleet.collisions[i]
    fleet.terminated[i] = outcome == SUCCESS or outcome == COLLISION
    fleet.truncated[i] = outcome == TIMEOUT


@wp.kernel
def restart(first: int, anew: int, fleet: Fleet, beginnings: Beginnings, craft: Craft, water: Water, measure: Measure):
    """Keep the last observation of ended episodes and begin the next; with `anew`, begin all."""
    i = fleet.order[first + wp.tid()]
    if anew == 1:
        begin(i, fleet, beginnings, craft, water, measure)
    elif fleet.outcomes[i] > 0:
        for n in range(fleet.observations.shape[1]):
            fleet.final_observations[i, n] = fleet.observations[i, n]
        begin(i, fleet, beginnings, craft, water, measure)
