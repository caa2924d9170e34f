"""What a vehicle's full actions lead to in open, still water."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array, Pose, rotation_matrix, yaw_quaternion

DT, SUBSTEPS = 0.02, 5
"""The benchmark's physics step, s, and how many a decision holds."""


@dataclass(frozen=True)
class Trial:
    """Speeds that a vehicle settles at, or reaches."""

    ahead: float
    """m/s, after 60 s."""
    reverse: float
    """m/s, after 60 s."""
    turn: float
    """Rate of turn with full thrust and steer, rad/s, after 60 s."""
    rise: float
    """Most speed up in 10 s of ballast up, m/s."""
    sink: float
    """Most speed down in 10 s of ballast down, m/s."""


def try_out(vehicle: Vehicle, density: float = 1000.0) -> Trial:
    """Swim a vehicle from rest with each of its actions at full, in water of `density` (kg/m^3)."""
    reverse = _swim(vehicle, density, (0.0, 0.0, -1.0), 60.0)
    turn = _swim(vehicle, density, (0.0, 1.0, 1.0), 60.0)
    rising = np.diff(_swim(vehicle, density, (1.0, 0.0, 0.0), 10.0)[:, 2]) / DT
    sinking = np.diff(_swim(vehicle, density, (-1.0, 0.0, 0.0), 10.0)[:, 2]) / DT
    return Trial(
        ahead=top_speed(vehicle, density),
        reverse=-float((rotation_matrix(reverse[-1, 3:7]) @ reverse[-1, 7:10])[0]),
        turn=float(turn[-1, 12]),
        rise=float(rising.max()),
        sink=abs(float(sinking.min())),
    )


@functools.lru_cache(maxsize=64)
def top_speed(vehicle: Vehicle, density: float = 1000.0) -> float:
    """Return the speed that a vehicle reaches ahead in 60 s of full thrust, m/s, in still water of `density`."""
    end = _swim(vehicle, density, (0.0, 0.0, 1.0), 60.0)[-1]
    return float((rotation_matrix(end[3:7]) @ end[7:10])[0])


def _swim(vehicle: Vehicle, density: float, command: tuple[float, float, float], duration: float) -> Array:
    """Return the (N + 1, S) states of holding ballast, steer and thrust from rest at the origin, heading along x."""
    from aquanav_tools.sim.batch.prediction import Predictor

    start = vehicle.state_at(Pose(np.zeros(3), yaw_quaternion(0.0)))
    commands = np.broadcast_to(np.array(command), (1, round(duration / DT), 3))
    return Predictor(vehicle, density, DT, 1).predict(start[None], np.zeros(1), commands, np.zeros(3)).states[0]
