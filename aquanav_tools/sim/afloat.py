"""A boat on waves: pressure and drag of the water, summed up over the part of its hull that is below it, and wind.

Every triangle is cut at the surface, taken for flat between its corners. Pressure is that of the water's depth below
the surface above it (Froude and Krylov's force for waves longer than the boat), which is linear over a triangle, so
that force and moment are exact. Drag is that of each panel's own velocity through the water, orbits of the waves
included, as the mean of the triangle's corners. The loads are those in the middle of the step, which conserves the
energy of a boat that bobs undamped.
"""

from __future__ import annotations

import numpy as np

from aquanav_tools.sim import hydrodynamics
from aquanav_tools.sim.hydrodynamics import compiled, inlined, rotation_rows
from aquanav_tools.sim.sea_motion import add_turned_sea, sea_table, turn_on, turn_sea, turned_rise
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.sim.windage import add_wind

THIRD = 1.0 / 3.0
_MASS, _DENSITY, _NORMAL, _FRICTION = range(4)


@compiled
def advance_afloat(state, command, flows, waves, phases, body, dt):  # type: ignore[no-untyped-def]
    """Return the (13,) state one step later.

    Args:
        state: (13,) position of the centre of mass (z from still water), quaternion, velocity over ground.
        command: (6,) wrench of the drives, body frame, N and N m.
        flows: (3,) velocity of the water without waves, and (2,) of the air at 10 m, world frame, m/s.
        waves: (N, 7) of `SeaWater.waves`.
        phases: (N,) in the middle of the step, rad.
        body: Of `Boat.body`.
        dt: Step, s.
    """
    current, wind = flows
    skin, coefficients, windage, parameters = body
    middle = _drifted(state, 0.5 * dt)
    wrench = water_wrench(middle, current, waves, phases, skin, coefficients)
    up = rotation_rows(middle)[2]
    for axis in range(3):
        wrench[axis] -= coefficients[_MASS] * GRAVITY * up[axis]
    add_wind(middle, wind, windage, wrench)
    return hydrodynamics.advance(state, command + wrench, current, parameters, dt)


@compiled
def water_wrench(state, current, waves, phases, skin, coefficients):  # type: ignore[no-untyped-def]
    """Return the (6,) force and moment of pressure and drag about the centre of mass, body frame, N and N m."""
    rotation, vertices, faces = rotation_rows(state), skin.vertices, skin.faces
    velocity = (*_turned(rotation, state[7], state[8], state[9]), *_turned(rotation, state[10], state[11], state[12]))
    places, depths = np.empty((len(vertices), 3)), np.empty(len(vertices))
    for n in range(len(vertices)):
        x, y, z = _turned(rotation, vertices[n, 0], vertices[n, 1], vertices[n, 2])
        places[n, 0], places[n, 1], places[n, 2] = x, y, z
    waters, is_dragged = np.empty((len(vertices), 3)), coefficients[_NORMAL] > 0.0 or coefficients[_FRICTION] > 0.0
    table, angles = np.empty((8, len(waves))), np.empty((2, len(vertices), len(waves)))
    sea_table(waves, table)
    _turn_hull(state, rotation, table, phases, skin.ticks, skin.numbers, angles)
    for n in range(len(vertices)):
        depths[n] = turned_rise(table, angles, n) - state[2] - places[n, 2]
    if is_dragged:
        _drag_water(table, angles, depths, faces, current, waters)
    total, wet = np.zeros((2, 3)), np.empty((4, 4))
    for f in range(len(faces)):
        p, q, r = faces[f, 0], faces[f, 1], faces[f, 2]
        if depths[p] <= 0.0 and depths[q] <= 0.0 and depths[r] <= 0.0:
            continue
        count = _cut(places, depths, faces, f, wet)
        for k in range(1, count - 1):
            middle, area, size = _press(wet, k, coefficients[_DENSITY], total)
            if is_dragged and size > 0.0:
                _drag(middle, area, size, velocity, waters, faces, f, coefficients, total)
    wrench = np.zeros(6)
    for axis in range(3):
        for k in range(3):
            wrench[axis] += rotation[k][axis] * total[0, k]
            wrench[3 + axis] += rotation[k][axis] * total[1, k]
    return wrench


@inlined
def _turned(rotation, x, y, z):  # type: ignore[no-untyped-def]
    east, north, up = rotation
    return (
        east[0] * x + east[1] * y + east[2] * z,
        north[0] * x + north[1] * y + north[2] * z,
        up[0] * x + up[1] * y + up[2] * z,
    )


@compiled
def _turn_hull(state, rotation, table, phases, ticks, numbers, angles):  # type: ignore[no-untyped-def]
    """Write the (2, V, N) cosines and sines of the waves' angles at the vertices.

    An angle is a sum over the axes, and there are far fewer different coordinates than vertices.
    """
    parts, flat, still = np.empty((2, len(ticks), len(phases))), np.empty((2, 1, len(phases))), np.zeros(len(phases))
    for n in range(len(ticks)):
        axis, value = int(ticks[n, 0]), ticks[n, 1]
        x, y = rotation[0][axis] * value, rotation[1][axis] * value
        if axis == 0:
            turn_sea(table, phases, state[0] + x, state[1] + y, parts, n)
        else:
            turn_sea(table, still, x, y, parts, n)
    for n in range(len(numbers)):
        i, j, k = numbers[n, 0], numbers[n, 1], numbers[n, 2]
        if n == 0 or i != numbers[n - 1, 0] or j != numbers[n - 1, 1]:
            turn_on(parts, i, parts, j, flat, 0)
        turn_on(flat, 0, parts, k, angles, n)


@compiled
def _drag_water(table, angles, depths, faces, current, waters):  # type: ignore[no-untyped-def]
    """Write the velocity of the water at the corners of all faces that are under water or partly so."""
    is_needed = np.zeros(len(depths), dtype=np.bool_)
    for f in range(len(faces)):
        p, q, r = faces[f, 0], faces[f, 1], faces[f, 2]
        if depths[p] > 0.0 or depths[q] > 0.0 or depths[r] > 0.0:
            is_needed[p] = is_needed[q] = is_needed[r] = True
    for n in range(len(depths)):
        if is_needed[n]:
            waters[n, 0], waters[n, 1], waters[n, 2] = current[0], current[1], current[2]
            add_turned_sea(table, angles, n, depths[n], waters)


@inlined
def _cut(places, depths, faces, f, wet):  # type: ignore[no-untyped-def]
    """Write the corners of the part of a triangle that is under water, with their depths; return how many they are."""
    count = 0
    for k in range(3):
        here, after = faces[f, k], faces[f, k + 1 if k < 2 else 0]
        depth, next_depth = depths[here], depths[after]
        if depth > 0.0:
            wet[count, 0], wet[count, 1], wet[count, 2] = places[here, 0], places[here, 1], places[here, 2]
            wet[count, 3] = depth
            count += 1
        if (depth > 0.0) != (next_depth > 0.0):
            share = depth / (depth - next_depth)
            for axis in range(3):
                wet[count, axis] = places[here, axis] + share * (places[after, axis] - places[here, axis])
            wet[count, 3] = 0.0
            count += 1
    return count


@inlined
def _press(wet, k, density, total):  # type: ignore[no-untyped-def]
    """Add the pressure on a triangle under water, corners relative to the centre of mass, to (2, 3) loads.

    It is that of the corners 0, k and k + 1. Return its middle, its area as a vector, and the area, m^2. In bare
    numbers: small arrays would take most of the time.
    """
    ax, ay, az, depth_a = wet[0, 0], wet[0, 1], wet[0, 2], wet[0, 3]
    bx, by, bz, depth_b = wet[k, 0], wet[k, 1], wet[k, 2], wet[k, 3]
    cx, cy, cz, depth_c = wet[k + 1, 0], wet[k + 1, 1], wet[k + 1, 2], wet[k + 1, 3]
    area = _half_cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
    size, depth = np.sqrt(area[0] ** 2 + area[1] ** 2 + area[2] ** 2), depth_a + depth_b + depth_c
    middle = ((ax + bx + cx) * THIRD, (ay + by + cy) * THIRD, (az + bz + cz) * THIRD)
    if size == 0.0 or depth == 0.0:
        return middle, area, 0.0
    # The pressure's middle: a corner weighs as much as its own depth and that of all corners together.
    share = 0.25 / depth
    u, v, w = (depth_a + depth) * share, (depth_b + depth) * share, (depth_c + depth) * share
    x, y, z = u * ax + v * bx + w * cx, u * ay + v * by + w * cy, u * az + v * bz + w * cz
    load = -density * GRAVITY * depth * THIRD
    _push(total, x, y, z, load * area[0], load * area[1], load * area[2])
    return middle, area, size


@inlined
def _drag(middle, area, size, velocity, waters, faces, f, coefficients, total):  # type: ignore[no-untyped-def]
    """Add the drag on a piece of a face, in whose middle the water moves as the mean of the face's corners."""
    x, y, z = middle
    share = 1.0 / size
    nx, ny, nz = area[0] * share, area[1] * share, area[2] * share
    p, q, r = faces[f, 0], faces[f, 1], faces[f, 2]
    tx, ty, tz = _half_cross(velocity[3], velocity[4], velocity[5], x, y, z)
    vx = velocity[0] + 2.0 * tx - (waters[p, 0] + waters[q, 0] + waters[r, 0]) * THIRD
    vy = velocity[1] + 2.0 * ty - (waters[p, 1] + waters[q, 1] + waters[r, 1]) * THIRD
    vz = velocity[2] + 2.0 * tz - (waters[p, 2] + waters[q, 2] + waters[r, 2]) * THIRD
    into = vx * nx + vy * ny + vz * nz
    vx, vy, vz = vx - into * nx, vy - into * ny, vz - into * nz
    half = 0.5 * coefficients[_DENSITY] * size
    along = -half * coefficients[_FRICTION] * np.sqrt(vx * vx + vy * vy + vz * vz)
    across = -half * coefficients[_NORMAL] * into * into if into > 0.0 else 0.0
    _push(total, x, y, z, along * vx + across * nx, along * vy + across * ny, along * vz + across * nz)


@inlined
def _push(total, x, y, z, fx, fy, fz):  # type: ignore[no-untyped-def]
    mx, my, mz = _half_cross(x, y, z, fx, fy, fz)
    total[0, 0], total[0, 1], total[0, 2] = total[0, 0] + fx, total[0, 1] + fy, total[0, 2] + fz
    total[1, 0], total[1, 1], total[1, 2] = total[1, 0] + 2.0 * mx, total[1, 1] + 2.0 * my, total[1, 2] + 2.0 * mz


@inlined
def _half_cross(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    return 0.5 * (ay * bz - az * by), 0.5 * (az * bx - ax * bz), 0.5 * (ax * by - ay * bx)


@compiled
def _drifted(state, dt):  # type: ignore[no-untyped-def]
    """Return the state after its velocity was held for dt."""
    drifted, rotation = state.copy(), rotation_rows(state)
    for axis in range(3):
        row = rotation[axis]
        drifted[axis] += dt * (row[0] * state[7] + row[1] * state[8] + row[2] * state[9])
    a, b, c, d = state[3], state[4], state[5], state[6]
    x, y, z = 0.5 * dt * state[10], 0.5 * dt * state[11], 0.5 * dt * state[12]
    drifted[3], drifted[4] = a - b * x - c * y - d * z, b + a * x + c * z - d * y
    drifted[5], drifted[6] = c + a * y - b * z + d * x, d + a * z + b * y - c * x
    return drifted
