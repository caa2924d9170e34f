"""A boat's hull against rocks, reefs and the bay's edge in Warp: what it touches, how far off it is, what that does.

From above a hull is a convex polygon grown by a radius: a prism has radius 0, a capsule is a segment with its radius.
Two such shapes that hardly overlap touch where a corner of one meets the other. A rock stands upright, so it pushes the
hull aside, unless its top is nearer to the hull's bottom than its side: then it carries it.

The rule of contacts is that in caves: no bounce, Coulomb friction, overlaps are pushed apart without a gain of speed,
so that a rock never gives a boat kinetic energy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sea.outlines import outlines_of
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.batch.motion import State, angular, linear, rotation_of, six, vec6
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS, find_device, launch_kernel
from aquanav_tools.sim.boat import Footprint
from aquanav_tools.types import Array

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64
FAR = wp.constant(wp.float64(1e300))
TINY = wp.constant(wp.float64(1e-9))
"""Distances below this have no direction, m."""
FRICTION = wp.constant(wp.float64(0.09))
"""Of a hull on rock: Bullet's between vehicle and wall, the square of 0.3."""
ROUNDING = wp.constant(wp.float64(1e-12))
"""Overlaps up to this are what rounding leaves of one that was pushed apart, m: solving them again would be chance."""
MAX_CONTACTS = wp.constant(4)
"""Contacts that are solved in one step, the deepest first: two rocks and a corner of the bay."""


@wp.struct
class Bay:
    """What boats meet in a bay: rocks as outlines with tops, the bay's edge, and the goal."""

    corners: wp.array(dtype=wp.vec2d)
    """(V,) of one outline after the other, each counter-clockwise, m."""
    first: wp.array(dtype=wp.int32)
    """(R + 1,) where each outline begins."""
    discs: wp.array(dtype=wp.vec3d)
    """(R,) middle and radius of a circle around each outline, m."""
    tops: wp.array(dtype=f64)
    """(R,) above still water, m."""
    num_seen: wp.int32
    """Rocks that beams see, the first ones."""
    edge: wp.vec4d
    """Least x and y, most x and y, m."""
    goal: wp.array(dtype=wp.vec2d)
    """(G,) a point, a line or a convex polygon, counter-clockwise, m."""
    goal_centre: wp.vec2d
    tolerance: f64
    """Distance from the goal at which it is reached, m."""


@wp.struct
class HullOutline:
    """A boat from above: `boat.Footprint` on the device."""

    corners: wp.array(dtype=wp.vec2d)
    """(C,) counter-clockwise, body frame, m."""
    radius: f64
    bottom: f64
    """Height of the bottom in the body frame, m."""


@wp.struct
class OutlineWork:
    """Room for where each boat's hull is."""

    corners: wp.array2d(dtype=wp.vec2d)
    """(N, C) of the bottom, world, m."""
    heights: wp.array2d(dtype=f64)
    """(N, C) m."""


@wp.struct
class Contact:
    """An overlap of a hull with a rock or the edge."""

    depth: f64
    """m; 0 where there is none."""
    normal: wp.vec3d
    """Out of the rock."""
    place: wp.vec3d
    """World, m."""


def make_bay(sea: SeaMap, deepest: float, device: Any) -> Bay:
    """Return a bay on a device, whose beams see what reaches up to `deepest` (m, negative) below still water."""
    bay = Bay()
    rocks = sorted(sea.rocks, key=lambda rock: rock.top <= deepest)  # those that beams see come first
    corners, first, discs, edge = outlines_of([rock.outline for rock in rocks], sea.edge)
    bay.corners = wp.array(corners, dtype=wp.vec2d, device=device)
    bay.first = wp.array(first.astype(np.int32), dtype=wp.int32, device=device)
    bay.discs = wp.array(discs, dtype=wp.vec3d, device=device)
    bay.tops = wp.array([rock.top for rock in rocks], dtype=wp.float64, device=device)
    bay.num_seen = sum(rock.top > deepest for rock in rocks)
    bay.edge = wp.vec4d(*edge)
    bay.goal = wp.array(sea.goal.corners, dtype=wp.vec2d, device=device)
    bay.goal_centre, bay.tolerance = wp.vec2d(*sea.goal.centre), sea.goal.tolerance
    return bay


def make_hull_outline(footprint: Footprint, device: Any) -> HullOutline:
    """Return a footprint on a device."""
    hull = HullOutline()
    hull.corners = wp.array(footprint.outline, dtype=wp.vec2d, device=device)
    hull.radius, hull.bottom = footprint.radius, footprint.bottom
    return hull


def make_outline_work(num: int, hull: HullOutline, device: Any) -> OutlineWork:
    """Return room for `num` boats."""
    work, shape = OutlineWork(), (num, hull.corners.shape[0])
    work.corners = wp.zeros(shape, dtype=wp.vec2d, device=device)
    work.heights = wp.zeros(shape, dtype=wp.float64, device=device)
    return work


@wp.func
def to_segment(point: wp.vec2d, a: wp.vec2d, b: wp.vec2d):
    """Return the vector from the nearest point of a segment to a point, m."""
    along, square = b - a, wp.length_sq(b - a)
    share = f64(0.0)
    if square > f64(0.0):
        share = wp.clamp(wp.dot(point - a, along) / square, f64(0.0), f64(1.0))
    return point - a - share * along


@wp.func
def to_outline(corners: wp.array(dtype=wp.vec2d), begin: int, end: int, point: wp.vec2d):
    """Return the distance from a point to the outline corners[begin:end], m; negative inside it."""
    nearest, is_inside = f64(FAR), bool(False)
    a = corners[end - 1]
    for n in range(begin, end):
        b = corners[n]
        nearest = wp.min(nearest, wp.length_sq(to_segment(point, a, b)))
        if (a[1] > point[1]) != (b[1] > point[1]):
            if point[0] < a[0] + (point[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]):
                is_inside = not is_inside
        a = b
    distance = wp.sqrt(nearest)
    if is_inside:
        distance = -distance
    return distance


@wp.func
def nearest_side(corners: wp.array(dtype=wp.vec2d), begin: int, end: int, point: wp.vec2d):
    """Return the distance from a point to an outline, negative inside, and the outward normal there."""
    distance = to_outline(corners, begin, end, point)
    best, normal = f64(FAR), wp.vec2d()
    a = corners[end - 1]
    for n in range(begin, end):
        b = corners[n]
        offset = to_segment(point, a, b)
        apart = wp.length(offset)
        if apart < best:
            best = apart
            along = wp.normalize(b - a)
            normal = wp.vec2d(along[1], -along[0])
            if apart > TINY:
                normal = offset / apart
                if distance <= f64(0.0):
                    normal = -normal
        a = b
    return distance, normal


@wp.func
def goal_distance(bay: Bay, point: wp.vec2d):
    """Return the distance from a place to the goal's point, line or area, m; 0 inside the area."""
    if bay.goal.shape[0] == 1:
        return wp.length(bay.goal[0] - point)
    return wp.max(to_outline(bay.goal, 0, bay.goal.shape[0], point), f64(0.0))


@wp.func
def place_hull(i: int, state: State, hull: HullOutline, work: OutlineWork):
    """Write where the corners of the hull's bottom are."""
    rotation = rotation_of(state.orientation)
    for k in range(hull.corners.shape[0]):
        corner = hull.corners[k]
        place = state.position + rotation * wp.vec3d(corner[0], corner[1], hull.bottom)
        work.corners[i, k] = wp.vec2d(place[0], place[1])
        work.heights[i, k] = place[2]


@wp.func
def circle_around(corners: wp.array(dtype=wp.vec2d)):
    """Return the middle of a hull's corners, and how far the farthest is from it, m."""
    middle, reach = wp.vec2d(), f64(0.0)
    for k in range(corners.shape[0]):
        middle += corners[k] / f64(corners.shape[0])
    for k in range(corners.shape[0]):
        reach = wp.max(reach, wp.length(corners[k] - middle))
    return middle, reach


@wp.func
def hull_clearance(hull: wp.array(dtype=wp.vec2d), radius: f64, bay: Bay):
    """Return the distance from a hull to the nearest rock or edge, seen from above, m; 0 or less where they overlap."""
    middle, reach = circle_around(hull)
    nearest, edge = f64(FAR), bay.edge
    for k in range(hull.shape[0]):
        corner = hull[k]
        nearest = wp.min(nearest, wp.min(corner[0] - edge[0], corner[1] - edge[1]))
        nearest = wp.min(nearest, wp.min(edge[2] - corner[0], edge[3] - corner[1]))
    for n in range(bay.discs.shape[0]):
        disc, begin, end = bay.discs[n], bay.first[n], bay.first[n + 1]
        if wp.length(wp.vec2d(disc[0], disc[1]) - middle) - disc[2] - reach < nearest:
            for k in range(hull.shape[0]):
                nearest = wp.min(nearest, to_outline(bay.corners, begin, end, hull[k]))
            for here in range(begin, end):
                nearest = wp.min(nearest, to_outline(hull, 0, hull.shape[0], bay.corners[here]))
    return nearest - radius


@wp.func
def with_rock(old: Contact, depth: f64, normal: wp.vec2d, top: f64, place: wp.vec2d, bottom: f64):
    """Return the deeper of an overlap and the one at a place; where the top is nearer than the side, it carries."""
    above = top - bottom
    found = old
    if depth > f64(0.0) and above > f64(0.0) and wp.min(depth, above) > old.depth:
        found.depth = wp.min(depth, above)
        found.normal = wp.vec3d(normal[0], normal[1], f64(0.0))
        found.place = wp.vec3d(place[0], place[1], wp.min(top, f64(0.0)))
        if above < depth:
            found.normal = wp.vec3d(f64(0.0), f64(0.0), f64(1.0))
            found.place = wp.vec3d(place[0], place[1], top)
    return found


@wp.func
def with_edge(old: Contact, corner: wp.vec2d, radius: f64, edge: wp.vec4d):
    """Return the deeper of an overlap and those of a corner with the bay's edge."""
    found = old
    for side in range(4):
        axis, sign = side % 2, f64(1.0)
        if side > 1:
            sign = f64(-1.0)
        depth = sign * (edge[side] - corner[axis]) + radius
        if depth > found.depth:
            found.depth = depth
            found.normal = wp.vec3d()
            found.normal[axis] = sign
            found.place = wp.vec3d(corner[0], corner[1], f64(0.0))
            found.place[axis] = corner[axis] - sign * radius
    return found


@wp.func
def bottom_at(hull: wp.array(dtype=wp.vec2d), heights: wp.array(dtype=f64), point: wp.vec2d):
    """Return the height of the hull's bottom, a plane, at a place; a segment's is that of its nearer end."""
    last = hull.shape[0] - 1
    a, p = hull[1] - hull[0], point - hull[0]
    if last < 2:
        if wp.dot(p, a) < f64(0.5) * wp.dot(a, a):
            return heights[0]
        return heights[1]
    b = hull[last] - hull[0]
    area = a[0] * b[1] - a[1] * b[0]
    one, other = (p[0] * b[1] - p[1] * b[0]) / area, (a[0] * p[1] - a[1] * p[0]) / area
    return heights[0] + one * (heights[1] - heights[0]) + other * (heights[last] - heights[0])


@wp.func
def deepest_contact(hull: wp.array(dtype=wp.vec2d), heights: wp.array(dtype=f64), radius: f64, bay: Bay):
    """Return the deepest overlap of a hull with rocks and edge."""
    middle, reach = circle_around(hull)
    contact = Contact()
    for k in range(hull.shape[0]):
        contact = with_edge(contact, hull[k], radius, bay.edge)
    for n in range(bay.discs.shape[0]):
        disc, begin, end, top = bay.discs[n], bay.first[n], bay.first[n + 1], bay.tops[n]
        if wp.length(wp.vec2d(disc[0], disc[1]) - middle) < disc[2] + reach + radius:
            for k in range(hull.shape[0]):
                away, normal = nearest_side(bay.corners, begin, end, hull[k])
                place = hull[k] - radius * normal
                contact = with_rock(contact, radius - away, normal, top, place, heights[k])
            for here in range(begin, end):
                corner = bay.corners[here]
                away, normal = nearest_side(hull, 0, hull.shape[0], corner)
                contact = with_rock(
                    contact, radius - away, -normal, top, corner, bottom_at(hull, heights, corner)
                )  # fmt: skip
    return contact


@wp.func
def struck(velocity: vec6, arm: wp.vec3d, impulse: wp.vec3d, mobility: vec6):
    """Return the velocity after an impulse at `arm` from the middle, all in the body frame."""
    return velocity + wp.cw_mul(mobility, six(impulse, wp.cross(arm, impulse)))


@wp.func
def give(arm: wp.vec3d, direction: wp.vec3d, mobility: vec6):
    """Return the change of a point's velocity along a direction per impulse along it, 1/kg."""
    wrench = six(direction, wp.cross(arm, direction))
    return wp.dot(wrench, wp.cw_mul(mobility, wrench))


@wp.func
def pushed_off(state: State, contact: Contact, mobility: vec6):
    """Return the state out of an overlap, its velocity into the rock taken away, and by friction that along it."""
    back = wp.transpose(rotation_of(state.orientation))
    normal, arm = back * contact.normal, back * (contact.place - state.position)
    result = State()
    result.position = state.position + contact.depth * contact.normal
    result.orientation = state.orientation
    result.velocity = state.velocity
    velocity = linear(state.velocity) + wp.cross(angular(state.velocity), arm)
    closing = -wp.dot(velocity, normal)
    if closing > f64(0.0):
        pressed = closing / give(arm, normal, mobility)
        sliding = velocity + closing * normal
        speed = wp.length(sliding)
        result.velocity = struck(result.velocity, arm, pressed * normal, mobility)
        if speed > f64(0.0):
            along = sliding / speed
            rub = wp.min(FRICTION * pressed, speed / give(arm, along, mobility))
            result.velocity = struck(result.velocity, arm, -rub * along, mobility)
    return result


@wp.kernel
def probe_clearances(
    bay: Bay, hulls: wp.array2d(dtype=wp.vec2d), radius: f64, clearances: wp.array(dtype=f64)
):  # fmt: skip
    """Write the clearance of each hull."""
    i = wp.tid()
    clearances[i] = hull_clearance(hulls[i], radius, bay)


def clearances_of(sea: SeaMap, hulls: Array, radius: float) -> Array:
    """Return the (N,) clearances of (N, C, 2) hulls grown by a radius in a bay, m."""
    device = find_device("cpu")
    found = wp.zeros(len(hulls), dtype=wp.float64, device=device)
    placed = wp.array(np.ascontiguousarray(hulls), dtype=wp.vec2d, ndim=2, device=device)
    inputs = [make_bay(sea, -np.inf, device), placed, radius, found]
    launch_kernel(probe_clearances, dim=len(hulls), inputs=inputs, device=device)
    return found.numpy()
