"""The kernels of a decision: advance, sense, score, and begin anew what has ended."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.actuators import actuated
from aquanav_tools.sim.batch.asking import answered, ask, given_motion
from aquanav_tools.sim.batch.beginning import axis_of, begin
from aquanav_tools.sim.batch.caves import Cave, Starts
from aquanav_tools.sim.batch.contact import axis_clearance, beside_wall, largest_move
from aquanav_tools.sim.batch.craft import Craft, prefetch
from aquanav_tools.sim.batch.disturbance import exchange, fill_queue, is_dropped, measured
from aquanav_tools.sim.batch.episode import COLLISION, SUCCESS, TIMEOUT, outcome_of, term_amount
from aquanav_tools.sim.batch.field import TURNS, found, mat_turns, on_grid, room_at, room_in, vec_turns
from aquanav_tools.sim.batch.guide import is_at_goal, remaining_at, tracked
from aquanav_tools.sim.batch.motion import State, read_motion, rotation_of, swim, thrust, vec6, write_motion
from aquanav_tools.sim.batch.observation import FULL, ORIGINAL, Fan, show_goal, show_motion
from aquanav_tools.sim.batch.original import drag_along
from aquanav_tools.sim.batch.original_observation import show_original, show_tag
from aquanav_tools.sim.batch.progress import to_go
from aquanav_tools.sim.batch.rays import Origin, cast_in_turns, origin_of
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.spheres import NOTHING, cast, tag_at
from aquanav_tools.sim.batch.state import MOVED, NO_QUESTION, TOUCHED, UNMOVED, BatchState, ContactExchange
from aquanav_tools.sim.batch.water import current_at, stir

wp.set_module_options(OPTIONS)

f64 = wp.float64
PROXIMITY = wp.constant(3)
"""Number of the term that is paid for nearness."""


@wp.struct
class Settings:
    """What all vehicles of a batch have in common."""

    caves: wp.array(dtype=Cave)
    vehicles: wp.array(dtype=Craft)
    """Each cave's, as its file has it: hull and controls of all that swim there."""
    crafts: wp.array(dtype=Craft)
    """The same, or one for each vehicle, with dynamics of its own; see `BatchState.craft_of`."""
    has_own_crafts: wp.int32
    unlisted: Starts
    """(N,) each vehicle's next start, where it is in no list."""
    fan: Fan
    observation: wp.int32
    """Index in `observation.PRESETS`."""
    has_engine: wp.int32
    """Whether an engine outside of the kernels says what the wall does."""
    has_law: wp.int32
    """Whether a law outside of the kernels says how vehicles move where there is no wall."""
    next_step: wp.int32
    """Whether an ended episode is followed by the next at the next step, not in the same one."""
    has_delayed_actions: wp.int32
    """Whether any vehicle's are."""


@wp.func
def without_wall(
    i: int,
    moving: State,
    command: vec6,
    current: wp.vec3d,
    state: BatchState,
    craft: Craft,
    dt: f64,
    settings: Settings,
    exchange: ContactExchange,
):
    """Return the state of vehicle `i` one physics step later were there no wall."""
    if settings.has_law == 1:
        return given_motion(i, exchange)
    if craft.is_original == 1:
        return drag_along(moving, command, state.extra[i, 0], current, craft.dragged, dt)
    acting = command
    if craft.body.num_thrusters > 0:
        acting = thrust(moving, command, craft.body, state.extra, i)
    return swim(moving, acting, current, craft.body, dt)


@wp.func
def hold(i: int, state: BatchState, cave: Cave, craft: Craft, settings: Settings, exchange: ContactExchange):
    """Hold the command of vehicle `i` for what is left of a decision; return whether it is over.

    It is not where an engine or a law outside of the kernels is asked; then this is called again with the answer.
    """
    moving = read_motion(i, state.positions, state.orientations, state.velocities)
    hull, grid, dt, zero, level = craft.hull, cave.grid, cave.rules.dt, f64(0.0), f64(state.levels[i])
    touched, first, room, is_moved = int(0), int(0), f64(0.0), int(0)
    if settings.has_law == 1 and exchange.status[i] == MOVED:
        touched, first, is_moved = state.touched[i] + int(0), exchange.steps[i] + int(0), int(1)
        exchange.status[i] = NO_QUESTION
    elif settings.has_engine == 1 and exchange.status[i] != NO_QUESTION:
        touched, first = state.touched[i] + int(exchange.status[i] == TOUCHED), exchange.steps[i] + 1
        moving = answered(i, moving, exchange, craft, cave)
        exchange.status[i] = NO_QUESTION
    else:
        room = f64(room_at(grid, on_grid(grid, moving.position))) * grid.spacing - hull.half_axis - hull.reach
    current = state.currents[i]
    asked = wp.vec3d(f64(state.acting[i, 0]), f64(state.acting[i, 1]), f64(state.acting[i, 2]))
    is_over = bool(True)
    for step in range(first, cave.rules.substeps):
        if settings.has_law == 1 and is_moved == 0:
            exchange.status[i] = UNMOVED
            exchange.steps[i] = step
            is_over = False
            break
        is_moved = int(0)
        command, after = actuated(asked, level, craft.controls)
        level = after
        if settings.observation == ORIGINAL and step == cave.rules.substeps - 1:
            state.previous_positions[i] = moving.position
            state.previous_orientations[i] = moving.orientation
        free = without_wall(i, moving, command, current, state, craft, dt, settings, exchange)
        travel = largest_move(moving, free, hull)
        if room <= travel:
            room = axis_clearance(grid, moving, hull) - hull.reach
        if room <= travel:
            if settings.has_engine == 1:
                ask(i, step, moving, free, exchange, dt)
                is_over = False
                break
            kept_off, is_touched = beside_wall(moving, free, hull, grid, cave.wall, cave.middle, dt)
            moving = kept_off
            touched += int(is_touched)
            room = zero
        else:
            moving = free
            room -= travel  # what is surely left; looked up again when it is too little
            if settings.has_engine == 1:
                exchange.is_continued[i] = 0
    state.levels[i] = level
    state.touched[i] = touched
    write_motion(i, moving, state.positions, state.orientations, state.velocities)
    return is_over


@wp.func
def conclude(i: int, state: BatchState, cave: Cave, craft: Craft):
    """Write what the decision of vehicle `i` led to: progress, contacts, water and outcome."""
    position, water = state.positions[i], cave.water
    gate = tracked(position, cave.measure.panels, state.gates[i])
    remaining = remaining_at(position, cave.measure.panels, gate)
    state.gates[i] = gate
    still = to_go(i, position, axis_of(state.orientations[i]), remaining, craft.hull, cave.measure, state)
    state.gained[i] = state.to_go[i] - still
    state.to_go[i] = still
    state.remaining[i] = remaining
    state.restarted[i] = 0
    is_touching = int(state.touched[i] > 0)
    if is_touching == 1 and state.is_touching[i] == 0:
        state.collisions[i] = state.collisions[i] + 1
    state.is_touching[i] = is_touching
    state.decisions[i] = state.decisions[i] + 1
    if water.is_constant == 0:
        state.phases[i] = state.phases[i] + water.phase_step
        stir(state.eddies, water, state.seeds[i], i, state.decisions[i])
        state.currents[i] = current_at(i, water, cave.grid, state)
    rules = cave.rules
    decisions = state.ages[i] + state.decisions[i]
    is_there = is_at_goal(position, remaining, rules.tolerance, cave.measure.panels)
    state.outcomes[i] = outcome_of(is_touching, rules.ends_on_collision, is_there, decisions, rules.max_decisions)


@wp.kernel
def advance(
    first: int,
    is_answer: int,
    state: BatchState,
    settings: Settings,
    contacts: ContactExchange,
):
    """Hold each vehicle's command for a decision; where the last one ended an episode, begin the next instead.

    With `is_answer`, go on with the vehicles that asked the contact engine.
    """
    place, last = first + wp.tid(), state.order.shape[0] - 1
    i = state.order[place]
    if settings.has_own_crafts == 1:
        next, later = state.order[wp.min(place + 1, last)], state.order[wp.min(place + 2, last)]
        prefetch(settings.crafts, state.craft_of[next], state.craft_of[later])
    cave, craft = settings.caves[state.cave_of[i]], settings.crafts[state.craft_of[i]]
    if is_answer == 1:
        if contacts.status[i] == NO_QUESTION:
            return
    elif settings.next_step == 1 and state.outcomes[i] > 0:
        begin(i, state, settings.unlisted, cave, craft)
        return
    else:
        for n in range(3):
            state.acting[i, n] = state.commands[i, n]
        if settings.has_delayed_actions == 1:
            exchange(state.acting, state.waiting_commands, i, state.decisions[i], state.action_delays[i])
    if hold(i, state, cave, craft, settings, contacts):
        conclude(i, state, cave, craft)


@wp.func
def cast_rays(first: int, last: int, origin: Origin, rotation: wp.mat33d, cave: Cave, fan: Fan):
    """Return how far the rays of a fan from `first` to before `last` come, m."""
    turn, directions, lengths = wp.mat33(rotation), mat_turns(), vec_turns()
    for k in range(last - first):
        direction = turn * fan.directions[first + k]
        for axis in range(3):
            directions[k, axis] = direction[axis]
        lengths[k] = fan.lengths[first + k]
    return cast_in_turns(cave, origin, directions, lengths)


@wp.func
def show_ray(i: int, ray: int, come: float, origin: Origin, state: BatchState, cave: Cave, settings: Settings):
    """Write what is seen of a ray of vehicle `i` that came so far (m); the original casts a sphere in its place."""
    length = settings.fan.lengths[ray]
    distance, tag = float(come), int(NOTHING)
    if settings.observation == ORIGINAL:
        distance = length
        position, radius = origin.position, settings.fan.radii[ray]
        direction = rotation_of(state.orientations[i]) * settings.fan.exact_directions[ray]
        along = cast(cave.grid, position, direction, f64(length), radius)
        if along < f64(length):
            distance = float(along)
            tag = tag_at(position + along * direction, radius + f64(0.5) * cave.grid.spacing, cave.ends)
    state.rays[i, ray] = distance
    noise, dropout = state.ray_noise[i], state.ray_dropout[i]
    if distance < length:
        distance = wp.clamp(state.ray_gain[i] * distance + state.ray_bias[i], 0.0, length)
    if noise > 0.0 or dropout > 0.0:
        seed, decision = state.seeds[i], state.decisions[i]
        distance = measured(distance, length, noise, dropout, seed, ray, decision)
        if is_dropped(dropout, seed, ray, decision):
            tag = int(NOTHING)
    if settings.observation == ORIGINAL:
        state.tags[i, ray] = tag
        show_tag(state.observations[i], ray, distance, f64(length), tag)
    else:
        state.observations[i, ray] = distance / length


@wp.kernel
def sense(
    first: int,
    only_restarted: int,
    num_parts: int,
    state: BatchState,
    settings: Settings,
):
    """Observe; a thread casts a share of its vehicle's rays, and the first of them writes all else."""
    n, part = wp.tid()
    i = state.order[first + n]
    if only_restarted == 1 and state.restarted[i] == 0:
        return
    cave = settings.caves[state.cave_of[i]]
    origin, rotation = origin_of(cave, state.positions[i]), rotation_of(state.orientations[i])
    grid, place, num_rays = cave.grid, origin.place, settings.fan.lengths.shape[0]
    half = settings.vehicles[state.cave_of[i]].hull.half_axis / grid.spacing
    nose = wp.vec3(half * wp.vec3d(rotation[0, 0], rotation[1, 0], rotation[2, 0]))
    ahead, behind = found(grid, place + nose), found(grid, place - nose)
    end = (part + 1) * num_rays // num_parts
    for first_ray in range(part * num_rays // num_parts, end, TURNS):
        last_ray, come = wp.min(first_ray + TURNS, end), vec_turns()
        if settings.observation != ORIGINAL:
            come = cast_rays(first_ray, last_ray, origin, rotation, cave, settings.fan)
        for ray in range(first_ray, last_ray):
            show_ray(i, ray, come[ray - first_ray], origin, state, cave, settings)
    if part == 0:
        craft = settings.vehicles[state.cave_of[i]]
        if settings.observation == ORIGINAL:
            show_original(
                state.observations[i],
                4 * num_rays,
                state.orientations[i],
                state.velocities[i],
                state.previous_positions[i],
                state.previous_orientations[i],
                cave.rules.goal,
            )
        else:
            show_goal(i, num_rays, state, cave.rules.goal, rotation)
            if settings.observation == FULL:
                show_motion(i, num_rays + 3, state, craft, cave.rules.entrance_height, rotation)
        nearest = wp.min(origin.room, wp.min(room_in(grid, ahead), room_in(grid, behind)))
        state.clearances[i] = float(grid.spacing) * nearest - float(craft.hull.radius)


@wp.kernel
def deliver(first: int, only_restarted: int, state: BatchState):
    """Let observations wait their turn; those of an episode's beginning fill the queue and are seen at once."""
    i = state.order[first + wp.tid()]
    if state.restarted[i] == 1:
        fill_queue(state.observations, state.waiting_observations, i)
    elif only_restarted == 0:
        exchange(state.observations, state.waiting_observations, i, state.decisions[i], state.observation_delays[i])


@wp.func
def cut_off(i: int, state: BatchState, fan: Fan):
    """Return the sum over the rays of vehicle `i` of 1 - distance / length."""
    total = f64(0.0)
    for ray in range(fan.lengths.shape[0]):
        total += f64(1.0) - f64(state.rays[i, ray] / fan.lengths[ray])
    return total


@wp.kernel
def score(first: int, state: BatchState, settings: Settings):
    """Write the reward's terms and the episode's end."""
    i = state.order[first + wp.tid()]
    rules, outcome = settings.caves[state.cave_of[i]].rules, state.outcomes[i]
    total, lost = f64(0.0), f64(0.0)
    if rules.weights[PROXIMITY] != f64(0.0):
        lost = cut_off(i, state, settings.fan)
    for n in range(7):
        term = f64(0.0)
        if state.restarted[i] == 0:
            amount = term_amount(n, state.gained[i], rules.substeps, state.touched[i], lost, outcome)
            term = rules.weights[n] * amount
        state.terms[i, n] = float(term)
        total += term
    state.rewards[i] = float(total)
    state.returns[i] = state.returns[i] + float(total)
    state.last_outcomes[i] = outcome
    state.last_returns[i] = state.returns[i]
    state.last_lengths[i] = state.decisions[i]
    state.last_collisions[i] = state.collisions[i]
    state.terminated[i] = outcome == SUCCESS or outcome == COLLISION
    state.truncated[i] = outcome == TIMEOUT


@wp.kernel
def restart(first: int, anew: int, state: BatchState, settings: Settings):
    """Keep the last observation of ended episodes and begin the next; with `anew`, begin all."""
    i = state.order[first + wp.tid()]
    if anew == 0 and state.outcomes[i] == 0:
        return
    if anew == 0:
        for n in range(state.observations.shape[1]):
            state.final_observations[i, n] = state.observations[i, n]
    begin(i, state, settings.unlisted, settings.caves[state.cave_of[i]], settings.crafts[state.craft_of[i]])
