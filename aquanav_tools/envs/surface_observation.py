"""What a boat's agent sees: three presets, as in `envs.observation` and with its scales.

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

from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.observation import (
    Reading,
    azimuth_to,
    fill_original,
    original_space,
    slices_of,
    soft_compiled,
)
from aquanav_tools.sim.hydrodynamics import rotation_rows
from aquanav_tools.sim.scales import RATE_SCALE
from aquanav_tools.types import Array

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


class SurfaceObservation:
    """Computes the observation of one preset."""

    def __init__(self, preset: str, ray_lengths: Array) -> None:
        """Prepare the preset for beams of (7,) lengths, m."""
        size = max(part.stop for part in surface_layout(preset).values())
        self.is_original = preset == "original"
        self.space: spaces.Space[Any] = (
            original_space(NUM_RAYS) if self.is_original else spaces.Box(-1.0, 1.0, (size,), np.float32)
        )
        self._size = size
        self._buffer = np.zeros(max(size, sum(_ROWS.values())), dtype=np.float32)
        self._ray_lengths = ray_lengths

    def observe(self, reading: Reading, goal: Array) -> npt.NDArray[np.float32]:
        """Return the observation of a boat whose goal is at a (2,) place, m."""
        state, before, rays, tags, _, (_, steer, thrust) = reading
        if self.is_original:
            there = np.array([goal[0], goal[1], before[2]])
            fill_original(self._buffer, state, before, rays, tags, self._ray_lengths, there)
        else:
            fill_surface(self._buffer, state, rays, self._ray_lengths, goal, steer, thrust)
        return self._buffer[: self._size].copy()


@numba.njit(cache=True)
def fill_surface(out, state, rays, ray_lengths, goal, steer, thrust):  # type: ignore[no-untyped-def]
    """Write one boat's observation "full" into (16,) `out`; the first 9 are "paper"."""
    for n in range(7):
        out[n] = rays[n] / ray_lengths[n]
    rotation = rotation_rows(state)
    east, north = goal[0] - state[0], goal[1] - state[1]
    out[7] = soft_compiled(np.hypot(east, north), DISTANCE_SCALE)
    out[8] = azimuth_to(east, north, rotation) / np.pi
    out[9], out[10] = soft_compiled(state[7], SPEED_SCALE), soft_compiled(state[8], SPEED_SCALE)
    out[11] = soft_compiled(state[12], RATE_SCALE)
    out[12], out[13] = rotation[2][0], rotation[2][1]
    out[14], out[15] = steer, thrust
    for n in range(7, 16):
        out[n] = min(max(out[n], -1.0), 1.0)
