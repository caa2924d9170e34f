"""What a wall does to the vehicle's motion, taken over from a contact solver that knows nothing of water."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.sim.rotation import rotation_rows


@numba.njit(cache=True)
def take_over_contact(free, intended, solved, mass, state):  # type: ignore[no-untyped-def]
    """Write the (13,) state after a step in which the wall was touched.

    The pose is the solver's. The velocity is ours plus the change that the solver made to the velocity it was given.
    A solver pushes overlapping shapes apart by adding velocity, but a wall at rest cannot give a vehicle energy: the
    kinetic energy is never more than without the wall.

    Args:
        free: (13,) state at the end of the step had there been no wall.
        intended: (6,) world-frame linear and angular velocity that the solver was given, m/s and rad/s.
        solved: (13,) the solver's position, quaternion (x, y, z, w), linear and angular velocity, world frame.
        mass: (6,) rigid-body plus added mass, kg and kg m^2.
        state: (13,) receives the result.
    """
    state[:] = free
    state[0:3] = solved[0:3]
    state[3], state[4], state[5], state[6] = solved[6], solved[3], solved[4], solved[5]
    rotation = rotation_rows(state)
    before, after = 0.0, 0.0
    for axis in range(3):
        for k in range(3):
            state[7 + axis] += rotation[k][axis] * (solved[7 + k] - intended[k])
            state[10 + axis] += rotation[k][axis] * (solved[10 + k] - intended[3 + k])
    for i in range(6):
        before += mass[i] * free[7 + i] ** 2
        after += mass[i] * state[7 + i] ** 2
    if after > before:
        state[7:13] *= np.sqrt(before / after)
