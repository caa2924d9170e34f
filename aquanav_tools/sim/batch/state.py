"""What the kernels read and write of the vehicles: one row of each array per vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.motion import vec6
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.struct
class BatchState:
    """All vehicles of a batch."""

    cave_of: wp.array(dtype=wp.int32)
    """(N,) index of the cave that each vehicle is in."""
    craft_of: wp.array(dtype=wp.int32)
    """(N,) index of the body that each vehicle has."""
    seeds: wp.array(dtype=wp.int32)
    """(N,) of the episodes: 32 bits each, from which all that is drawn follows."""
    order: wp.array(dtype=wp.int32)
    """(N,) vehicles in the order in which they are computed."""
    ray_noise: wp.array(dtype=wp.float32)
    """(N,) standard deviation of an echo's distance, m."""
    ray_dropout: wp.array(dtype=wp.float32)
    """(N,) probability that a ray gets no echo."""
    ray_gain: wp.array(dtype=wp.float32)
    """(N,) factor of the distances that rays measure, where dynamics are drawn; so the next three."""
    ray_bias: wp.array(dtype=wp.float32)
    """(N,) what is added to them, m."""
    action_delays: wp.array(dtype=wp.int32)
    """(N,) decisions."""
    observation_delays: wp.array(dtype=wp.int32)
    """(N,) decisions."""
    current_ranges: wp.array(dtype=wp.vec2d)
    """(N,) between which an episode draws its fraction of the water's velocity."""
    commands: wp.array2d(dtype=wp.float32)
    """(N, 3) ballast, steer and thrust."""
    acting: wp.array2d(dtype=wp.float32)
    """(N, 3) the command that takes effect: an earlier one where actions are delayed."""
    waiting_commands: wp.array2d(dtype=wp.float32)
    """(N, 3 D) commands of the last D decisions, without effect so far."""
    waiting_observations: wp.array2d(dtype=wp.float32)
    """(N, V D) observations of the last D decisions, not seen so far."""
    positions: wp.array(dtype=wp.vec3d)
    orientations: wp.array(dtype=wp.vec4d)
    velocities: wp.array(dtype=vec6)
    previous_positions: wp.array(dtype=wp.vec3d)
    """One physics step ago; the observation "original" looks back, others leave them as they are."""
    previous_orientations: wp.array(dtype=wp.vec4d)
    extra: wp.array2d(dtype=f64)
    """Thrusters' forces, or the height of the water's surface."""
    levels: wp.array(dtype=f64)
    """State of the ballast: trim, or a floater's power."""
    currents: wp.array(dtype=wp.vec3d)
    """Of the water where the vehicle is, held for the next decision, world frame, m/s."""
    current_fractions: wp.array(dtype=f64)
    """Of the water's velocity that this episode has."""
    phases: wp.array(dtype=f64)
    """Of the waves on the surface, rad."""
    eddies: wp.array2d(dtype=f64)
    """(N, C) coefficients of the gusts and eddies around each vehicle."""
    gates: wp.array(dtype=wp.int32)
    remaining: wp.array(dtype=f64)
    """Along the guide, m."""
    to_go: wp.array(dtype=f64)
    """By the measure that the reward goes by, m."""
    panels_crossed: wp.array(dtype=wp.int32)
    """(N,) panels crossed in this episode, by the original's measure of progress."""
    touched_panels: wp.array2d(dtype=wp.bool)
    """(N, P) panels that the vehicle touches, by the same; else P is 0."""
    gained: wp.array(dtype=f64)
    """What the way to go became shorter by in the last decision, m."""
    decisions: wp.array(dtype=wp.int32)
    ages: wp.array(dtype=wp.int32)
    """Decisions by which this episode's time runs out earlier."""
    episodes: wp.array(dtype=wp.int32)
    start_indices: wp.array(dtype=wp.int32)
    """In the scenario's list; -1 where the start is in none."""
    beginnings: wp.array(dtype=wp.vec3d)
    """Where the episodes began, m."""
    wanted_starts: wp.array(dtype=wp.int32)
    """Index of the next episode's start, or DRAWN or UNLISTED."""
    touched: wp.array(dtype=wp.int32)
    """Physics steps of the last decision in contact."""
    is_touching: wp.array(dtype=wp.int32)
    collisions: wp.array(dtype=wp.int32)
    """Contacts begun in this episode: one that lasts counts once, until a whole decision passes without."""
    outcomes: wp.array(dtype=wp.int32)
    """0 running, 1 success, 2 collision, 3 timeout."""
    restarted: wp.array(dtype=wp.int32)
    """Whether this step began an episode."""
    rays: wp.array2d(dtype=wp.float32)
    """(N, R) true distances, m."""
    tags: wp.array2d(dtype=wp.int32)
    """(N, R) what the rays met, as in `spheres`, by the observation "original"; else R is 0."""
    clearances: wp.array(dtype=wp.float32)
    """Of the hull, m."""
    observations: wp.array2d(dtype=wp.float32)
    final_observations: wp.array2d(dtype=wp.float32)
    terms: wp.array2d(dtype=wp.float32)
    """(N, 7) of the reward."""
    rewards: wp.array(dtype=wp.float32)
    terminated: wp.array(dtype=wp.bool)
    truncated: wp.array(dtype=wp.bool)
    returns: wp.array(dtype=wp.float32)
    """Sum of rewards in this episode."""
    last_outcomes: wp.array(dtype=wp.int32)
    """The last step's outcome, which the beginning of the next episode leaves as it is; so the next three."""
    last_returns: wp.array(dtype=wp.float32)
    last_lengths: wp.array(dtype=wp.int32)
    last_collisions: wp.array(dtype=wp.int32)


def make_state(num: int, widths: dict[str, int], device: Any) -> BatchState:
    """Return the arrays of N vehicles, all zeros; `widths` are those of the arrays with two dimensions."""
    state = BatchState()
    for name, field in BatchState.vars.items():  # type: ignore[attr-defined]  # Warp makes the class a struct
        shape = (num, widths[name]) if field.type.ndim == 2 else (num,)
        setattr(state, name, wp.zeros(shape, dtype=field.type.dtype, device=device))
    state.order.assign(np.arange(num, dtype=np.int32))
    return state


@wp.struct
class ContactExchange:
    """What kernels and a contact engine outside of them tell each other; rows as in `BatchState`."""

    status: wp.array(dtype=wp.int32)
    """(N,) NO_QUESTION; ASKED, by the kernel, what the wall does, and the answer FREE or TOUCHED; UNMOVED, by the
    kernel, where a law of motion outside of it is to say where the step would lead, and the answer MOVED."""
    steps: wp.array(dtype=wp.int32)
    """(N,) physics steps of this decision that are done."""
    is_continued: wp.array(dtype=wp.int32)
    """(N,) whether the vehicle is where the engine's last answer left it."""
    free_positions: wp.array(dtype=wp.vec3d)
    """Where the step would lead were there no wall; so the next two."""
    free_orientations: wp.array(dtype=wp.vec4d)
    free_velocities: wp.array(dtype=vec6)
    questions: wp.array2d(dtype=f64)
    """(N, 13) position and quaternion before the step; world-frame velocity and rate of turn that lead there."""
    answers: wp.array2d(dtype=f64)
    """(N, 13) position and quaternion to which the wall lets the step lead; velocity and rate of turn after it."""


NO_QUESTION, ASKED, FREE, TOUCHED, UNMOVED, MOVED = (wp.constant(n) for n in range(6))


def make_exchange(num: int, device: Any) -> ContactExchange:
    """Return the arrays of N vehicles."""
    exchange = ContactExchange()
    for name, field in ContactExchange.vars.items():  # type: ignore[attr-defined]
        shape = (num, 13) if field.type.ndim == 2 else num
        setattr(exchange, name, wp.zeros(shape, dtype=field.type.dtype, device=device))
    return exchange
