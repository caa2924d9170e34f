"""The kernels of a boat's decision: begin what has ended, move, sense, score."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.boat_contact import (
    MAX_CONTACTS,
    ROUNDING,
    Bay,
    deepest_contact,
    goal_distance,
    hull_clearance,
    place_hull,
    pushed_off,
)
from aquanav_tools.sim.batch.boat_motion import BoatBody, drive_wrench, sail
from aquanav_tools.sim.batch.boat_observation import show_goal, show_motion
from aquanav_tools.sim.batch.boat_rays import NOTHING, cast_beam
from aquanav_tools.sim.batch.boat_state import (
    AHEAD,
    FULL,
    ORIGINAL,
    BoatRules,
    BoatState,
    FreeMotion,
    Model,
    Surroundings,
)
from aquanav_tools.sim.batch.disturbance import exchange, fill_queue, is_dropped, measured
from aquanav_tools.sim.batch.episode import COLLISION, NUM_TERMS, SUCCESS, TIMEOUT, outcome_of, term_amount
from aquanav_tools.sim.batch.motion import State, read_motion, rotation_of, vec6, write_motion
from aquanav_tools.sim.batch.original_observation import show_original, show_tag
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS
from aquanav_tools.sim.batch.waves import RATE

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64
NUM_AHEAD = wp.constant(AHEAD)
TERMS = wp.constant(NUM_TERMS)


@wp.func
def level_place(position: wp.vec3d):
    """Return a position from above."""
    return wp.vec2d(position[0], position[1])


@wp.kernel
def begin(first: int, boats: BoatState, around: Surroundings):
    """Keep the last observation of boats that begin an episode, and put them at rest where the host has placed them."""
    i = first + wp.tid()
    if boats.restarted[i] == 0:
        return
    for n in range(boats.observations.shape[1]):
        boats.final_observations[i, n] = boats.observations[i, n]
    boats.velocities[i] = vec6()
    boats.positions_before[i] = boats.positions[i]
    boats.orientations_before[i] = boats.orientations[i]
    boats.currents[i] = wp.vec3d()
    distance = goal_distance(around.bays[around.bay_of[i]], level_place(boats.positions[i]))
    boats.lengths[i] = distance
    boats.remaining[i] = distance
    boats.gained[i] = f64(0.0)
    boats.decisions[i] = 0
    boats.ages[i] = 0
    boats.touched[i] = 0
    boats.is_touching[i] = 0
    boats.collisions[i] = 0
    boats.outcomes[i] = 0
    boats.returns[i] = f64(0.0)
    for n in range(3):
        boats.commands[i, n] = 0.0
        boats.acting[i, n] = 0.0
    fill_queue(boats.acting, boats.waiting_commands, i)


@wp.func
def meet_rocks(i: int, state: State, bay: Bay, mobility: vec6, model: Model):
    """Return the state after contacts, the deepest first, and whether there were any; `mobility` as of `BoatBody`."""
    result, is_touched, solved = state, int(0), int(0)
    while solved < MAX_CONTACTS:
        place_hull(i, result, model.outline, model.outline_work)
        corners, heights = model.outline_work.corners[i], model.outline_work.heights[i]
        contact = deepest_contact(corners, heights, model.outline.radius, bay)
        solved += 1
        if contact.depth > ROUNDING:
            is_touched = 1
            result = pushed_off(result, contact, mobility)
        else:
            solved = MAX_CONTACTS
    return result, is_touched


@wp.func
def hold_command(
    i: int, begun: State, current: wp.vec3d, wind: wp.vec2d, bay: Bay, body: BoatBody, boats: BoatState,
    around: Surroundings, model: Model, rules: BoatRules,
):  # fmt: skip
    """Return the state after a decision's physics steps, and how many of them were in contact.

    A function of its own, so that the body is read from its array once, not in each step.
    """
    state, touched = begun, int(0)
    drives = drive_wrench(f64(boats.acting[i, 1]), f64(boats.acting[i, 2]), body.controls)
    for n in range(rules.substeps):
        boats.positions_before[i] = state.position
        boats.orientations_before[i] = state.orientation
        elapsed = f64(n) * rules.dt
        free = sail(i, state, drives, current, wind, around.sea, elapsed, body, model.hull_work, rules.dt)
        after, is_touched = meet_rocks(i, free, bay, body.mobility, model)
        state = after
        touched += is_touched
    return state, touched


@wp.func
def take_command(i: int, boats: BoatState, around: Surroundings):
    """Let the command of boat `i` that is due take effect, and return the current and the wind of this decision."""
    for n in range(3):
        boats.acting[i, n] = boats.commands[i, n]
    exchange(boats.acting, boats.waiting_commands, i, boats.decisions[i], boats.action_delays[i])
    now = boats.decisions[i] % NUM_AHEAD
    return around.currents[i, now], around.winds[i, now]


@wp.func
def pass_time(i: int, current: wp.vec3d, boats: BoatState, around: Surroundings, rules: BoatRules):
    """Let the waves of boat `i` go on by a decision, and count it."""
    duration = f64(rules.substeps) * rules.dt
    for b in range(around.sea.phases.shape[1]):
        around.sea.phases[i, b] = around.sea.phases[i, b] + around.sea.table[i, RATE, b] * duration
    boats.currents[i] = current
    boats.decisions[i] = boats.decisions[i] + 1


@wp.kernel
def move(first: int, boats: BoatState, around: Surroundings, model: Model, rules: BoatRules):
    """Hold each boat's command for a decision; waves go on, current and wind stay as they are."""
    i = first + wp.tid()
    if boats.held[i] == 1:
        return
    state = read_motion(i, boats.positions, boats.orientations, boats.velocities)
    current, wind = take_command(i, boats, around)
    bay, body = around.bays[around.bay_of[i]], model.bodies[boats.body_of[i]]
    after, touched = hold_command(i, state, current, wind, bay, body, boats, around, model, rules)
    write_motion(i, after, boats.positions, boats.orientations, boats.velocities)
    boats.touched[i] = touched
    pass_time(i, current, boats, around, rules)


@wp.kernel
def take(first: int, boats: BoatState, around: Surroundings, rules: BoatRules):
    """Begin a decision of boats that a law of the user's own moves; what it leads to is no matter of the waves."""
    i = first + wp.tid()
    if boats.held[i] == 1:
        return
    current, _wind = take_command(i, boats, around)
    boats.touched[i] = 0
    pass_time(i, current, boats, around, rules)


@wp.kernel
def obey(first: int, free: FreeMotion, boats: BoatState, around: Surroundings, model: Model):
    """Let boats go where a law of the user's own says, as far as rocks let them: a physics step."""
    i = first + wp.tid()
    if boats.held[i] == 1:
        return
    boats.positions_before[i] = boats.positions[i]
    boats.orientations_before[i] = boats.orientations[i]
    state = read_motion(i, free.positions, free.orientations, free.velocities)
    mobility = model.bodies[boats.body_of[i]].mobility
    after, is_touched = meet_rocks(i, state, around.bays[around.bay_of[i]], mobility, model)
    write_motion(i, after, boats.positions, boats.orientations, boats.velocities)
    boats.touched[i] = boats.touched[i] + is_touched


@wp.func
def sense_beams(i: int, boats: BoatState, rotation: wp.mat33d, bay: Bay, model: Model, rules: BoatRules):
    """Write the true distances of boat `i`, and into its observation what the sensor makes of them."""
    noise, dropout = float(boats.noises[i]), float(boats.dropouts[i])
    is_disturbed = noise > 0.0 or dropout > 0.0
    place, seed, decision = level_place(boats.positions[i]), boats.seeds[i], boats.decisions[i]
    for ray in range(model.beams.lengths.shape[0]):
        length = model.beams.lengths[ray]
        reach, tag = cast_beam(ray, rotation, place, bay, model.beams)
        distance = wp.float32(reach)
        boats.rays[i, ray] = distance
        boats.tags[i, ray] = tag
        if reach < length:
            distance = wp.clamp(boats.ray_gain[i] * distance + boats.ray_bias[i], 0.0, wp.float32(length))
        if is_disturbed:
            distance = measured(distance, wp.float32(length), noise, dropout, seed, ray, decision)
            if is_dropped(dropout, seed, ray, decision):
                tag = NOTHING
        if rules.preset == ORIGINAL:
            show_tag(boats.observations[i], ray, distance, length, tag)
        else:
            boats.observations[i, ray] = wp.float32(f64(distance) / length)


@wp.kernel
def sense(first: int, only_begun: int, boats: BoatState, around: Surroundings, model: Model, rules: BoatRules):
    """Observe, and measure how far the goal is."""
    i = first + wp.tid()
    is_begun = boats.restarted[i] == 1
    if not is_begun and (only_begun == 1 or boats.held[i] == 1):
        return
    position, orientation, velocity = boats.positions[i], boats.orientations[i], boats.velocities[i]
    rotation, bay = rotation_of(orientation), around.bays[around.bay_of[i]]
    distance = goal_distance(bay, level_place(position))
    boats.gained[i] = boats.remaining[i] - distance
    boats.remaining[i] = distance
    sense_beams(i, boats, rotation, bay, model, rules)
    num_rays, seen = model.beams.lengths.shape[0], boats.observations[i]
    if rules.preset == ORIGINAL:
        before, turned = boats.positions_before[i], boats.orientations_before[i]
        goal = wp.vec3d(bay.goal_centre[0], bay.goal_centre[1], before[2])  # as high as the boat
        show_original(seen, 4 * num_rays, orientation, velocity, before, turned, goal)
    else:
        show_goal(seen, num_rays, position, rotation, bay.goal_centre, rules.scales[0])
        if rules.preset == FULL:
            show_motion(seen, num_rays + 2, rotation, velocity, boats.commands[i], rules.scales)
    if is_begun:
        fill_queue(boats.observations, boats.waiting_observations, i)
    else:
        late = boats.observation_delays[i]
        exchange(boats.observations, boats.waiting_observations, i, boats.decisions[i], late)


@wp.func
def count_decision(i: int, boats: BoatState, tolerance: f64, rules: BoatRules):
    """Note contacts and the outcome of boat `i` after a decision."""
    is_touching = int(boats.touched[i] > 0)
    if is_touching == 1 and boats.is_touching[i] == 0:
        boats.collisions[i] = boats.collisions[i] + 1
    boats.is_touching[i] = is_touching
    age = boats.ages[i] + boats.decisions[i]
    is_there = boats.remaining[i] <= tolerance
    boats.outcomes[i] = outcome_of(is_touching, rules.ends_on_collision, is_there, age, rules.max_decisions)


@wp.kernel
def score(first: int, boats: BoatState, around: Surroundings, model: Model, rules: BoatRules):
    """Write the reward's terms and the episode's end; boats that did not move get nothing."""
    i = first + wp.tid()
    outcome, sum_of_terms, cut_off = int(0), f64(0.0), f64(0.0)
    if boats.held[i] == 0:
        count_decision(i, boats, around.bays[around.bay_of[i]].tolerance, rules)
        outcome = boats.outcomes[i]
        for ray in range(model.beams.lengths.shape[0]):
            cut_off += f64(1.0) - f64(boats.rays[i, ray]) / model.beams.lengths[ray]
    for n in range(TERMS):
        term = f64(0.0)
        if boats.held[i] == 0:
            amount = term_amount(n, boats.gained[i], rules.substeps, boats.touched[i], cut_off, outcome)
            term = rules.weights[n] * amount
        boats.terms[i, n] = term
        sum_of_terms += term
    boats.rewards[i] = sum_of_terms
    boats.returns[i] = boats.returns[i] + sum_of_terms
    boats.last_outcomes[i] = boats.outcomes[i]
    boats.last_returns[i] = boats.returns[i]
    boats.last_lengths[i] = boats.decisions[i]
    boats.last_collisions[i] = boats.collisions[i]
    boats.terminated[i] = outcome == SUCCESS or outcome == COLLISION
    boats.truncated[i] = outcome == TIMEOUT


@wp.kernel
def clear(first: int, boats: BoatState, around: Surroundings, model: Model):
    """Write how far each hull is from the nearest rock, reef or edge, as seen from above."""
    i = first + wp.tid()
    state = read_motion(i, boats.positions, boats.orientations, boats.velocities)
    place_hull(i, state, model.outline, model.outline_work)
    corners, bay = model.outline_work.corners[i], around.bays[around.bay_of[i]]
    boats.clearances[i] = hull_clearance(corners, model.outline.radius, bay)
