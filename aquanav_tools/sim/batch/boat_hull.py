"""Pressure and drag of the water on a boat's hulls in Warp, summed up over the part of them that is below it.

Every triangle is cut at the surface, taken for flat between its corners. Pressure is that of the water's depth below
the surface above it (Froude and Krylov's force for waves longer than the boat), which is linear over a triangle, so
that force and moment are exact. Drag is that of each panel's own velocity through the water, orbits of the waves
included, as the mean of the triangle's corners:

    force = -density / 2 area (cf |v_along| v_along + cn max(v_into, 0)^2 n)

with n the outward normal and the velocity split into its parts along the panel and into the water.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.boat_water import (
    Sea,
    add_turns,
    add_turns_and_rise,
    orbital_velocity,
    turn_by_shift,
    turn_waves,
)
from aquanav_tools.sim.batch.motion import angular, linear, six, vec6
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS
from aquanav_tools.sim.batch.waves import vec8
from aquanav_tools.sim.boat import Skin
from aquanav_tools.sim.vehicle_base import GRAVITY

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64
G = wp.constant(wp.float64(GRAVITY))
THIRD = wp.constant(wp.float64(1.0 / 3.0))


@wp.struct
class HullSurface:
    """The triangles of a boat's hulls, as `boat.Skin` has them, and what the water does to them."""

    vertices: wp.array(dtype=wp.vec3d)
    faces: wp.array(dtype=wp.vec3i)
    tick_axes: wp.array(dtype=wp.int32)
    tick_values: wp.array(dtype=f64)
    numbers: wp.array(dtype=wp.vec3i)
    drag: wp.vec3d
    """Density of the water, kg/m^3, and drag coefficients into the water and along it."""


@wp.struct
class HullWork:
    """Room for what is computed of each boat's hulls in a step."""

    tick_turns: wp.array4d(dtype=vec8)
    """(N, T, 2, B) cosines and sines of what each coordinate adds to the waves' angles."""
    column_turns: wp.array3d(dtype=vec8)
    """(N, 2, B) of a vertex's x and y."""
    turns: wp.array3d(dtype=vec8)
    """(N, 2, B) of a vertex."""
    sums: wp.array2d(dtype=vec8)
    """(N, 3) of the velocities of waves."""
    corners: wp.array2d(dtype=wp.vec4d)
    """(N, V) vertices relative to the centre of mass, world axes, m, and their depth below the surface, m."""
    waters: wp.array2d(dtype=wp.vec3d)
    """(N, V) velocity of the water there, m/s."""


def make_hull_surface(skin: Skin, density: float, normal_drag: float, friction: float, device: Any) -> HullSurface:
    """Return hulls on a device, in water of a density (kg/m^3)."""
    surface = HullSurface()
    surface.vertices = wp.array(skin.vertices, dtype=wp.vec3d, device=device)
    surface.faces = wp.array(skin.faces.astype(np.int32), dtype=wp.vec3i, device=device)
    surface.tick_axes = wp.array(skin.ticks[:, 0].astype(np.int32), dtype=wp.int32, device=device)
    surface.tick_values = wp.array(skin.ticks[:, 1], dtype=wp.float64, device=device)
    surface.numbers = wp.array(skin.numbers.astype(np.int32), dtype=wp.vec3i, device=device)
    surface.drag = wp.vec3d(density, normal_drag, friction)
    return surface


def make_hull_work(num: int, surface: HullSurface, blocks: int, device: Any) -> HullWork:
    """Return room for `num` boats with so many vectors of waves."""
    work, num_vertices = HullWork(), surface.vertices.shape[0]
    work.tick_turns = wp.zeros((num, surface.tick_values.shape[0], 2, blocks), dtype=vec8, device=device)
    work.column_turns = wp.zeros((num, 2, blocks), dtype=vec8, device=device)
    work.turns = wp.zeros((num, 2, blocks), dtype=vec8, device=device)
    work.sums = wp.zeros((num, 3), dtype=vec8, device=device)
    work.corners = wp.zeros((num, num_vertices), dtype=wp.vec4d, device=device)
    work.waters = wp.zeros((num, num_vertices), dtype=wp.vec3d, device=device)
    return work


@wp.func
def turn_ticks(
    i: int, position: wp.vec3d, rotation: wp.mat33d, sea: Sea, elapsed: f64, surface: HullSurface, work: HullWork
):
    """Write what each coordinate of the hulls adds to the waves' angles: there are far fewer of them than vertices."""
    for n in range(surface.tick_values.shape[0]):
        axis, value = surface.tick_axes[n], surface.tick_values[n]
        x, y = rotation[0, axis] * value, rotation[1, axis] * value
        if axis == 0:
            turn_waves(sea.table[i], sea.phases[i], elapsed, position[0] + x, position[1] + y, work.tick_turns[i, n])
        else:
            turn_by_shift(sea.table[i], x, y, work.tick_turns[i, n])


@wp.func
def wet_vertices(
    i: int, position: wp.vec3d, rotation: wp.mat33d, current: wp.vec3d, sea: Sea, elapsed: f64,
    surface: HullSurface, work: HullWork,
):  # fmt: skip
    """Write where the vertices are, how deep below the surface, and how the water moves there."""
    turn_ticks(i, position, rotation, sea, elapsed, surface, work)
    ticks, column, turns, table = work.tick_turns[i], work.column_turns[i], work.turns[i], sea.table[i]
    before = wp.vec3i(-1, -1, -1)
    for v in range(surface.vertices.shape[0]):
        number = surface.numbers[v]
        if number[0] != before[0] or number[1] != before[1]:
            add_turns(ticks[number[0]], ticks[number[1]], column)
        rise = add_turns_and_rise(table, column, ticks[number[2]], turns, work.sums[i])
        before = number
        place = rotation * surface.vertices[v]
        below = rise - position[2] - place[2]
        work.corners[i, v] = wp.vec4d(place[0], place[1], place[2], below)
        work.waters[i, v] = current + orbital_velocity(table, turns, below, work.sums[i])


@wp.func
def crossing(wet: wp.vec4d, dry: wp.vec4d):
    """Return where an edge from a corner under water to one above meets the surface."""
    point = wet + wet[3] / (wet[3] - dry[3]) * (dry - wet)
    point[3] = f64(0.0)
    return point


@wp.func
def panel_load(a: wp.vec4d, b: wp.vec4d, c: wp.vec4d, velocity: vec6, water: wp.vec3d, drag: wp.vec3d):
    """Return force and moment on a triangle under water, corners relative to the centre of mass, N and N m.

    All in world axes; `velocity` is the body's, `water` the water's mean at the corners of the whole triangle, `drag`
    that of `HullSurface`.
    """
    p, q, r = wp.vec3d(a[0], a[1], a[2]), wp.vec3d(b[0], b[1], b[2]), wp.vec3d(c[0], c[1], c[2])
    area = f64(0.5) * wp.cross(q - p, r - p)
    size, depth = wp.length(area), a[3] + b[3] + c[3]
    if size == f64(0.0) or depth == f64(0.0):
        return vec6()
    # The pressure's middle: a corner weighs as much as its own depth and that of all corners together.
    middle = f64(0.25) / depth * ((a[3] + depth) * p + (b[3] + depth) * q + (c[3] + depth) * r)
    push = -G * THIRD * drag[0] * depth * area
    load = six(push, wp.cross(middle, push))
    middle, normal = THIRD * (p + q + r), f64(1.0) / size * area
    moving = linear(velocity) + wp.cross(angular(velocity), middle) - water
    into = wp.dot(moving, normal)
    moving -= into * normal
    half = f64(0.5) * drag[0] * size
    resistance = -half * drag[2] * wp.length(moving) * moving
    if into > f64(0.0):
        resistance -= half * drag[1] * into * into * normal
    return load + six(resistance, wp.cross(middle, resistance))


@wp.func
def face_load(
    a: wp.vec4d, b: wp.vec4d, c: wp.vec4d, is_last_dry: bool, velocity: vec6, water: wp.vec3d, drag: wp.vec3d
):
    """Return force and moment on what is under water of a triangle of which it is corner `a` alone, or all but it."""
    if a[3] > f64(0.0):
        return panel_load(a, crossing(a, b), crossing(a, c), velocity, water, drag)
    first, last = crossing(b, a), crossing(c, a)
    if is_last_dry:
        load = panel_load(b, c, last, velocity, water, drag)
        return load + panel_load(b, last, first, velocity, water, drag)
    load = panel_load(first, b, c, velocity, water, drag)
    return load + panel_load(first, c, last, velocity, water, drag)


@wp.func
def water_wrench(
    i: int, position: wp.vec3d, rotation: wp.mat33d, velocity: vec6, current: wp.vec3d, sea: Sea, elapsed: f64,
    surface: HullSurface, work: HullWork,
):  # fmt: skip
    """Return force and moment of pressure and drag on boat `i` about its centre of mass, body frame, N and N m.

    Args:
        i: Row of the sea and of the work's arrays.
        position: Of the centre of mass, z from still water, m.
        rotation: World from body.
        velocity: Over ground and rate of turn, body frame, m/s and rad/s.
        current: Velocity of the water without its waves, m/s.
        sea: Waves.
        elapsed: Time since the waves' phases were what they are, s.
        surface: The hulls.
        work: Room to compute in.
    """
    wet_vertices(i, position, rotation, current, sea, elapsed, surface, work)
    moving, load, dry = six(rotation * linear(velocity), rotation * angular(velocity)), vec6(), f64(0.0)
    for f in range(surface.faces.shape[0]):
        face = surface.faces[f]
        a, b, c = work.corners[i, face[0]], work.corners[i, face[1]], work.corners[i, face[2]]
        count = int(a[3] > dry) + int(b[3] > dry) + int(c[3] > dry)
        is_single = count == 1
        if count > 0:
            water = THIRD * (work.waters[i, face[0]] + work.waters[i, face[1]] + work.waters[i, face[2]])
            if count == 3:
                load += panel_load(a, b, c, moving, water, surface.drag)
            elif (a[3] > dry) == is_single:
                load += face_load(a, b, c, False, moving, water, surface.drag)
            elif (b[3] > dry) == is_single:
                load += face_load(b, c, a, False, moving, water, surface.drag)
            else:
                load += face_load(c, a, b, True, moving, water, surface.drag)
    back = wp.transpose(rotation)
    return six(back * linear(load), back * angular(load))
