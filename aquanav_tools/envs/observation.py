"""What the agent sees: three presets, which `sim.batch.observation` fills.

"full", and "paper", which is its first 31 values:

| slice    | values | meaning                                                | scaled by                      |
|----------|--------|--------------------------------------------------------|--------------------------------|
| rays     | 28     | distance to the wall along each ray                    | the ray's length, to [0, 1]    |
| goal     | 3      | distance, azimuth (left +), elevation (up +)           | soft at 10 m, pi, pi / 2       |
| velocity | 3      | velocity over ground, body frame                       | soft at 1 m/s                  |
| rates    | 3      | rate of turn, body frame                               | soft at pi / 2 rad/s           |
| depth    | 1      | how far below the entrance                             | soft at 10 m                   |
| tilt     | 2      | sine of the angle by which nose and left side point up | 1                              |
| trim     | 1      | state of the ballast                                   | 1                              |
| command  | 3      | the last command: ballast, steer, thrust               | 1                              |

Soft at s is x / (|x| + s): one half at s, never beyond 1, so that a boat at 12 m/s fits as well. "full" is what a real
vehicle reads from its Doppler log, gyroscope, pressure sensor and accelerometers, and what its own software knows. It
has neither the guide's panels nor progress, which a vehicle in an unknown cave cannot know. The goal's angles refer to
the horizontal heading, so that a tilt does not change them.

"original", as the ONNX policies of the original benchmark take it, in its units and its engine's axes (left-handed,
y up: its x, y, z are our y, z, -x):

| slice   | values | meaning                                                                                   |
|---------|--------|-------------------------------------------------------------------------------------------|
| sensors | 112    | per ray: met the wall, met the wall behind the start, met nothing (0 or 1), share of its length |
| angles  | 2      | to the goal, degrees: heading (right +), elevation (up +), both of one physics step ago  |
| motion  | 6      | unit velocity and unit rate of turn, world frame; zeros at rest                           |
"""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.sim.scales import NUM_RAYS, ORIGINAL_ROWS, PRESETS, ROWS, slices_of


def layout(preset: str) -> dict[str, slice]:
    """Return where each row of the tables stands in the observation of a preset.

    Raises:
        InputError: there is no such preset.
    """
    check_choice("observation preset", preset, PRESETS)
    return slices_of({name: (ROWS | ORIGINAL_ROWS)[name] for name in PRESETS[preset]})


def observation_space(preset: str) -> spaces.Box:
    """Return the space of the observation of a preset.

    Raises:
        InputError: there is no such preset.
    """
    size = max(part.stop for part in layout(preset).values())
    return original_space(NUM_RAYS) if preset == "original" else spaces.Box(-1.0, 1.0, (size,), np.float32)


def original_space(num_rays: int) -> spaces.Box:
    """Return the space of the observation "original" of a vehicle with so many rays."""
    high = np.concatenate([np.ones(4 * num_rays), [180.0, 90.0], np.ones(6)]).astype(np.float32)
    low = np.concatenate([np.zeros(4 * num_rays), -high[4 * num_rays :]]).astype(np.float32)
    return spaces.Box(low, high, dtype=np.float32)
