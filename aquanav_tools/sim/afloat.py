"""A boat on waves: pressure and drag of the water, summed up over the part of its hull that is below the surface.

Every triangle is cut at the surface, taken for flat between its corners. Pressure is that of the water's depth below
the surface above it (Froude and Krylov's force for waves longer than the boat), which is linear over a triangle, so
that force and moment are exact. Drag is that of each panel's own velocity through the water, orbits of the waves
included. The loads are those in the middle of the step, which conserves the energy of a boat that bobs undamped.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.sim import hydrodynamics
from aquanav_tools.sim.hydrodynamics import rotation_rows
from aquanav_tools.sim.sea_water import sea_rise
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.sim.waves import add_waves

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
    for n in range(len(vertices)):
        depths[n] = sea_rise(waves, phases, state[0] + places[n, 0], state[1] + places[n, 1]) - state[2] - places[n, 2]
    total, wet, wet_depths = np.zeros((2, 3)), np.empty((4, 3)), np.empty(4)
    for face in faces:
        count = _cut(places, depths, face, wet, wet_depths)
        for k in range(1, count - 1):
            _press(state, wet[0], wet[k], wet[k + 1], wet_depths[0], wet_depths[k], wet_depths[k + 1],
                   velocity, current, waves, phases, coefficients, total)  # fmt: skip
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
            wet[count], wet_depths[count] = places[here], depths[here]
            count += 1
        if (depths[here] > 0.0) != (depths[after] > 0.0):
            share = depths[here] / (depths[here] - depths[after])
            wet[count], wet_depths[count] = places[here] + share * (places[after] - places[here]), 0.0
            count += 1
    return count


@numba.njit(cache=True)
def _press(state, a, b, c, depth_a, depth_b, depth_c, velocity, current, waves, phases, coefficients, total):  # type: ignore[no-untyped-def]
    """Add pressure and drag on a triangle under water, corners relative to the centre of mass, to (2, 3) loads."""
    area = _half_cross(b - a, c - a)
    size, depth = np.sqrt(area[0] ** 2 + area[1] ** 2 + area[2] ** 2), depth_a + depth_b + depth_c
    if size == 0.0 or depth == 0.0:
        return
    # The pressure's middle: a corner weighs as much as its own depth and that of all corners together.
    middle = (a * (depth_a + depth) + b * (depth_b + depth) + c * (depth_c + depth)) / (4.0 * depth)
    _push(total, middle, -coefficients[_DENSITY] * GRAVITY * depth / 3.0 * area)
    if coefficients[_NORMAL] == 0.0 and coefficients[_FRICTION] == 0.0:
        return
    middle, normal = (a + b + c) / 3.0, area / size
    water = current.copy()
    for n in range(len(waves)):
        add_waves(waves[n], phases[n], state[0] + middle[0], state[1] + middle[1], -depth / 3.0, water)
    through = velocity[0] + 2.0 * _half_cross(velocity[1], middle) - water
    into = through[0] * normal[0] + through[1] * normal[1] + through[2] * normal[2]
    along = through - into * normal
    sliding = np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    load = -0.5 * coefficients[_DENSITY] * size * coefficients[_FRICTION] * sliding * along
    if into > 0.0:
        load -= 0.5 * coefficients[_DENSITY] * size * coefficients[_NORMAL] * into * into * normal
    _push(total, middle, load)


@numba.njit(cache=True)
def _push(total, place, force):  # type: ignore[no-untyped-def]
    total[0] += force
    total[1] += 2.0 * _half_cross(place, force)


@numba.njit(cache=True)
def _half_cross(a, b):  # type: ignore[no-untyped-def]
    """Return half of the cross product; NumPy's allocates several arrays."""
    half = np.empty(3)
    half[0] = 0.5 * (a[1] * b[2] - a[2] * b[1])
    half[1] = 0.5 * (a[2] * b[0] - a[0] * b[2])
    half[2] = 0.5 * (a[0] * b[1] - a[1] * b[0])
    return half


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
