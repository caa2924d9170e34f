"""The capsule against the cave's mesh in Warp: where it would touch, and what the wall does to its motion.

The distance field says whether the wall is within reach at all; then the exact triangles judge. The rule is the one by
which Bullet solves contacts beside our integrator: a step's mean velocity is changed by impulses at the points nearest
to the wall, so that none of them gets farther into it, with Coulomb friction. The body gets one mass and one inertia
for all axes, as there.

An end of the capsule may touch more than one wall: in a groove it would be kept off the nearest and pressed into the
other, in turns. Where an end overlaps its nearest wall, up to two more are sought, each of which rises above the planes
that touch the end at those found before.
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
"""Of the solver."""
MAX_CONTACTS = 7
"""Three at each end of the axis, and one between."""
OVERLAP = wp.constant(wp.float64(0.002))
"""Of an end and its nearest wall, from which on others are sought, m; chosen: on smooth walls there is less. At 1 mm,
scraping along a rugged cave takes a fifth longer."""
FIELD_ERROR = wp.constant(wp.float64(0.5 * 3.0**0.5))
"""Spacings of the field by which its clearance may differ from the distance to the wall: a distance changes no faster
than the position, and the mean distance to a cell's eight corners, weighted as the interpolation does, is at most
sqrt(3) / 2 spacings."""
mat73 = wp.types.matrix(shape=(MAX_CONTACTS, 3), dtype=wp.float64)
vec7 = wp.types.vector(length=MAX_CONTACTS, dtype=wp.float64)
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
    """Points of a hull that are near the wall."""

    gaps: vec7
    """m; negative where hull and wall overlap."""
    normals: mat73
    """Rows: out of the wall."""
    arms: mat73
    """Rows: from the vehicle's middle to the wall's point."""
    count: wp.int32


@wp.struct
class Near:
    """The point of the wall nearest to a point of the axis."""

    offset: wp.vec3
    """From there to the axis."""
    arm: wp.vec3
    """From the vehicle's middle to the wall's point."""
    face: wp.int32
    """Of the wall; -1 where none is within reach."""


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
def row(matrix: mat73, n: int):
    """Return a row whose number is not known when compiling."""
    return wp.vec3d(matrix[n, 0], matrix[n, 1], matrix[n, 2])


@wp.func
def is_behind(place: wp.vec3d, offset: wp.vec3, grid: Grid, mesh: wp.uint64, face: int):
    """Return whether a point of the axis, at `offset` from the wall's nearest, is behind the wall.

    Beside a sharp ridge one of its two faces looks away from the water there, so where the field is sure of water, the
    faces are not asked.
    """
    if wp.dot(offset, wp.mesh_eval_face_normal(mesh, face)) <= 0.0:
        return False
    return clearance_at(grid, place) < FIELD_ERROR * grid.spacing


@wp.func
def with_contact(contacts: Contacts, state: State, hull: Hull, grid: Grid, mesh: wp.uint64, near: Near):
    """Return the contacts and one more, if it is near enough."""
    distance = wp.length(near.offset)
    if distance < 1.0e-6:
        return contacts
    side = 1.0
    if is_behind(state.position + wp.vec3d(near.arm + near.offset), near.offset, grid, mesh, near.face):
        side = -1.0
    gap = f64(side * distance) - hull.radius
    if gap > hull.margin:
        return contacts
    result = contacts
    normal = wp.vec3d(near.offset * (side / distance))
    n = result.count
    for axis in range(3):
        result.normals[n, axis] = normal[axis]
        result.arms[n, axis] = f64(near.arm[axis])
    result.gaps[n] = gap
    result.count = n + 1
    return result


@wp.func
def rises(place: wp.vec3, contacts: Contacts, first: int, hull: Hull):
    """Return whether a place, relative to the middle, is above the planes that touch the hull at contacts from `first`.

    A hull that is kept off these planes is kept off all that does not rise above them.
    """
    for n in range(first, contacts.count):
        height = wp.dot(wp.vec3d(place) - row(contacts.arms, n), row(contacts.normals, n))
        if height <= hull.margin:
            return False
    return True


@wp.func
def closest_on_triangle(p: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the point of a triangle nearest to `p`, by the regions of its plane (Ericson 2004, chapter 5.1)."""
    ab, ac = b - a, c - a
    d1, d2 = wp.dot(ab, p - a), wp.dot(ac, p - a)
    d3, d4 = wp.dot(ab, p - b), wp.dot(ac, p - b)
    d5, d6 = wp.dot(ab, p - c), wp.dot(ac, p - c)
    beside_c, beside_b, beside_a = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if d1 <= 0.0 and d2 <= 0.0:
        return a
    if d3 >= 0.0 and d4 <= d3:
        return b
    if d6 >= 0.0 and d5 <= d6:
        return c
    if beside_c <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return a + d1 / (d1 - d3) * ab
    if beside_b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return a + d2 / (d2 - d6) * ac
    if beside_a <= 0.0 and d4 >= d3 and d5 >= d6:
        return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b)
    return a + (beside_b * ab + beside_c * ac) / (beside_a + beside_b + beside_c)


@wp.func
def nearest_rise(end: wp.vec3, centre: wp.vec3, contacts: Contacts, first: int, hull: Hull, mesh: wp.uint64):
    """Return what is nearest to an end of the axis among the walls before it that rise above its contacts' planes."""
    reach = float(hull.radius + hull.margin)
    found, nearest, face = Near(), reach, int(0)
    found.face = -1
    points, indices = wp.mesh_get(mesh).points, wp.mesh_get(mesh).indices
    span = wp.vec3(reach, reach, reach)
    normal = wp.vec3(row(contacts.normals, first))
    plane = wp.dot(centre + wp.vec3(row(contacts.arms, first)), normal) + float(hull.margin)
    near = wp.mesh_query_aabb(mesh, end - span, end + span)
    while wp.mesh_query_aabb_next(near, face):
        a, b, c = points[indices[3 * face]], points[indices[3 * face + 1]], points[indices[3 * face + 2]]
        if wp.max(wp.dot(a, normal), wp.max(wp.dot(b, normal), wp.dot(c, normal))) <= plane:
            continue
        side = wp.cross(b - a, c - a)
        height = wp.dot(a - end, side)
        if height <= 0.0 or height * height > nearest * nearest * wp.dot(side, side):
            continue  # seen from behind, or out of reach
        wall = closest_on_triangle(end, a, b, c)
        distance = wp.length(end - wall)
        if distance < nearest and rises(wall - centre, contacts, first, hull):
            nearest = distance
            found.offset = end - wall
            found.arm = wall - centre
            found.face = int(face)
    return found


@wp.func
def with_end(contacts: Contacts, arm: wp.vec3, centre: wp.vec3, state: State, hull: Hull, grid: Grid, mesh: wp.uint64):
    """Return the contacts and those of the end of the axis at `arm` from the middle."""
    found, first, end, near = contacts, contacts.count + 0, centre + arm, Near()
    query = wp.mesh_query_point_no_sign(mesh, end, float(hull.radius + hull.margin))
    if query.result:
        wall = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        near.offset = end - wall
        near.arm = wall - centre
        near.face = query.face
        found = with_contact(found, state, hull, grid, mesh, near)
    if found.count > first and found.gaps[first] < -OVERLAP:
        for _ in range(2):
            near = nearest_rise(end, centre, found, first, hull, mesh)
            if near.face < 0:
                break
            found = with_contact(found, state, hull, grid, mesh, near)
    return found


@wp.func
def is_beyond(place: wp.vec3, nose: wp.vec3, distance: float):
    """Return whether a place, relative to the middle, is farther than `distance` from the capsule's axis."""
    share = wp.clamp(wp.dot(place, nose) / wp.dot(nose, nose), -1.0, 1.0)
    offset = place - share * nose
    return wp.dot(offset, offset) > distance * distance


@wp.func
def nearest_edge(centre: wp.vec3, nose: wp.vec3, hull: Hull, mesh: wp.uint64):
    """Return the nearest edge of the wall to what lies between the axis's ends."""
    reach = float(hull.radius + hull.margin)
    span = wp.vec3(wp.abs(nose[0]) + reach, wp.abs(nose[1]) + reach, wp.abs(nose[2]) + reach)
    points, indices = wp.mesh_get(mesh).points, wp.mesh_get(mesh).indices
    found, nearest, face = Near(), reach, int(0)
    found.face = -1
    near = wp.mesh_query_aabb(mesh, centre - span, centre + span)
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
                wall = wp.lerp(a, b, apart[1])
                nearest = apart[2]
                found.face = int(face)
                found.arm = wall - centre
                found.offset = (2.0 * apart[0] - 1.0) * nose - found.arm
    return found


@wp.func
def find_contacts(state: State, hull: Hull, grid: Grid, mesh: wp.uint64, middle: wp.vec3d):
    """Return the hull's points near the mesh, nearest to the axis's two ends and to what lies between them."""
    centre, nose = wp.vec3(state.position - middle), wp.vec3(nose_of(state, hull))
    found = with_end(Contacts(), nose, centre, state, hull, grid, mesh)
    if hull.half_axis > f64(0.0):
        found = with_end(found, -nose, centre, state, hull, grid, mesh)
        near = nearest_edge(centre, nose, hull, mesh)
        if near.face >= 0:
            found = with_contact(found, state, hull, grid, mesh, near)
    return found


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
    pushed, rubbed = vec7(), vec7()
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
    contacts = find_contacts(state, hull, grid, mesh, middle)
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
