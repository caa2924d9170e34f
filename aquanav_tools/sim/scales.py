"""By what the values of an observation are scaled: the tables are in `envs.observation`."""

from __future__ import annotations

import math

DISTANCE_SCALE = 10.0
"""Distance that reads 0.5, m; chosen for caves of 10 to 200 m."""
SPEED_SCALE = 1.0
"""Speed that reads 0.5, m/s: about a small underwater vehicle's."""
RATE_SCALE = 0.5 * math.pi
"""Rate of turn that reads 0.5, rad/s."""
MIN_MOTION = 1e-5
"""The original's engine gives no direction to a vector below this length."""
