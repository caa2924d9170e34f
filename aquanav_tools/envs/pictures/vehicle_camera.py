"""What a camera on the vehicle, or one that follows it, sees of the cave by lamp light."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.cavity import WALL
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.pictures.chase import ChaseCamera
from aquanav_tools.envs.pictures.exposure import AutoExposure
from aquanav_tools.envs.pictures.lamp_light import Lamp, LitCave
from aquanav_tools.envs.pictures.lamp_shading import FARTHEST
from aquanav_tools.envs.pictures.triangles import Eye
from aquanav_tools.errors import InputError
from aquanav_tools.photograph.options import DEFAULT_FOCAL_35MM, FILM_DIAGONAL_MM, JERLOV
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array, Capsule, Mesh, rotation_matrix

View = Literal["chase", "onboard"]
MIN_SIDE = 64
"""px."""
NOSE_INSIDE = 0.5
"""The camera on the vehicle is this share of the hull's radius behind its tip: in the water while the hull is."""
HEADLIGHT, FILL = 1.0, 0.35
"""Power of the vehicle's lamps, and of that on the camera that follows it."""
WATER = JERLOV["I"]


class VehicleCamera:
    """Takes pictures of a cave from where a vehicle is."""

    def __init__(self, cave: Scenario, hull: Capsule, body: Mesh, view: str, size: tuple[int, int]) -> None:
        """Prepare the camera.

        Args:
            cave: Where the vehicle is.
            hull: The vehicle's capsule.
            body: How the vehicle looks, body frame, m, with colours.
            view: "chase" or "onboard".
            size: Width and height of the pictures, px.

        Raises:
            InputError: the view is unknown, or the size below 64 px.
        """
        check_choice("view", view, get_args(View))
        self.size, self._is_onboard, self._hull = check_size(size), view == "onboard", hull
        self._focal = DEFAULT_FOCAL_35MM["pinhole"] * float(np.hypot(*size)) / FILM_DIAGONAL_MM
        self._cave = LitCave(cave.cavity.mesh, cave.cavity.labels != WALL, body, WATER)
        self._chase, self._exposure = ChaseCamera(cave.field, hull.length), AutoExposure()
        self._time = 0.0

    def reset(self) -> None:
        """Begin another film: where the camera was and how it was exposed no longer matters."""
        self._chase.reset()
        self._exposure.reset()
        self._time = 0.0

    def picture(self, state: Array, time: float) -> npt.NDArray[np.uint8]:
        """Return the (H, W, 3) picture, RGB.

        Args:
            state: Of the vehicle: its position, m, and quaternion come first.
            time: Since the film's beginning, s: place and exposure follow the vehicle as fast as time goes.
        """
        seconds, self._time = max(time - self._time, 0.0), time
        position, turn = state[:3], rotation_matrix(state[3:7])
        centre, axes = self._onboard(position, turn) if self._is_onboard else self._chase.pose(position, turn, seconds)
        eye = Eye(*self.size, self._focal, centre, axes, FARTHEST)
        lamps = self._headlights(position, turn)
        if not self._is_onboard:
            lamps = (*lamps, Lamp(centre + 0.1 * axes[0] - 0.1 * axes[1], axes[2], FILL))
        light = self._cave.light(eye, lamps, None if self._is_onboard else (position, turn))
        return self._exposure.develop(light, seconds)

    def _onboard(self, position: Array, turn: Array) -> tuple[Array, Array]:
        """Return place and rotation of the camera in the nose."""
        ahead = 0.5 * self._hull.length - NOSE_INSIDE * self._hull.radius
        return position + ahead * turn[:, 0], np.stack([-turn[:, 1], -turn[:, 2], turn[:, 0]])

    def _headlights(self, position: Array, turn: Array) -> tuple[Lamp, ...]:
        """Return the vehicle's two lamps, one for pictures that show both as one."""
        ahead, beside, below = 0.35 * self._hull.length, 0.6 * self._hull.radius, -0.4 * self._hull.radius
        if not self._is_onboard:
            return (Lamp(position + turn @ [ahead, 0.0, below], turn[:, 0], HEADLIGHT),)
        places = (position + turn @ [ahead, sign * beside, below] for sign in (1.0, -1.0))
        return tuple(Lamp(place, turn[:, 0], 0.5 * HEADLIGHT) for place in places)


def check_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return a size of pictures, px.

    Raises:
        InputError: a side is below 64 px.
    """
    if min(size) < MIN_SIDE:
        raise InputError(f"Pictures of {size[0]} x {size[1]} px cannot be taken; choose at least {MIN_SIDE} px.")
    return size
