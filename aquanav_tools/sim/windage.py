"""What a boat shows to the wind: areas and coefficients. The force is that of `sim/batch/boat_motion.py`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
        """Return the (5,) coefficients of surge, sway and turning, the arm, and the fraction of the wind at 10 m."""
        half, fraction = 0.5 * AIR_DENSITY, (self.height / REFERENCE_HEIGHT) ** PROFILE
        ahead, across = half * self.front_drag * self.front, half * self.side_drag * self.side
        return np.array([ahead, across, 2.0 * half * self.turning * self.side * self.length, self.arm, fraction])
