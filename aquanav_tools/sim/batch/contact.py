"""The capsule against the cave's mesh in Warp: where it would touch, and what the wall does to its motion.

The distance field says whether the wall is within reach at all; then the exact triangles judge. The rule is the one by
which Bullet solves contacts beside our integrator: a step's mean velocity is changed by impulses at the points nearest
to the wall, so that none of them gets farther into it, with Coulomb friction. The body gets one mass and one inertia
for all axes, as there.
"""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.field import Grid, clearance_at
from aquanav_tools.sim.batch.motion import State, angular, linear, rotation_of, six, vec6
from aquanav_tools.sim.batch.original import turned
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64
ITERATIONS = 10
"""Of the solver; contacts are three at most."""
RECOVERY = wp.constant(wp.float64(0.08))
"""Share of an overlap that is taken back in a step, measured in PyBullet."""


@wp.struct
class Hull:
    """A capsule along body x, and what resists its change of motion."""

    half_axis: f64
    radius: f64
    reach: f64
    """Clearance of the axis above which no contact can be found, m."""
    margin: f64
    """Contacts are kept up to this distance, m."""
    friction: f64
    mass: f64
    """Mean over the axes, kg; the wall's impulses act on it."""
    inertia: f64
    masses: vec6
    """Per axis; kinetic energy is counted with them."""


@wp.struct
class Contacts:
    """Up to three points of a hull that are near the wall."""

    gaps: wp.vec3d
    """m; negative where hull and wall overlap."""
    normals: wp.mat33d
    """Rows: out of the wall."""
    arms: wp.mat33d
    """Rows: from the vehicle's middle to the hull's point."""
    count: wp.int32


@wp.func
def nose_of(state: State, hull: Hull):
    """Return the axis's front end relative to the middle, in the world."""
    rotation = rotation_of(state.orientation)
    return hull.half_axis * wp.vec3d(rotation[0, 0], rotation[1, 0], rotation[2, 0])


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
def with_contact(contacts: Contacts, hull: Hull, mesh: wp.uint64, offset: wp.vec3, wall: wp.vec3, face: int):
    """Return the contacts and one more, between the axis's point at `offset` from `wall`, if it is near enough."""
    distance = wp.length(offset)
    if distance < 1.0e-6:
        return contacts
    side = 1.0
    if wp.dot(offset, wp.mesh_eval_face_normal(mesh, face)) > 0.0:
        side = -1.0  # this point of the axis is behind the wall
    gap = f64(side * distance) - hull.radius
    if gap > hull.margin:
        return contacts
    result = contacts
    normal = wp.vec3d(offset * (side / distance))
    n = result.count
    for axis in range(3):
        result.normals[n, axis] = normal[axis]
        result.arms[n, axis] = f64(wall[axis])
    result.gaps[n] = gap
    result.count = n + 1
    return result


@wp.func
def is_beyond(place: wp.vec3, nose: wp.vec3, distance: float):
    """Return whether a place, relative to the middle, is farther than `distance` from the capsule's axis."""
    share = wp.clamp(wp.dot(place, nose) / wp.dot(nose, nose), -1.0, 1.0)
    offset = place - share * nose
    return wp.dot(offset, offset) > distance * distance


@wp.func
def find_contacts(state: State, hull: Hull, mesh: wp.uint64, middle: wp.vec3d):
    """Return the hull's points near the mesh, nearest to the axis's two ends and to what lies between them."""
    centre, nose = wp.vec3(state.position - middle), wp.vec3(nose_of(state, hull))
    found = Contacts()
    reach = float(hull.radius + hull.margin)
    query = wp.mesh_query_point_no_sign(mesh, centre + nose, reach)
    if query.result:
        wall = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        found = with_contact(found, hull, mesh, centre + nose - wall, wall - centre, query.face)
    if hull.half_axis > f64(0.0):
        query = wp.mesh_query_point_no_sign(mesh, centre - nose, reach)
        if query.result:
            wall = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
            found = with_contact(found, hull, mesh, centre - nose - wall, wall - centre, query.face)
        span = wp.vec3(wp.abs(nose[0]) + reach, wp.abs(nose[1]) + reach, wp.abs(nose[2]) + reach)
        points, indices = wp.mesh_get(mesh).points, wp.mesh_get(mesh).indices
        nearest, share, wall, edge_face = reach, float(0.0), wp.vec3(), int(-1)
        near = wp.mesh_query_aabb(mesh, centre - span, centre + span)
        face = int(0)
        while wp.mesh_query_aabb_next(near, face):
            for side in range(3):
                tail = indices[3 * face + side]
                tip = indices[3 * face + (side + 1) % 3]
                if tail > tip:
                    continue  # the face on the other side has this edge the other way round
                a = points[tail]
                b = points[tip]
                if is_beyond(0.5 * (a + b) - centre, nose, nearest + 0.5 * wp.length(b - a)):
                    continue
                apart = wp.closest_point_edge_edge(centre - nose, centre + nose, a, b, 1.0e-9)
                if apart[2] < nearest and apart[0] > 0.0 and apart[0] < 1.0:
                    nearest, share, edge_face = apart[2], apart[0], face
                    wall = wp.lerp(a, b, apart[1])
        if edge_face >= 0:
            place = centre + (2.0 * share - 1.0) * nose
            found = with_contact(found, hull, mesh, place - wall, wall - centre, edge_face)
    return found


@wp.func
def row(matrix: wp.mat33d, n: int):
    """Return a row whose number is not known when compiling."""
    return wp.vec3d(matrix[n, 0], matrix[n, 1], matrix[n, 2])


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
    pushed, rubbed = wp.vec3d(), wp.vec3d()
    for _ in range(ITERATIONS):
        for n in range(contacts.count):
            normal, arm, gap = row(contacts.normals, n), row(contacts.arms, n), contacts.gaps[n]
            allowed = -gap / dt
            if gap < zero:
                allowed = -gap / dt * RECOVERY
            lacking = allowed - wp.dot(normal, speed_at(motion, arm))
            total = wp.max(pushed[n] + lacking / mobility_at(arm, normal, hull), zero)
            motion = kicked(motion, arm, (total - pushed[n]) * normal, hull)
            pushed[n] = total
            sliding = speed_at(intended, arm)
            sliding -= wp.dot(sliding, normal) * normal
            if wp.length(sliding) > f64(1e-9):
                along = wp.normalize(sliding)
                brake = rubbed[n] - wp.dot(along, speed_at(motion, arm)) / mobility_at(arm, along, hull)
                brake = wp.clamp(brake, -hull.friction * total, hull.friction * total)
                motion = kicked(motion, arm, (brake - rubbed[n]) * along, hull)
                rubbed[n] = brake
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
def beside_wall(state: State, free: State, hull: Hull, grid: Grid, mesh: wp.uint64, middle: wp.vec3d, dt: f64):
    """Return the state after a step beside the wall, and whether it was touched.

    Without contact it is `free`. With one, the pose follows the changed motion.
    """
    contacts = find_contacts(state, hull, mesh, middle)
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
