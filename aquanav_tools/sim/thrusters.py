"""Thrusters: where they sit, how a wrench is shared among them, and whether they can do what the actions ask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.sim.body_parameters import ThrusterParameters
from aquanav_tools.sim.vehicle_base import Three, check_finite, check_not_negative, check_positive
from aquanav_tools.types import Array

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
MAX_THRUSTERS = 32
"""More are a mistake in the file; chosen."""
UNIT_TOLERANCE = 0.01
"""A direction may be this far from length 1: files are written by hand with three digits."""


@dataclass(frozen=True)
class Thrusters:
    """All thrusters of a vehicle, of one make."""

    positions: tuple[Three, ...]
    """Body frame, m."""
    directions: tuple[Three, ...]
    """Which way each pushes the vehicle when it runs forward: unit vectors, body frame."""
    max_forward: float
    """Most force forward, N."""
    max_reverse: float
    """Most force in reverse, N."""
    time_constant: float
    """The force follows its command as a first-order lag, s; 0 for at once."""

    def __post_init__(self) -> None:
        check_positive("max_forward", self.max_forward)
        check_positive("max_reverse", self.max_reverse)
        check_not_negative("time_constant", self.time_constant)
        if not 1 <= len(self.positions) <= MAX_THRUSTERS:
            raise ValueError(f"positions must be 1 to {MAX_THRUSTERS} points, got {len(self.positions)}.")
        if len(self.directions) != len(self.positions):
            raise ValueError(
                f"directions has {len(self.directions)} rows and positions {len(self.positions)}; "
                "each thruster needs one of both."
            )
        for n, (position, direction) in enumerate(zip(self.positions, self.directions, strict=True)):
            check_finite(f"positions[{n}]", *position)
            check_finite(f"directions[{n}]", *direction)
            length = float(np.linalg.norm(direction))
            if abs(length - 1.0) > UNIT_TOLERANCE:
                raise ValueError(f"directions[{n}] must have length 1, got {length:.3g}.")

    def wrenches(self) -> Array:
        """Return the (6, N) wrench per newton of each thruster, body frame."""
        directions = np.array([np.array(direction) / np.linalg.norm(direction) for direction in self.directions])
        return np.concatenate([directions, np.cross(self.positions, directions)], axis=1).T

    def allocation(self) -> Array:
        """Return the (N, 6) forces per unit of wrench: the least squares of forces that give it."""
        inverse: Array = np.array(np.linalg.pinv(self.wrenches(), rcond=1e-6))
        return inverse

    def parameters(self) -> ThrusterParameters:
        """Return what the equations of motion take of them."""
        num = len(self.positions)
        limits = np.full(num, self.max_reverse), np.full(num, self.max_forward)
        return ThrusterParameters(self.wrenches().T.copy(), self.allocation(), *limits, self.time_constant)


def check_reach(thrusters: Thrusters, demands: dict[str, Array], autopilot_axes: list[int]) -> None:
    """Refuse thrusters that cannot do what the vehicle's actions and its autopilot ask for.

    Args:
        thrusters: The vehicle's.
        demands: (6,) wrench of each action at full, by what messages call it, N and N m.
        autopilot_axes: Axes (3 roll, 4 pitch, 5 yaw) about which the autopilot must be able to turn it.

    Raises:
        ValueError: an axis is out of reach, or an action needs more force than the thrusters have.
    """
    wrenches, allocation = thrusters.wrenches(), thrusters.allocation()
    unit = {f"the autopilot's {AXES[axis]}": np.eye(6)[axis] for axis in autopilot_axes}
    for name, demand in {**demands, **unit}.items():
        axis = int(np.abs(demand).argmax())
        missing = wrenches @ (allocation @ demand) - demand
        if np.abs(missing).max() > 1e-3 * np.abs(demand).max():
            raise ValueError(
                f"thrusters cannot produce {name}: their directions and positions give no pure {AXES[axis]}. "
                "Turn or add one, or correct its position."
            )
    for name, demand in demands.items():
        forces = allocation @ demand
        shares = np.where(forces > 0, forces / thrusters.max_forward, -forces / thrusters.max_reverse)
        worst = int(shares.argmax())
        if shares[worst] > 1.0 + 1e-9:
            limit = thrusters.max_forward if forces[worst] > 0 else thrusters.max_reverse
            raise ValueError(
                f"thrusters cannot produce {name} of {np.abs(demand).max():.4g} (N or N m): number {worst} would have "
                f"to push with {abs(forces[worst]):.3g} N and has {limit:g} N. They reach {100 / shares[worst]:.0f} % "
                "of it: lower the force, rate or gain in actuators or autopilot, or correct max_forward and "
                "max_reverse."
            )
