"""Pictures of a boat in its bay by daylight: sea, rocks, reefs, the goal's buoys, and the beams of its sensor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.pictures.bands import in_bands
from aquanav_tools.envs.pictures.chase import level
from aquanav_tools.envs.pictures.daylight import (
    BANDS_IN_ROCK,
    FARTHEST,
    PAINT,
    REFRACTION,
    ROCK,
    ROCK_COLOUR,
    SAMPLE,
    TONES,
    paint,
)
from aquanav_tools.envs.pictures.lamp_light import vertex_normals
from aquanav_tools.envs.pictures.pixel_blocks import triangle_table
from aquanav_tools.envs.pictures.rock_tile import SIDE, packed_tile
from aquanav_tools.envs.pictures.sea_rocks import drawn_rock
from aquanav_tools.envs.pictures.triangles import Cells, Eye, see
from aquanav_tools.envs.pictures.vehicle_camera import check_size
from aquanav_tools.envs.pictures.wave_grid import wave_grid
from aquanav_tools.libraries import require
from aquanav_tools.photograph.water import FloatImage
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.appearance import boat_mesh
from aquanav_tools.sim.boat import Boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.sim.solids import joined, tube
from aquanav_tools.types import Array, Mesh, rotation_matrix

FIELD_OF_VIEW = float(np.radians(62.0))
"""Across the picture."""
BEHIND, ABOVE, AHEAD = 3.2, 1.9, 2.5
"""Where the camera is, and the place before the boat that it looks at, in lengths of the boat."""
TURNING = 0.6
"""Time in which the camera's direction follows the boat's, s."""
CELL = 40.0
"""Side of the squares in which rocks are kept, m."""
BUOY_RADIUS, BUOY_HEIGHT = 0.6, 4.0
"""Of the goal, m."""
BUOY = (90, 190, 140)
BEAM_WIDTH, BEAM_RISE = 2, 0.4
"""Of a beam's line, px, and its height over the water, m."""
CLEAR, NEAR = np.array([0.70, 1.00, 0.95]), np.array([0.95, 0.16, 0.14])


class SeaCamera:
    """Looks at a boat from behind and above."""

    def __init__(self, boat: Boat | OriginalVehicle, size: tuple[int, int], beams: Array, beam_lengths: Array) -> None:
        """Prepare the camera.

        Args:
            boat: Which is shown.
            size: Width and height of the pictures, px.
            beams: (7, 3) directions of the sensor's beams, body frame.
            beam_lengths: (7,) m.

        Raises:
            InputError: the size is below 64 px.
        """
        self.size = check_size(size)
        """Width and height of the pictures, px."""
        self._boat = boat_mesh(boat)
        self._length = float(np.ptp(self._boat.vertices[:, 0]))
        self._boat_normals = vertex_normals(self._boat)
        self._beams, self._beam_lengths = beams, beam_lengths
        self._focal = 0.5 * size[0] / math.tan(0.5 * FIELD_OF_VIEW)
        self._heading: Array | None = None
        self._time = 0.0

    def look_at(self, bay: SeaMap) -> None:
        """Show another bay, or another episode in it, from now on."""
        self._heading, self._time = None, 0.0
        rocks = [_flat(drawn_rock(rock, bay.depth)) for rock in bay.rocks]
        buoys = [
            tube([*corner, -1.0], [*corner, BUOY_HEIGHT], (BUOY_RADIUS, 0.6 * BUOY_RADIUS), BUOY)
            for corner in bay.goal.corners
        ]
        still = joined([*rocks, *buoys])
        self._cells = Cells(still, CELL)
        num_rock = sum(len(rock.faces) for rock in rocks)
        kinds = np.where(self._cells.order < num_rock, ROCK, PAINT)
        num_still, boat = len(still.vertices), self._boat
        self._num_still = num_still
        self._vertices = np.concatenate([still.vertices, boat.vertices])
        self._normals = np.concatenate([vertex_normals(still), self._boat_normals])
        self._colours = (np.concatenate([_colours(still), _colours(boat)]) / 255.0) ** 1.4
        self._faces = np.concatenate([still.faces[self._cells.order], boat.faces + num_still])
        self._kinds = np.concatenate([kinds, np.full(len(boat.faces), PAINT)]).astype(np.int64)
        # What lies below the surface seems nearer to it, seen steeply from above.
        self._sunken = still.vertices * [1.0, 1.0, 1.0 / REFRACTION]

    def picture(
        self, state: Array, water: SeaWater, ranges: npt.NDArray[Any], time: float = 0.0
    ) -> npt.NDArray[np.uint8]:
        """Return the (H, W, 3) picture, RGB.

        Args:
            state: The boat's; its position, m, and quaternion come first.
            water: The sea as it is now.
            ranges: (7,) what the beams measure, m.
            time: Since the film's beginning, s: the camera follows the boat as fast as time goes.
        """
        turn = rotation_matrix(state[3:7])
        eye = self._eye(state[:3], turn, time)
        self._vertices[self._num_still :] = self._boat.vertices @ turn.T + state[:3]
        self._normals[self._num_still :] = self._boat_normals @ turn.T
        seen, nearness, origins = see(eye, self._vertices, self._faces, self._cells)
        _, sunken, _ = see(eye, self._sunken, self._faces[: len(self._cells.order)], self._cells)
        solid = self._vertices, self._normals, self._colours, self._faces, self._kinds
        table = triangle_table(origins, *solid, eye.centre, eye.cam_from_world)
        heights, slopes = wave_grid(eye.centre, water)
        view = np.ascontiguousarray(eye.cam_from_world.T, np.float32)
        picture = np.empty((eye.height, eye.width, 3), np.uint8)
        arguments = (
            seen, nearness, sunken, table, np.float32(eye.focal), np.float32(eye.centre[2]), _rays(eye), view,
            heights.ravel(), slopes.reshape(-1, 2), packed_tile()[0], TONES,
        )  # fmt: skip
        in_bands(eye.height, lambda first, end: paint(picture, first, end, *arguments))
        return self._with_beams(picture, eye, state[:3], turn, ranges)

    def _eye(self, position: Array, turn: Array, time: float) -> Eye:
        """Return the camera behind the boat."""
        ahead = level(turn[:, 0])
        kept = 0.0 if self._heading is None else math.exp(-max(time - self._time, 0.0) / TURNING)
        heading = ahead if self._heading is None else level(kept * self._heading + (1.0 - kept) * ahead, ahead)
        self._heading, self._time = heading, time
        up, place = np.array([0.0, 0.0, 1.0]), position * [1.0, 1.0, 0.0]
        centre = place + self._length * (ABOVE * up - BEHIND * heading)
        look = place + AHEAD * self._length * heading - centre
        look /= np.linalg.norm(look)
        right = np.cross(look, up)
        right /= np.linalg.norm(right)
        return Eye(*self.size, self._focal, centre, np.stack([right, np.cross(look, right), look]), FARTHEST)

    def _with_beams(
        self, picture: npt.NDArray[np.uint8], eye: Eye, position: Array, turn: Array, ranges: npt.NDArray[Any]
    ) -> npt.NDArray[np.uint8]:
        """Return the picture with a line along each beam, the redder the nearer its echo."""
        require("A picture of a boat's beams", "cv2")
        import cv2

        start = np.array([position[0], position[1], BEAM_RISE])
        layer = picture.copy()
        for beam, reach, length in zip(self._beams @ turn.T, ranges, self._beam_lengths, strict=True):
            pixels = eye.project(start + np.linspace(0.0, float(reach), 40)[:, None] * beam * [1.0, 1.0, 0.0])
            pixels = pixels[np.isfinite(pixels).all(axis=1)]
            if len(pixels) < 2:
                continue
            share = float(reach) / float(length)
            colour: Any = (255.0 * (share * CLEAR + (1.0 - share) * NEAR)).tolist()
            cv2.polylines(layer, [np.round(8.0 * pixels).astype(np.int32)], False, colour, BEAM_WIDTH, cv2.LINE_AA, 3)
            if reach < length:
                end = np.round(8.0 * pixels[-1]).astype(int).tolist()
                cv2.circle(layer, end, 8 * 2 * BEAM_WIDTH, colour, -1, cv2.LINE_AA, 3)
        return np.asarray(cv2.addWeighted(layer, 0.75, picture, 0.25, 0.0), np.uint8)


def _rays(eye: Eye) -> FloatImage:
    """Return the (4, 4) coordinates of the rock's texture and bands at the camera, and their change along its axes."""
    per_metre = np.vstack([np.eye(3) / SAMPLE, BANDS_IN_ROCK / (2.0 * np.pi)])
    at = per_metre @ eye.centre % [SIDE, SIDE, SIDE, 1.0]  # both repeat
    return np.column_stack([at, per_metre @ eye.cam_from_world.T]).astype(np.float32)


def _flat(mesh: Mesh) -> Mesh:
    """Return a rock in its colour, the top's triangles smooth and the rim's edges sharp where they are steep."""
    solid = mesh.to_trimesh().smooth_shaded
    tint = np.round(255.0 * np.array(ROCK_COLOUR)).astype(np.uint8)
    vertices = np.asarray(solid.vertices, dtype=np.float64)
    return Mesh(vertices, np.asarray(solid.faces, dtype=np.int64), np.tile(tint, (len(vertices), 1)))


def _colours(mesh: Mesh) -> npt.NDArray[np.uint8]:
    assert mesh.colours is not None, "joined solids have colours"
    return mesh.colours
