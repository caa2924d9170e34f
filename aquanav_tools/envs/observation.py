"""What the agent sees: range rays, the way to the goal, and (in the full preset) the vehicle's own motion.

| slice    | values | meaning                                               | scaled by                        |
|----------|--------|-------------------------------------------------------|----------------------------------|
| rays     | 28     | distance to the wall along each ray                   | the ray's length, to [0, 1]      |
| goal     | 3      | distance, azimuth (left +), elevation (up +)          | d / (d + 10 m), pi, pi / 2       |
| velocity | 3      | velocity over ground, body frame                      | 2 m/s                            |
| rates    | 3      | rate of turn, body frame                              | pi rad/s                         |
| tilt     | 2      | sine of the angle by which nose and left side point up | 1                               |
| trim     | 1      | state of the ballast                                  | 1                                |
| command  | 3      | the last command: ballast, steer, thrust              | 1                                |

The preset "paper" has the first two rows: 31 values, as the paper has it. "full" has all 43: what a real vehicle reads
from its Doppler log, gyroscope and accelerometers, and what its own software knows. Neither has the guide's panels
or progress, which a vehicle in an unknown cave cannot know. The goal's angles refer to the horizontal heading, so that
a tilt does not change them.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import Command
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.sim.hydrodynamics import rotation_rows
from aquanav_tools.types import Array

DISTANCE_SCALE = 10.0
"""Distance to the goal that reads 0.5, m; chosen for caves of 10 to 200 m."""
SPEED_SCALE = 2.0
"""Twice the vehicle's speed, m/s."""
RATE_SCALE = float(np.pi)
"""About twice the vehicle's rate of turn, rad/s."""

_ROWS = {"rays": 28, "goal": 3, "velocity": 3, "rates": 3, "tilt": 2, "trim": 1, "command": 3}
PRESETS = {"paper": ("rays", "goal"), "full": tuple(_ROWS)}
"""Names of the slices in each preset; every preset is the beginning of "full"."""


def layout(preset: str) -> dict[str, slice]:
    """Return where each row of the table stands in the observation of a preset.

    Raises:
        InputError: there is no such preset.
    """
    check_choice("observation preset", preset, PRESETS)
    slices, first = {}, 0
    for name in PRESETS[preset]:
        slices[name] = slice(first, first + _ROWS[name])
        first += _ROWS[name]
    return slices


class ObservationModel:
    """Computes the observation of one preset."""

    def __init__(self, preset: str, ray_lengths: Array, goal: Array) -> None:
        size = max(part.stop for part in layout(preset).values())
        self.space = spaces.Box(-1.0, 1.0, (size,), np.float32)
        self._size = size
        self._buffer = np.zeros(sum(_ROWS.values()), dtype=np.float32)
        self._ray_lengths = ray_lengths
        self._goal = goal

    def observe(
        self, state: Array, rays: npt.NDArray[np.float32], trim: float, command: Command
    ) -> npt.NDArray[np.float32]:
        """Return the observation.

        Args:
            state: (13,) position, quaternion, velocity over ground in the body frame.
            rays: (28,) distances, m.
            trim: State of the ballast in [-1, 1].
            command: The last command.
        """
        _fill(self._buffer, state, rays, self._ray_lengths, self._goal, trim, *command)
        return self._buffer[: self._size].copy()


@numba.njit(cache=True)
def _fill(out, state, rays, ray_lengths, goal, trim, ballast, steer, thrust):  # type: ignore[no-untyped-def]
    """Write the full observation."""
    for n in range(28):
        out[n] = rays[n] / ray_lengths[n]
    rotation = rotation_rows(state)
    east, north, up = goal[0] - state[0], goal[1] - state[1], goal[2] - state[2]
    flat = np.sqrt(east * east + north * north)
    distance = np.sqrt(flat * flat + up * up)
    azimuth = np.arctan2(north, east) - np.arctan2(rotation[1][0], rotation[0][0])
    azimuth -= 2.0 * np.pi * np.round(azimuth / (2.0 * np.pi))
    out[28] = distance / (distance + DISTANCE_SCALE)
    out[29] = azimuth / np.pi
    out[30] = np.arctan2(up, flat) / (0.5 * np.pi)
    for axis in range(3):
        out[31 + axis] = state[7 + axis] / SPEED_SCALE
        out[34 + axis] = state[10 + axis] / RATE_SCALE
    out[37], out[38] = rotation[2][0], rotation[2][1]
    out[39] = trim
    out[40], out[41], out[42] = ballast, steer, thrust
    for n in range(28, 43):
        out[n] = min(max(out[n], -1.0), 1.0)
