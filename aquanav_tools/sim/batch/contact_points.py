"""The points of a capsule that are near a cave's wall: at both ends of its axis, and between them.

An end may touch more than one wall: in a groove it would be kept off the nearest and pressed into the other, in turns.
Where an end overlaps its nearest wall, up to two more are sought, each of which rises above the planes that touch the
end at those found before. Between the ends likewise; there a hull on a ridge may also turn onto the next one, so that
the others may as well be apart from those found before.
"""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.bvh import FOUND, LANES, Bvh, corner_of, highest_bit, leaves_near, nearest_in_leaf
from aquanav_tools.sim.batch.field import Grid, clearance_at
from aquanav_tools.sim.batch.motion import State, rotation_of, vec6
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64
MAX_CONTACTS = 9
"""Three at each end of the axis, and three between."""
OVERLAP = wp.constant(wp.float64(0.002))
"""Of an end and its nearest wall, from which on others are sought, m; chosen: on smooth walls there is less. At 1 mm,
scraping along a rugged cave takes a fifth longer."""
APART = wp.constant(wp.float64(0.25))
"""Half axes from which on two contacts between the ends are apart; chosen: nearer ones that take turns let each other
in by a few millimetres (tests)."""
FIELD_ERROR = wp.constant(wp.float64(0.5 * 3.0**0.5))
"""Spacings of the field by which its clearance may differ from the distance to the wall: a distance changes no faster
than the position, and the mean distance to a cell's eight corners, weighted as the interpolation does, is at most
sqrt(3) / 2 spacings."""
mat93 = wp.types.matrix(shape=(MAX_CONTACTS, 3), dtype=wp.float64)
vec9 = wp.types.vector(length=MAX_CONTACTS, dtype=wp.float64)


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

    gaps: vec9
    """m; negative where hull and wall overlap."""
    normals: mat93
    """Rows: out of the wall."""
    arms: mat93
    """Rows: from the vehicle's middle to the wall's point."""
    count: wp.int32


@wp.struct
class Near:
    """The point of the wall nearest to a point of the axis."""

    offset: wp.vec3
    """From there to the axis."""
    arm: wp.vec3
    """From the vehicle's middle to the wall's point."""
    normal: wp.vec3
    """Of the wall's face."""
    distance: wp.float32
    """From there to the axis, m; as far as was looked where there is none."""
    is_found: wp.int32


@wp.func
def nose_of(state: State, hull: Hull):
    """Return the axis's front end relative to the middle, in the world."""
    rotation = rotation_of(state.orientation)
    return hull.half_axis * wp.vec3d(rotation[0, 0], rotation[1, 0], rotation[2, 0])


@wp.func
def row(matrix: mat93, n: int):
    """Return a row whose number is not known when compiling."""
    return wp.vec3d(matrix[n, 0], matrix[n, 1], matrix[n, 2])


@wp.func
def is_behind(place: wp.vec3d, near: Near, grid: Grid):
    """Return whether a point of the axis is behind the wall.

    Beside a sharp ridge one of its two faces looks away from the water there, so where the field is sure of water, the
    faces are not asked.
    """
    if wp.dot(near.offset, near.normal) <= 0.0:
        return False
    return clearance_at(grid, place) < FIELD_ERROR * grid.spacing


@wp.func
def with_contact(contacts: Contacts, state: State, hull: Hull, grid: Grid, near: Near):
    """Return the contacts and one more, if it is near enough."""
    distance = wp.length(near.offset)
    if distance < 1.0e-6:
        return contacts
    side = 1.0
    if is_behind(state.position + wp.vec3d(near.arm + near.offset), near, grid):
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
def on_face(wall: Bvh, leaf: int, lane: int, point: wp.vec3, place: wp.vec3, centre: wp.vec3):
    """Return the point of the axis at `point` and the wall's at `place`, which is on a triangle."""
    a, b, c = corner_of(wall, leaf, lane, 0), corner_of(wall, leaf, lane, 1), corner_of(wall, leaf, lane, 2)
    near = Near()
    near.offset = point - place
    near.arm = place - centre
    near.normal = wp.normalize(wp.cross(b - a, c - a))
    near.distance = wp.length(near.offset)
    near.is_found = 1
    return near


@wp.func
def nearest_rise(end: wp.vec3, centre: wp.vec3, contacts: Contacts, first: int, hull: Hull, wall: Bvh):
    """Return what is nearest to an end of the axis among the walls before it that rise above its contacts' planes."""
    found, reach = Near(), float(hull.radius + hull.margin)
    found.distance = reach
    normal = wp.vec3(row(contacts.normals, first))
    plane = wp.dot(centre + wp.vec3(row(contacts.arms, first)), normal) + float(hull.margin)
    more = int(0)
    while more >= 0:
        leaves = leaves_near(wall.nodes, wall.firsts, wall.num_levels, end, end, reach, more)
        more = leaves[FOUND]
        for n in range(FOUND):
            if leaves[n] < 0:
                break
            for lane in range(LANES):
                a, b = corner_of(wall, leaves[n], lane, 0), corner_of(wall, leaves[n], lane, 1)
                c = corner_of(wall, leaves[n], lane, 2)
                if wp.max(wp.dot(a, normal), wp.max(wp.dot(b, normal), wp.dot(c, normal))) <= plane:
                    continue
                side = wp.cross(b - a, c - a)
                height = wp.dot(a - end, side)
                if height <= 0.0 or height * height > found.distance * found.distance * wp.dot(side, side):
                    continue  # seen from behind, or out of reach
                place = closest_on_triangle(end, a, b, c)
                if wp.length(end - place) < found.distance and rises(place - centre, contacts, first, hull):
                    found = on_face(wall, leaves[n], lane, end, place, centre)
    return found


@wp.func
def with_end(
    contacts: Contacts, end: wp.vec3, near: Near, centre: wp.vec3, state: State, hull: Hull, grid: Grid, wall: Bvh
):
    """Return the contacts and those of an end of the axis, of which the nearest one is given."""
    if near.is_found == 0:
        return contacts
    first = contacts.count + 0
    found = with_contact(contacts, state, hull, grid, near)
    if found.count > first and found.gaps[first] < -OVERLAP:
        for _ in range(2):
            other = nearest_rise(end, centre, found, first, hull, wall)
            if other.is_found == 0:
                break
            found = with_contact(found, state, hull, grid, other)
    return found


@wp.func
def is_beyond(place: wp.vec3, nose: wp.vec3, distance: float):
    """Return whether a place, relative to the middle, is farther than `distance` from the capsule's axis."""
    share = wp.clamp(wp.dot(place, nose) / wp.dot(nose, nose), -1.0, 1.0)
    offset = place - share * nose
    return wp.dot(offset, offset) > distance * distance


@wp.func
def is_apart(share: float, nose: wp.vec3, contacts: Contacts, first: int, hull: Hull):
    """Return whether a place of the axis, from -1 to 1, is apart from those of contacts from `first`."""
    for n in range(first, contacts.count):
        place = row(contacts.arms, n) + (contacts.gaps[n] + hull.radius) * row(contacts.normals, n)
        along = wp.dot(place, wp.vec3d(nose)) / (hull.half_axis * hull.half_axis)
        if wp.abs(f64(share) - along) < APART:
            return False
    return True


@wp.func
def nearer_edge(
    nearest: Near, leaf: int, mask: int, centre: wp.vec3, nose: wp.vec3, contacts: Contacts, first: int, hull: Hull,
    wall: Bvh,
):  # fmt: skip
    """Return the nearest edge so far to what lies between the axis's ends, or a nearer one of those in a leaf's mask.

    It is apart from contacts from `first`, or rises above their planes.
    """
    found, left = nearest, int(mask)
    while left != 0:
        bit = highest_bit(left)
        left ^= 1 << bit
        side, lane = bit // LANES, bit % LANES
        a, b = corner_of(wall, leaf, lane, side), corner_of(wall, leaf, lane, (side + 1) % 3)
        if is_beyond(0.5 * (a + b) - centre, nose, found.distance + 0.5 * wp.length(b - a)):
            continue
        apart = wp.closest_point_edge_edge(centre - nose, centre + nose, a, b, 1.0e-9)
        if apart[2] < found.distance and apart[0] > 0.0 and apart[0] < 1.0:
            place, share = wp.lerp(a, b, apart[1]), 2.0 * apart[0] - 1.0
            if rises(place - centre, contacts, first, hull) or is_apart(share, nose, contacts, first, hull):
                found = on_face(wall, leaf, lane, centre + share * nose, place, centre)
                found.distance = apart[2]
    return found


@wp.func
def next_edge(centre: wp.vec3, nose: wp.vec3, contacts: Contacts, first: int, hull: Hull, wall: Bvh):
    """Return the nearest edge to what lies between the axis's ends that contacts from `first` do not keep it off."""
    found, reach, more = Near(), float(hull.radius + hull.margin), int(0)
    found.distance = reach
    low, high = centre - wp.abs(nose), centre + wp.abs(nose)
    while more >= 0:
        leaves = leaves_near(wall.nodes, wall.firsts, wall.num_levels, low, high, reach, more)
        more = leaves[FOUND]
        for n in range(FOUND):
            if leaves[n] < 0:
                break
            near = nearest_in_leaf(wall.leaves, leaves[n], centre + nose, centre - nose, reach)
            if near[4] > 0.0:
                found = nearer_edge(found, leaves[n], int(near[4]), centre, nose, contacts, first, hull, wall)
    return found


@wp.func
def with_edges(
    contacts: Contacts, near: Near, centre: wp.vec3, nose: wp.vec3, state: State, hull: Hull, grid: Grid, wall: Bvh
):
    """Return the contacts and those of what lies between the axis's ends, of which the nearest one is given."""
    if near.is_found == 0:
        return contacts
    first = contacts.count + 0
    found = with_contact(contacts, state, hull, grid, near)
    if found.count > first and found.gaps[first] < -OVERLAP:
        for _ in range(2):
            other = next_edge(centre, nose, found, first, hull, wall)
            if other.is_found == 0 or is_behind(state.position + wp.vec3d(other.arm + other.offset), other, grid):
                break
            found = with_contact(found, state, hull, grid, other)
    return found


@wp.func
def nearest_point(end: wp.vec3, leaf: int, lane: int, centre: wp.vec3, wall: Bvh):
    """Return what of a triangle, which is in a leaf or -1, is nearest to an end of the axis."""
    if leaf < 0:
        return Near()
    a, b, c = corner_of(wall, leaf, lane, 0), corner_of(wall, leaf, lane, 1), corner_of(wall, leaf, lane, 2)
    return on_face(wall, leaf, lane, end, closest_on_triangle(end, a, b, c), centre)


@wp.func
def find_contacts(state: State, hull: Hull, grid: Grid, wall: Bvh, middle: wp.vec3d):
    """Return the hull's points near the wall, nearest to the axis's two ends and to what lies between them."""
    centre, axis = wp.vec3(state.position - middle), wp.vec3(nose_of(state, hull))
    nose, tail, reach = centre + axis, centre - axis, float(hull.radius + hull.margin)
    before, behind, edge = reach * reach, reach * reach, Near()
    nose_leaf, tail_leaf, nose_lane, tail_lane, more = int(-1), int(-1), int(0), int(0), int(0)
    edge.distance = reach
    while more >= 0:
        leaves = leaves_near(
            wall.nodes, wall.firsts, wall.num_levels, wp.min(nose, tail), wp.max(nose, tail), reach, more
        )
        more = leaves[FOUND]
        for n in range(FOUND):
            leaf = leaves[n]
            if leaf < 0:
                break
            near = nearest_in_leaf(wall.leaves, leaf, nose, tail, reach)
            if near[0] < before:
                before = near[0]
                nose_leaf, nose_lane = leaf + 0, int(near[1])
            if near[2] < behind:
                behind = near[2]
                tail_leaf, tail_lane = leaf + 0, int(near[3])
            if near[4] > 0.0:
                edge = nearer_edge(edge, leaf, int(near[4]), centre, axis, Contacts(), 0, hull, wall)
    at_nose = nearest_point(nose, nose_leaf, nose_lane, centre, wall)
    found = with_end(Contacts(), nose, at_nose, centre, state, hull, grid, wall)
    if hull.half_axis > f64(0.0):
        at_tail = nearest_point(tail, tail_leaf, tail_lane, centre, wall)
        found = with_end(found, tail, at_tail, centre, state, hull, grid, wall)
        found = with_edges(found, edge, centre, axis, state, hull, grid, wall)
    return found
