"""One step of any vehicle: which equations move it, the first parameter says."""

from __future__ import annotations

import numba

from aquanav_tools.sim import hydrodynamics, original_motion
from aquanav_tools.sim.body_parameters import ORIGINAL


@numba.njit(cache=True)
def advance(state, command, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Return the state one step later.

    Args:
        state: (13,) position, quaternion, velocity over ground in the body frame, and what the vehicle's model adds.
        command: (6,) what the actuators ask for in this step: for most vehicles a wrench in the body frame, N and N m.
        current: (3,) velocity of the water, world frame, constant in space and time, m/s.
        parameters: `packed` ones of the vehicle's `motion_parameters`.
        dt: Step, s.
    """
    if parameters[0] == ORIGINAL:
        return original_motion.advance(state, command, current, parameters, dt)
    return hydrodynamics.advance(state, command, current, parameters, dt)
