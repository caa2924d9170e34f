"""What a camera on the vehicle, or one that follows it, sees of the cave by lamp light."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.errors import InputError
from aquanav_tools.photograph.dive import Photographer
from aquanav_tools.photograph.files import GifFile, VideoFile
from aquanav_tools.photograph.options import CameraOptions, DiveOptions
from aquanav_tools.photograph.scene import RayScene
from aquanav_tools.photograph.sensor import develop
from aquanav_tools.photograph.trajectory import Shot
from aquanav_tools.photograph.water import FloatImage, transmission
from aquanav_tools.types import Array, Capsule, Mesh, Progress, ignore_progress, rotation_matrix

View = Literal["chase", "onboard"]
FILM_SIZES = {".mp4": (640, 480), ".gif": (320, 240)}
"""px, by the suffix of a film's file. A GIF has no motion compression: at this size, 60 kB per frame."""
BEHIND, ABOVE = 1.4, 0.45
"""Where the following camera is, from the middle of the vehicle, m."""
AHEAD = 0.6
"""It looks at a place so far before the vehicle, m."""
FROM_WALL = 0.15
"""It stays so far before a wall that is nearer than its place, m."""
YELLOW, BLACK, RED = (
    np.array(rgb, dtype=np.float32) for rgb in ((0.5, 0.33, 0.04), (0.03, 0.03, 0.035), (0.4, 0.03, 0.02))
)
"""Of the hull, its tail, and a stripe along its back, which tell how it is turned."""
TAIL, STRIPE = -0.3, 0.35
"""Where the tail ends, and half the stripe's width, of the hull's length and radius."""
HULL_AMBIENT = 0.1
"""Light on the hull's unlit side, of the lamp's."""
UP = np.array([0.0, 0.0, 1.0])


class VehicleCamera:
    """Takes pictures of a cave from where a vehicle is."""

    def __init__(self, cave: Mesh, hull: Capsule, view: str, size: tuple[int, int]) -> None:
        """Prepare the camera.

        Args:
            cave: World frame, m, normals out of the water.
            hull: Of the vehicle.
            view: "chase" or "onboard".
            size: Width and height of the pictures, px.

        Raises:
            InputError: the view is unknown, or the size below 64 px.
        """
        check_choice("view", view, get_args(View))
        try:
            # Nothing but what is there: pictures of one state are always the same.
            options = CameraOptions(width=size[0], height=size[1], noise=0.0)
        except ValueError as cause:
            raise InputError(f"Pictures of {size[0]} x {size[1]} px cannot be taken. {cause}") from cause
        dive = DiveOptions(camera=options)
        self._photographer = Photographer(cave, dive)
        self._water, self._options, self._lamp = dive.water, options, dive.lamp
        self._rays = self._photographer.lens.rays()
        self._walls, self._hull, self._capsule = RayScene(cave), RayScene(_hull_mesh(hull)), hull
        self._is_onboard = view == "onboard"
        self.size = size
        """Width and height of the pictures, px."""

    def picture(self, state: Array) -> npt.NDArray[np.uint8]:
        """Return the (H, W, 3) picture, RGB, for a vehicle at a state: its position, m, and quaternion come first."""
        turn = rotation_matrix(state[3:7])
        shot = self._onboard(state[:3], turn) if self._is_onboard else self._chase(state[:3], turn)
        light, depth = self._photographer.expose(shot)
        if not self._is_onboard:
            light = self._with_hull(light, depth, shot, state[:3], turn)
        return develop(light, self._options, np.random.default_rng(0))

    def _onboard(self, position: Array, turn: Array) -> Shot:
        """Return the view from the nose."""
        nose = position + 0.5 * self._capsule.length * turn[:, 0]
        return _still(nose, np.stack([-turn[:, 1], -turn[:, 2], turn[:, 0]]))

    def _chase(self, position: Array, turn: Array) -> Shot:
        """Return the view from behind and above, level, drawn nearer where the wall is in the way."""
        ahead = np.array([turn[0, 0], turn[1, 0], 0.0])
        ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-6 else np.array([1.0, 0.0, 0.0])
        way = -BEHIND * ahead + ABOVE * UP
        clear = self._walls.cast(position, way[None])[0][0]
        share = 1.0 if np.isnan(clear) else min(1.0, max(0.0, clear - FROM_WALL / np.linalg.norm(way)))
        centre = position + share * way
        look = position + AHEAD * ahead - centre
        look /= np.linalg.norm(look)
        right = np.cross(look, UP)
        right /= np.linalg.norm(right)
        return _still(centre, np.stack([right, np.cross(look, right), look]))

    def _with_hull(self, light: FloatImage, depth: FloatImage, shot: Shot, position: Array, turn: Array) -> FloatImage:
        """Return (H, W, 3) light with the hull before the wall, whose (H, W) depth is given."""
        centre = (shot.centre - position) @ turn  # in the body frame
        rays = self._rays @ shot.cam_from_world @ turn
        distance, normals = self._hull.cast(centre, rays)
        with np.errstate(invalid="ignore"):
            is_hull = distance < np.nan_to_num(depth.ravel() / self._rays[:, 2], nan=np.inf)
        if not is_hull.any():
            return light
        right, down, _ = shot.cam_from_world @ turn
        lamp = centre + self._lamp.right * right - self._lamp.up * down
        points = centre + rays[is_hull] * distance[is_hull, None]
        to_lamp = lamp - points
        far = np.linalg.norm(to_lamp, axis=1)
        facing = np.einsum("ij,ij->i", normals[is_hull], to_lamp) / far
        lit = (np.maximum(facing, 0.0) + HULL_AMBIENT) / far**2
        shown = light.reshape(-1, 3).copy()
        shown[is_hull] = self._paint(points) * lit[:, None] * transmission(far + distance[is_hull], self._water)
        return shown.reshape(light.shape)

    def _paint(self, points: Array) -> Array:
        """Return the (N, 3) colours of (N, 3) points of the hull, body frame."""
        is_tail = points[:, 0] < TAIL * self._capsule.length
        is_stripe = (np.abs(points[:, 1]) < STRIPE * self._capsule.radius) & (points[:, 2] > 0.0)
        return np.where(is_tail[:, None], BLACK, np.where(is_stripe[:, None], RED, YELLOW))


def film_size(path: Path) -> tuple[int, int]:
    """Return width and height of a film for a file, px.

    Raises:
        InputError: there are no films with its suffix, or its folder is not there.
    """
    size = FILM_SIZES.get(path.suffix.lower())
    if size is None:
        raise InputError(f"There are no films like {path.name}. Give it a name that ends in {' or '.join(FILM_SIZES)}.")
    if not path.parent.is_dir():
        raise InputError(f"There is no folder {path.parent} for the film {path.name}. Make it first.")
    return size


class Camera(Protocol):
    """Takes the pictures of a film."""

    size: tuple[int, int]

    def picture(self, state: Array) -> npt.NDArray[np.uint8]:
        """Return the (H, W, 3) picture, RGB, of a vehicle at a state."""


def film(
    camera: Camera, states: Array, path: Path, frames_per_second: float, progress: Progress = ignore_progress
) -> None:
    """Write an MP4 or a GIF of (T, 7 or more) states, each a position and a quaternion (w, x, y, z): a frame for each.

    Raises:
        InputError: the file has another suffix.
        ResourceError: OpenCV cannot write it.
    """
    film_size(path)
    unfinished = path.with_name(f"unfinished-{path.name}")
    is_gif = path.suffix.lower() == ".gif"
    file = GifFile(unfinished, frames_per_second) if is_gif else VideoFile(unfinished, frames_per_second, camera.size)
    with file as video:
        for index, state in enumerate(states):
            video.write(camera.picture(state))
            progress(index + 1, len(states))
    unfinished.replace(path)


def _hull_mesh(hull: Capsule) -> Mesh:
    """Return the surface of a capsule along x around the origin, normals outwards, m."""
    import trimesh

    solid = trimesh.creation.capsule(height=hull.axis_length, radius=hull.radius, count=[24, 24])
    solid.apply_translation(-solid.bounds.mean(axis=0))
    x, y, z = np.asarray(solid.vertices, dtype=np.float64).T
    return Mesh(np.stack([z, x, y], axis=1), np.asarray(solid.faces, dtype=np.int64))


def _still(centre: Array, cam_from_world: Array) -> Shot:
    return Shot(centre, cam_from_world, 0.0, np.zeros(3), np.zeros(3))
