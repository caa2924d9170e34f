"""What the cave's wall does to a capsule's motion, in Warp.

The distance field says whether the wall is within reach at all; then the exact triangles judge. The rule is the one by
which Bullet solves contacts beside our integrator: a step's mean velocity is changed by impulses at the points nearest
to the wall, so that none of them gets farther into it, with Coulomb friction. The body gets one mass and one inertia
for all axes, as there.
"""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.bvh import Bvh
from aquanav_tools.sim.batch.contact_points import Contacts, Hull, find_contacts, nose_of, row, vec9
from aquanav_tools.sim.batch.field import Grid, clearance_at
from aquanav_tools.sim.batch.motion import State, angular, linear, rotation_of, six, vec6
from aquanav_tools.sim.batch.original import turned
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64
ITERATIONS = 10
"""Of the solver, at most."""
SETTLED = wp.constant(wp.float64(1e-9))
"""Change of an impulse per mass, m/s, up to which the solver is done: mostly after two or three iterations."""
RECOVERY = wp.constant(wp.float64(0.08))
"""Share of an overlap that is taken back in a step, measured in PyBullet."""


@wp.func
def axis_clearance(grid: Grid, state: State, hull: Hull):
    """Return the distance of the capsule's axis from the nearest wall, m, as `hull.hull_clearance` samples it."""
    nose = nose_of(state, hull)
    ends = wp.min(clearance_at(grid, state.position + nose), clearance_at(grid, state.position - nose))
    return wp.min(ends, clearance_at(grid, state.position))


@wp.func
def largest_move(before: State, after: State, hull: Hull):
    """Return how far an end of the capsule's axis moves, m; no point of the axis moves farther."""
    shift, swing = after.position - before.position, nose_of(after, hull) - nose_of(before, hull)
    return wp.max(wp.length(shift + swing), wp.length(shift - swing))


@wp.func
def kicked(motion: vec6, arm: wp.vec3d, impulse: wp.vec3d, hull: Hull):
    """Return a world-frame velocity and rate of turn after an impulse at `arm` from the middle."""
    return six(linear(motion) + impulse / hull.mass, angular(motion) + wp.cross(arm, impulse) / hull.inertia)


@wp.func
def speed_at(motion: vec6, arm: wp.vec3d):
    """Return the velocity of the body's point at `arm`."""
    return linear(motion) + wp.cross(angular(motion), arm)


@wp.func
def mobility_at(arm: wp.vec3d, direction: wp.vec3d, hull: Hull):
    """Return the change of speed of a point in a direction per impulse in that direction."""
    lever = wp.cross(arm, direction)
    return f64(1.0) / hull.mass + wp.dot(lever, lever) / hull.inertia


@wp.func
def solved(intended: vec6, contacts: Contacts, hull: Hull, dt: f64):
    """Return the motion after the wall's impulses; the same as `intended` when no point would get into the wall."""
    zero = f64(0.0)
    motion = intended
    pushed, rubbed = vec9(), vec9()
    count = contacts.count + 0
    for _ in range(ITERATIONS):
        change = zero
        for n in range(count):
            normal, arm, gap = row(contacts.normals, n), row(contacts.arms, n), contacts.gaps[n]
            allowed = -gap / dt
            if gap < zero:
                allowed = -gap / dt * RECOVERY
            lacking = allowed - wp.dot(normal, speed_at(motion, arm))
            total = wp.max(pushed[n] + lacking / mobility_at(arm, normal, hull), zero)
            motion = kicked(motion, arm, (total - pushed[n]) * normal, hull)
            change = wp.max(change, wp.abs(total - pushed[n]))
            pushed[n] = total
            sliding = speed_at(intended, arm)
            sliding -= wp.dot(sliding, normal) * normal
            if wp.length(sliding) > f64(1e-9):
                along = wp.normalize(sliding)
                brake = rubbed[n] - wp.dot(along, speed_at(motion, arm)) / mobility_at(arm, along, hull)
                brake = wp.clamp(brake, -hull.friction * total, hull.friction * total)
                motion = kicked(motion, arm, (brake - rubbed[n]) * along, hull)
                change = wp.max(change, wp.abs(brake - rubbed[n]))
                rubbed[n] = brake
        if change <= SETTLED * hull.mass:
            count = 0  # a break would slow down vehicles in open water by a quarter
    return motion


@wp.func
def mean_motion(before: State, after: State, dt: f64):
    """Return the world-frame velocity and rate of turn that, held for `dt`, lead from one state to the next."""
    a, b = after.orientation, before.orientation
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = -a[0] * b[1] + a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    y = -a[0] * b[2] + a[1] * b[3] + a[2] * b[0] - a[3] * b[1]
    z = -a[0] * b[3] - a[1] * b[2] + a[2] * b[1] + a[3] * b[0]
    turn = wp.vec3d(x, y, z)
    sine = wp.length(turn)
    scale = f64(2.0)
    if sine > f64(1e-12):
        scale = f64(2.0) * wp.atan2(sine, wp.abs(w)) / sine
    if w < f64(0.0):
        scale = -scale
    return six((after.position - before.position) / dt, turn * (scale / dt))


@wp.func
def beside_wall(state: State, free: State, hull: Hull, grid: Grid, wall: Bvh, middle: wp.vec3d, dt: f64):
    """Return the state after a step beside the wall, and whether it was touched.

    Without contact it is `free`. With one, the pose follows the changed motion.
    """
    contacts = find_contacts(state, hull, grid, wall, middle)
    intended = mean_motion(state, free, dt)
    motion = solved(intended, contacts, hull, dt)
    change = motion - intended
    if wp.dot(change, change) == f64(0.0):
        return free, False
    position = state.position + dt * linear(motion)
    into_body = wp.transpose(rotation_of(state.orientation))
    orientation = turned(state.orientation, into_body * angular(motion), dt)
    return after_contact(state, free, position, orientation, change, hull, grid), True


@wp.func
def after_contact(
    state: State, free: State, position: wp.vec3d, orientation: wp.vec4d, change: vec6, hull: Hull, grid: Grid
):
    """Return the state after a step in which the wall was touched.

    The pose is the one given. The velocity is that of `free` with the change that the wall made, world frame. A solver
    pushes overlapping shapes apart by adding velocity, but a wall at rest gives no energy: there is never more than
    without it. What tunnelled through the thin shell, or was pressed through it, goes back, and stops.
    """
    result = State()
    result.position = position
    result.orientation = orientation
    into_body = wp.transpose(rotation_of(orientation))
    result.velocity = free.velocity + six(into_body * linear(change), into_body * angular(change))
    before = wp.dot(free.velocity, wp.cw_mul(hull.masses, free.velocity))
    after = wp.dot(result.velocity, wp.cw_mul(hull.masses, result.velocity))
    if after > before:
        result.velocity *= wp.sqrt(before / after)
    if clearance_at(grid, result.position) < f64(0.0):
        result.position = state.position
        result.orientation = state.orientation
        result.velocity = vec6()
    return result
