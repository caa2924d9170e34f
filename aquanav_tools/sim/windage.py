"""The force of the wind on what stands above the water.

    X = -q cx A_front cos(b),   Y = -q cy A_side sin(b),   N = -q cn A_side L sin(2 b),   q = air density / 2 * V^2

V and b are speed and direction of the motion through the air, b from the bow to the left. Forces act at the height of
the areas' middle, so that they heel and trim, too. The mean wind there is less than at 10 m, by a power of the height.

Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2nd edition, 2021), chapter 10.1, wind forces
on craft that are symmetric to both sides and nearly so fore and aft.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.sim.hydrodynamics import compiled, rotation_rows
from aquanav_tools.sim.vehicle_base import check_finite, check_not_negative, check_positive
from aquanav_tools.types import Array

AIR_DENSITY = 1.225
"""kg/m^3, at 15 degrees."""
PROFILE = 1.0 / 7.0
"""Power of the height with which wind grows over open water."""
REFERENCE_HEIGHT = 10.0
"""Height for which winds are given, m."""


@dataclass(frozen=True)
class Windage:
    """What a boat shows to the wind."""

    front: float
    """Area seen from ahead, above the water, m^2."""
    side: float
    """Area seen from the side, m^2."""
    length: float
    """Of the boat, m."""
    height: float
    """Of the areas' middle above the water, m."""
    arm: float
    """Of the areas' middle above the centre of mass, m."""
    front_drag: float = 0.7
    """cx; 0.5 to 0.9 are usual."""
    side_drag: float = 0.9
    """cy; 0.7 to 0.95 are usual."""
    turning: float = 0.1
    """cn; 0.05 to 0.2 are usual. The boat is turned broadside to the wind."""

    def __post_init__(self) -> None:
        check_positive("height and length", self.height, self.length)
        check_not_negative("areas and drags", self.front, self.side, self.front_drag, self.side_drag)
        check_finite("arm and turning", self.arm, self.turning)

    def coefficients(self) -> Array:
        """Return the (5,) that `add_wind` takes: of surge, sway, turning, arm, and share of the wind at 10 m."""
        half, share = 0.5 * AIR_DENSITY, (self.height / REFERENCE_HEIGHT) ** PROFILE
        ahead, across = half * self.front_drag * self.front, half * self.side_drag * self.side
        return np.array([ahead, across, 2.0 * half * self.turning * self.side * self.length, self.arm, share])


NO_WINDAGE = np.zeros(5)
"""Coefficients of what no wind reaches."""


@compiled
def add_wind(state, wind, windage, wrench):  # type: ignore[no-untyped-def]
    """Add the wind's (6,) force and moment about the centre of mass, body frame, N and N m.

    Args:
        state: (13,).
        wind: (2,) velocity of the air at 10 m, world frame, m/s.
        windage: `Windage.coefficients`.
        wrench: (6,) is added to.
    """
    rotation = rotation_rows(state)
    ahead = state[7] - windage[4] * (rotation[0][0] * wind[0] + rotation[1][0] * wind[1])
    left = state[8] - windage[4] * (rotation[0][1] * wind[0] + rotation[1][1] * wind[1])
    speed = np.sqrt(ahead * ahead + left * left)
    surge, sway = -windage[0] * speed * ahead, -windage[1] * speed * left
    wrench[0] += surge
    wrench[1] += sway
    wrench[3] -= windage[3] * sway
    wrench[4] += windage[3] * surge
    wrench[5] -= windage[2] * ahead * left
