"""Start poses along the route where a vehicle floats free."""

from __future__ import annotations

from dataclasses import dataclass

from aquanav_tools.types import Pose


@dataclass(frozen=True, eq=False)
class Start:
    """A place to begin an episode."""

    pose: Pose
    """World from body; the vehicle's capsule touches nothing."""
    clearance: float
    """m to the nearest wall."""
    geodesic_to_goal: float
    """Length of the shortest way through the water to the goal, m."""
    difficulty: float
    """In [0, 1]: share of the guide still to go."""
