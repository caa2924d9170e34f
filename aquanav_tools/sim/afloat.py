"""A boat on waves: pressure and drag of the water, summed up over the part of its hull that is below the surface.

Every triangle is cut at the surface, taken for flat between its corners. Pressure is that of the water's depth below
the surface above it (Froude and Krylov's force for waves longer than the boat), which is linear over a triangle, so
that force and moment are exact. Drag is that of each panel's own velocity through the water, orbits of the waves
included, as the mean of the triangle's corners. The loads are those in the middle of the step, which conserves the
energy of a boat that bobs undamped.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.sim import hydrodynamics
from aquanav_tools.sim.hydrodynamics import rotation_rows
from aquanav_tools.sim.sea_water import add_turned_sea, echoes, turn_sea
from aquanav_tools.sim.vehicle_base import GRAVITY

_MASS, _DENSITY, _NORMAL, _FRICTION = range(4)


@numba.njit(cache=True)
def advance_afloat(state, command, current, waves, phases, vertices, faces, coefficients, parameters, dt):  # type: ignore[no-untyped-def]
    """Return the (13,) state one step later.

    Args:
        state: (13,) position of the centre of mass (z from still water), quaternion, velocity over ground.
        command: (6,) wrench of the drives, body frame, N and N m.
        current: (3,) velocity of the water without waves, world frame, m/s.
        waves: (N, 7) of `SeaWater.waves`.
        phases: (N,) in the middle of the step, rad.
        vertices: (V, 3) of the hulls, body frame, m.
        faces: (F, 3) of the hulls, normals outwards.
        coefficients: (4,) from `Boat.coefficients`.
        parameters: From `Boat.motion_parameters`.
        dt: Step, s.
    """
    middle = _drifted(state, 0.5 * dt)
    wrench = water_wrench(middle, current, waves, phases, vertices, faces, coefficients)
    up = rotation_rows(middle)[2]
    for axis in range(3):
        wrench[axis] -= coefficients[_MASS] * GRAVITY * up[axis]
    return hydrodynamics.advance(state, command + wrench, current, parameters, dt)


@numba.njit(cache=True)
def water_wrench(state, current, waves, phases, vertices, faces, coefficients):  # type: ignore[no-untyped-def]
    """Return the (6,) force and moment of pressure and drag about the centre of mass, body frame, N and N m."""
    rotation, velocity = rotation_rows(state), np.empty((2, 3))
    places, depths = np.empty((len(vertices), 3)), np.empty(len(vertices))
    for axis in range(3):
        row = rotation[axis]
        for n in range(len(vertices)):
            places[n, axis] = row[0] * vertices[n, 0] + row[1] * vertices[n, 1] + row[2] * vertices[n, 2]
        velocity[0, axis] = row[0] * state[7] + row[1] * state[8] + row[2] * state[9]
        velocity[1, axis] = row[0] * state[10] + row[1] * state[11] + row[2] * state[12]
    waters, is_dragged = np.empty((len(vertices), 3)), coefficients[_NORMAL] > 0.0 or coefficients[_FRICTION] > 0.0
    beds, cosines, sines = echoes(waves), np.empty(len(waves)), np.empty(len(waves))
    for n in range(len(vertices)):
        x, y, z = state[0] + places[n, 0], state[1] + places[n, 1], state[2] + places[n, 2]
        depths[n] = turn_sea(waves, phases, x, y, cosines, sines) - z
        waters[n] = current
        if is_dragged:
            add_turned_sea(waves, beds, cosines, sines, depths[n], waters[n])
    total, wet, wet_depths = np.zeros((2, 3)), np.empty((4, 3)), np.empty(4)
    for face in faces:
        count = _cut(places, depths, face, wet, wet_depths)
        for k in range(1, count - 1):
            middle, area, size = _press(wet[0], wet[k], wet[k + 1], wet_depths[0], wet_depths[k], wet_depths[k + 1],
                                        coefficients[_DENSITY], total)  # fmt: skip
            if is_dragged and size > 0.0:
                _drag(middle, area, size, velocity, waters, face, coefficients, total)
    wrench = np.zeros(6)
    for axis in range(3):
        for k in range(3):
            wrench[axis] += rotation[k][axis] * total[0, k]
            wrench[3 + axis] += rotation[k][axis] * total[1, k]
    return wrench


@numba.njit(cache=True)
def _cut(places, depths, face, wet, wet_depths):  # type: ignore[no-untyped-def]
    """Write the corners of the part of a triangle that is under water, and their depths; return how many they are."""
    count = 0
    for k in range(3):
        here, after = face[k], face[(k + 1) % 3]
        if depths[here] > 0.0:
            wet_depths[count] = depths[here]
            for axis in range(3):
                wet[count, axis] = places[here, axis]
            count += 1
        if (depths[here] > 0.0) != (depths[after] > 0.0):
            share = depths[here] / (depths[here] - depths[after])
            wet_depths[count] = 0.0
            for axis in range(3):
                wet[count, axis] = places[here, axis] + share * (places[after, axis] - places[here, axis])
            count += 1
    return count


@numba.njit(cache=True)
def _press(a, b, c, depth_a, depth_b, depth_c, density, total):  # type: ignore[no-untyped-def]
    """Add the pressure on a triangle under water, corners relative to the centre of mass, to (2, 3) loads.

    Return its middle, its area as a vector, and the area, m^2. In bare numbers: small arrays would take most of the
    time.
    """
    area = _half_cross(b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2])
    size, depth = np.sqrt(area[0] ** 2 + area[1] ** 2 + area[2] ** 2), depth_a + depth_b + depth_c
    middle = ((a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0)
    if size == 0.0 or depth == 0.0:
        return middle, area, 0.0
    # The pressure's middle: a corner weighs as much as its own depth and that of all corners together.
    u, v, w = (depth_a + depth) / (4.0 * depth), (depth_b + depth) / (4.0 * depth), (depth_c + depth) / (4.0 * depth)
    x, y, z = u * a[0] + v * b[0] + w * c[0], u * a[1] + v * b[1] + w * c[1], u * a[2] + v * b[2] + w * c[2]
    load = -density * GRAVITY * depth / 3.0
    _push(total, x, y, z, load * area[0], load * area[1], load * area[2])
    return middle, area, size


@numba.njit(cache=True)
def _drag(middle, area, size, velocity, waters, face, coefficients, total):  # type: ignore[no-untyped-def]
    """Add the drag on a piece of a face, in whose middle the water moves as the mean of the face's corners."""
    x, y, z = middle
    nx, ny, nz = area[0] / size, area[1] / size, area[2] / size
    p, q, r = face
    tx, ty, tz = _half_cross(velocity[1, 0], velocity[1, 1], velocity[1, 2], x, y, z)
    vx = velocity[0, 0] + 2.0 * tx - (waters[p, 0] + waters[q, 0] + waters[r, 0]) / 3.0
    vy = velocity[0, 1] + 2.0 * ty - (waters[p, 1] + waters[q, 1] + waters[r, 1]) / 3.0
    vz = velocity[0, 2] + 2.0 * tz - (waters[p, 2] + waters[q, 2] + waters[r, 2]) / 3.0
    into = vx * nx + vy * ny + vz * nz
    vx, vy, vz = vx - into * nx, vy - into * ny, vz - into * nz
    half = 0.5 * coefficients[_DENSITY] * size
    along = -half * coefficients[_FRICTION] * np.sqrt(vx * vx + vy * vy + vz * vz)
    across = -half * coefficients[_NORMAL] * into * into if into > 0.0 else 0.0
    _push(total, x, y, z, along * vx + across * nx, along * vy + across * ny, along * vz + across * nz)


@numba.njit(cache=True)
def _push(total, x, y, z, fx, fy, fz):  # type: ignore[no-untyped-def]
    mx, my, mz = _half_cross(x, y, z, fx, fy, fz)
    total[0, 0], total[0, 1], total[0, 2] = total[0, 0] + fx, total[0, 1] + fy, total[0, 2] + fz
    total[1, 0], total[1, 1], total[1, 2] = total[1, 0] + 2.0 * mx, total[1, 1] + 2.0 * my, total[1, 2] + 2.0 * mz


@numba.njit(cache=True)
def _half_cross(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    return 0.5 * (ay * bz - az * by), 0.5 * (az * bx - ax * bz), 0.5 * (ax * by - ay * bx)


@numba.njit(cache=True)
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
