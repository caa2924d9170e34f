"""What a boat's agent sees: three presets, as in `envs.observation` and with its scales.

What they are made of is computed in `sim/batch/boat_observation.py`.

"full", and "paper", which is its first 9 values:

| slice    | values | meaning                                                 | scaled by                   |
|----------|--------|---------------------------------------------------------|-----------------------------|
| rays     | 7      | distance to rock, reef or edge along each beam          | the beam's length, to [0, 1] |
| goal     | 2      | distance (GPS), azimuth (compass, left +)               | soft at 50 m, pi            |
| velocity | 2      | surge and sway over ground                              | soft at 3 m/s               |
| turn     | 1      | rate of turn about the boat's own upward axis           | soft at pi / 2 rad/s        |
| tilt     | 2      | sine of the angle by which bow and left side point up   | 1                           |
| command  | 2      | the last command: steer, thrust                         | 1                           |

"original", as the ONNX policies of the original's boat take it: 28 values of the sensor, the two angles to the goal and
the six of motion, as for the vehicle under water. The goal is taken to be as high as the boat.
"""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.observation import original_space
from aquanav_tools.sim.scales import slices_of

DISTANCE_SCALE = 50.0
"""Distance that reads 0.5, m; chosen for bays of 100 to 200 m."""
SPEED_SCALE = 3.0
"""Speed that reads 0.5, m/s: the Otter's."""
NUM_RAYS = 7

_ROWS = {"rays": NUM_RAYS, "goal": 2, "velocity": 2, "turn": 1, "tilt": 2, "command": 2}
_ORIGINAL_ROWS = {"sensors": 4 * NUM_RAYS, "angles": 2, "motion": 6}
PRESETS = {"paper": ("rays", "goal"), "full": tuple(_ROWS), "original": tuple(_ORIGINAL_ROWS)}
"""Names of the slices in each preset; "paper" is the beginning of "full"."""


def surface_layout(preset: str) -> dict[str, slice]:
    """Return where each row of the tables stands in the observation of a preset.

    Raises:
        InputError: there is no such preset.
    """
    check_choice("observation preset", preset, PRESETS)
    return slices_of({name: (_ROWS | _ORIGINAL_ROWS)[name] for name in PRESETS[preset]})


def surface_size(preset: str) -> int:
    """Return how many values a preset has."""
    return max(part.stop for part in surface_layout(preset).values())


def surface_space(preset: str) -> spaces.Box:
    """Return the space of a preset's observations."""
    if preset == "original":
        return original_space(NUM_RAYS)
    return spaces.Box(-1.0, 1.0, (surface_size(preset),), np.float32)
