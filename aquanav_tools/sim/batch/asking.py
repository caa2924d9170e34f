"""What the kernels ask an engine for contacts, or a law of motion, outside of them; and where its answer leads."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.contact import after_contact, mean_motion
from aquanav_tools.sim.batch.craft import Craft
from aquanav_tools.sim.batch.motion import State, read_motion, vec6
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.state import ASKED, TOUCHED, ContactExchange

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.func
def given_motion(i: int, exchange: ContactExchange):
    """Return where vehicle `i` would go were there no wall, as an exchange has it."""
    return read_motion(i, exchange.free_positions, exchange.free_orientations, exchange.free_velocities)


@wp.func
def ask(i: int, step: int, moving: State, free: State, exchange: ContactExchange, dt: f64):
    """Ask the engine what the wall does to a step of vehicle `i`."""
    exchange.status[i] = ASKED
    exchange.steps[i] = step
    exchange.free_positions[i] = free.position
    exchange.free_orientations[i] = free.orientation
    exchange.free_velocities[i] = free.velocity
    intended = mean_motion(moving, free, dt)
    for n in range(3):
        exchange.questions[i, n] = moving.position[n]
    for n in range(4):
        exchange.questions[i, 3 + n] = moving.orientation[n]
    for n in range(6):
        exchange.questions[i, 7 + n] = intended[n]


@wp.func
def answered(i: int, moving: State, exchange: ContactExchange, craft: Craft, cave: Cave):
    """Return where the engine's answer leads vehicle `i`."""
    free = given_motion(i, exchange)
    exchange.is_continued[i] = 1
    if exchange.status[i] != TOUCHED:
        return free
    position, orientation, change = wp.vec3d(), wp.vec4d(), vec6()
    for n in range(3):
        position[n] = exchange.answers[i, n]
    for n in range(4):
        orientation[n] = exchange.answers[i, 3 + n]
    for n in range(6):
        change[n] = exchange.answers[i, 7 + n] - exchange.questions[i, 7 + n]
    result = after_contact(moving, free, position, orientation, change, craft.hull, cave.grid)
    if wp.length_sq(result.position - position) > f64(0.0):
        exchange.is_continued[i] = 0  # it was put back into the water
    return result
