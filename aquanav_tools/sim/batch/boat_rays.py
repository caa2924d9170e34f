"""A boat's proximity sensor in Warp: a fan of beams just below the water, which see rocks and shallow reefs alike.

A beam is a disc that moves straight ahead, as the original casts spheres, so that it meets a reef whose top is less
than its radius below still water. Beams are level, and turn with the boat's heading. Exact: the disc's middle stops
where it meets the outline grown by the disc's radius, which is made of segments moved outwards and of circles around
corners. A disc of radius 0 is a ray.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim import sensors
from aquanav_tools.sim.batch.boat_contact import FAR, Bay, make_bay, to_outline, to_segment
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS, find_device, launch_kernel
from aquanav_tools.sim.sensors import RayPattern
from aquanav_tools.types import Array

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64
NOTHING, WALL, UNTAGGED = (wp.constant(tag) for tag in (sensors.NOTHING, sensors.WALL, sensors.UNTAGGED))
"""What a beam met: nothing, rocks or the edge, the goal."""


@wp.struct
class Beams:
    """A pattern of level beams."""

    directions: wp.array(dtype=wp.vec2d)
    """(R,) body frame."""
    lengths: wp.array(dtype=f64)
    radii: wp.array(dtype=f64)
    sees_goal: wp.int32
    """Whether a goal with an area stops beams, untagged, as the original's box does."""


def make_beams(pattern: RayPattern, sees_goal: bool, device: Any) -> Beams:
    """Return a pattern on a device."""
    beams = Beams()
    beams.directions = wp.array(np.ascontiguousarray(pattern.directions[:, :2]), dtype=wp.vec2d, device=device)
    beams.lengths = wp.array(pattern.lengths, dtype=wp.float64, device=device)
    beams.radii = wp.array(pattern.radii, dtype=wp.float64, device=device)
    beams.sees_goal = int(sees_goal)
    return beams


@wp.func
def to_side(a: wp.vec2d, b: wp.vec2d, place: wp.vec2d, direction: wp.vec2d, radius: f64):
    """Return how far it is to the segment from a to b moved outwards (to its right) by the radius; FAR from behind."""
    length = wp.length(b - a)
    along = (b - a) / length
    normal = wp.vec2d(along[1], -along[0])
    closing, away = -wp.dot(direction, normal), wp.dot(place - a, normal) - radius
    if closing <= f64(0.0) or away < f64(0.0):
        return FAR
    reach = away / closing
    foot = wp.dot(place + reach * direction - a, along)
    if foot < f64(0.0) or foot > length:
        return FAR
    return reach


@wp.func
def to_circle(centre: wp.vec2d, direction: wp.vec2d, radius: f64):
    """Return how far it is from the origin to a circle; FAR when it is missed or behind."""
    along, across = wp.dot(centre, direction), centre[0] * direction[1] - centre[1] * direction[0]
    if along <= f64(0.0) or wp.abs(across) > radius:
        return FAR
    return wp.max(along - wp.sqrt(radius * radius - across * across), f64(0.0))


@wp.func
def cast_at_outline(
    corners: wp.array(dtype=wp.vec2d), begin: int, end: int, place: wp.vec2d, direction: wp.vec2d, radius: f64
):
    """Return how far a disc comes until it touches the outline corners[begin:end], m; FAR when it passes by."""
    if to_outline(corners, begin, end, place) <= radius:
        return f64(0.0)
    nearest = f64(FAR)
    a = corners[end - 1]
    for n in range(begin, end):
        b = corners[n]
        nearest = wp.min(nearest, to_side(a, b, place, direction, radius))
        if radius > f64(0.0):
            nearest = wp.min(nearest, to_circle(a - place, direction, radius))
        a = b
    return nearest


@wp.func
def to_edge(edge: wp.vec4d, place: wp.vec2d, direction: wp.vec2d, radius: f64):
    """Return how far it is from within the bay to its edge, m."""
    nearest = f64(FAR)
    for axis in range(2):
        if direction[axis] < f64(0.0):
            nearest = wp.min(nearest, wp.max(place[axis] - edge[axis] - radius, f64(0.0)) / -direction[axis])
        elif direction[axis] > f64(0.0):
            nearest = wp.min(nearest, wp.max(edge[axis + 2] - place[axis] - radius, f64(0.0)) / direction[axis])
    return nearest


@wp.func
def cast_disc(bay: Bay, place: wp.vec2d, direction: wp.vec2d, length: f64, radius: f64):
    """Return how far a disc comes until it touches a rock that beams see or the edge, at most `length`, m."""
    nearest = wp.min(length, to_edge(bay.edge, place, direction, radius))
    for n in range(bay.num_seen):
        disc = bay.discs[n]
        apart = to_segment(wp.vec2d(disc[0], disc[1]), place, place + nearest * direction)
        if wp.length(apart) <= disc[2] + radius:
            met = cast_at_outline(bay.corners, bay.first[n], bay.first[n + 1], place, direction, radius)
            nearest = wp.min(nearest, met)
    return nearest


@wp.func
def cast_beam(n: int, rotation: wp.mat33d, place: wp.vec2d, bay: Bay, beams: Beams):
    """Return how far the middle of a beam comes, m, and what it meets."""
    ahead = wp.normalize(wp.vec2d(rotation[0, 0], rotation[1, 0]))
    beam, length, radius = beams.directions[n], beams.lengths[n], beams.radii[n]
    direction = wp.vec2d(ahead[0] * beam[0] - ahead[1] * beam[1], ahead[1] * beam[0] + ahead[0] * beam[1])
    distance, tag = cast_disc(bay, place, direction, length, radius), int(NOTHING)
    if distance < length:
        tag = WALL
    if beams.sees_goal == 1 and bay.goal.shape[0] > 2:
        to_goal = cast_at_outline(bay.goal, 0, bay.goal.shape[0], place, direction, radius)
        if to_goal < distance:
            distance = to_goal
            tag = UNTAGGED
    return distance, tag


@wp.kernel
def probe_discs(
    bay: Bay, places: wp.array(dtype=wp.vec2d), directions: wp.array(dtype=wp.vec2d), length: f64, radius: f64,
    distances: wp.array(dtype=f64),
):  # fmt: skip
    """Cast each disc."""
    i = wp.tid()
    distances[i] = cast_disc(bay, places[i], directions[i], length, radius)


def cast_discs(sea: SeaMap, places: Array, directions: Array, length: float, radius: float) -> Array:
    """Return how far (N,) discs come among all rocks of a bay, m, from (N, 2) places into (N, 2) unit directions."""
    device = find_device("cpu")
    found = wp.zeros(len(places), dtype=wp.float64, device=device)
    at, along = (wp.array(np.ascontiguousarray(part), dtype=wp.vec2d, device=device) for part in (places, directions))
    inputs = [make_bay(sea, -np.inf, device), at, along, length, radius, found]
    launch_kernel(probe_discs, dim=len(places), inputs=inputs, device=device)
    return found.numpy()
