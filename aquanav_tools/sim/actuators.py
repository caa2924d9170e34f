"""From a command to the wrench on the vehicle: ballast, steer and thrust."""

from __future__ import annotations

import numpy as np

from aquanav_tools.sim.vehicle import Vehicle
from aquanav_tools.types import Array

SURGE, HEAVE, YAW = 0, 2, 5


class ActuatorModel:
    """The vehicle's actuators with their one state, the trim.

    Ballast moves the trim at a rate and leaves it where it is when nothing is commanded; steer asks the autopilot for
    a rate of turn; thrust pushes ahead, or in reverse with a share of the force.
    """

    def __init__(self, vehicle: Vehicle, dt: float, substeps: int) -> None:
        self.trim = 0.0
        """In [-1, 1]: 0 floats, 1 is full buoyancy up."""
        self._actuators = vehicle.actuators
        self._yaw_moment = vehicle.actuators.yaw_rate * vehicle.autopilot.rate_gain[2]
        self._trim_step = vehicle.actuators.trim_rate * dt
        self._wrenches = np.zeros((substeps, 6))

    def reset(self) -> None:
        """Trim to neutral."""
        self.trim = 0.0

    def apply(self, ballast: float, steer: float, thrust: float) -> Array:
        """Hold a command for all substeps of a decision.

        Args:
            ballast: -1 (let the trim sink) to 1 (let it rise).
            steer: -1 (right) to 1 (left).
            thrust: -1 (reverse) to 1 (ahead).

        Returns:
            (substeps, 6) wrench in the body frame, N and N m; valid until the next call.
        """
        actuators, wrenches = self._actuators, self._wrenches
        wrenches[:, SURGE] = actuators.surge_force * (thrust if thrust > 0.0 else thrust * actuators.reverse_share)
        wrenches[:, YAW] = steer * self._yaw_moment
        heave, change = [], ballast * self._trim_step
        for _ in wrenches:
            self.trim = min(max(self.trim + change, -1.0), 1.0)
            heave.append(actuators.heave_force * self.trim)
        wrenches[:, HEAVE] = heave
        return wrenches
