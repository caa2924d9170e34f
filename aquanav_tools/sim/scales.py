"""What stands where in an observation, and by what it is scaled: the tables are in `envs.observation`."""

from __future__ import annotations

import math
from itertools import accumulate
from typing import Any

DISTANCE_SCALE = 10.0
"""Distance that reads 0.5, m; chosen for caves of 10 to 200 m."""
SPEED_SCALE = 1.0
"""Speed that reads 0.5, m/s: about a small underwater vehicle's."""
RATE_SCALE = 0.5 * math.pi
"""Rate of turn that reads 0.5, rad/s."""
MIN_MOTION = 1e-5
"""The original's engine gives no direction to a vector below this length."""
NUM_RAYS = 28

ROWS = {"rays": NUM_RAYS, "goal": 3, "velocity": 3, "rates": 3, "depth": 1, "tilt": 2, "trim": 1, "command": 3}
ORIGINAL_ROWS = {"sensors": 4 * NUM_RAYS, "angles": 2, "motion": 6}
PRESETS = {"paper": ("rays", "goal"), "full": tuple(ROWS), "original": tuple(ORIGINAL_ROWS)}
"""Names of the slices in each preset; "paper" is the beginning of "full"."""


def slices_of(rows: dict[str, int]) -> dict[str, slice]:
    """Return where rows of so many values stand when they follow each other."""
    ends = accumulate(rows.values())
    return {name: slice(end - size, end) for (name, size), end in zip(rows.items(), ends, strict=True)}


def soft(value: Any, scale: float) -> Any:
    """Return value / (|value| + scale), in (-1, 1)."""
    return value / (abs(value) + scale)


def unsoft(scaled: Any, scale: float) -> Any:
    """Return the value that `soft` scales to `scaled`."""
    return scale * scaled / (1.0 - abs(scaled))
