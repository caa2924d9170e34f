"""A cave and a vehicle in it by the light of lamps, for films: in a fifth of the time that a photograph takes."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from aquanav_tools.envs.pictures.bands import in_bands
from aquanav_tools.envs.pictures.lamp_shading import (
    BODY,
    CORNER_LOSS,
    FARTHEST,
    FINER,
    IRON,
    OPEN,
    PASSING_PER_M,
    ROCK,
    SIZES,
    shade,
)
from aquanav_tools.envs.pictures.pixel_blocks import triangle_table
from aquanav_tools.envs.pictures.rock_tile import SIDE, packed_tile
from aquanav_tools.envs.pictures.triangles import Cells, Eye, see
from aquanav_tools.photograph.options import Water
from aquanav_tools.photograph.water import FloatImage, transmission, veil_image
from aquanav_tools.types import Array, BoolArray, Mesh

CELL = 3.0
"""Side of the cubes in which the wall is kept, m."""
VEIL_STEP = 0.01
"""A camera that follows a vehicle is taken to be a whole number of these away, m."""
VEIL_STEPS = 300
"""Of the table of the water's own light, up to FARTHEST."""
FINE_TURN = np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
"""Of the finer layer of texture against the coarser, against repeats."""
FINE_SHIFT = 0.37
"""Of the finer layer along y, m."""
IRON_WAVES, LAYER_WAVES = np.array([0.7, -0.5, 1.9]), np.array([0.0, 0.0, 15.0])
"""Of the rock's colour in space, rad/m."""


class Lamp(NamedTuple):
    """A lamp in the world."""

    place: Array
    """(3,) m."""
    ahead: Array
    """(3,) unit vector along its beam."""
    power: float
    """Its light on a white wall that faces it at 1 m."""


class LitCave:
    """A cave that pictures are taken of, with a vehicle in it."""

    def __init__(self, wall: Mesh, is_portal: BoolArray, body: Mesh, water: Water) -> None:
        """Prepare the cave.

        Args:
            wall: World frame, m, normals out of the water.
            is_portal: (F,) which of its faces are openings.
            body: The vehicle, body frame, m, normals outwards, with colours.
            water: Dims and veils.
        """
        inside = Mesh(wall.vertices, wall.faces[:, ::-1])
        self._cells = Cells(inside, CELL)
        order, count = self._cells.order, len(wall.vertices)
        self._faces = np.concatenate([inside.faces[order], body.faces + count])
        kinds = np.where(is_portal[order], OPEN, ROCK)
        self._kinds = np.concatenate([kinds, np.full(len(body.faces), BODY)]).astype(np.int64)
        self._vertices = np.concatenate([wall.vertices, body.vertices])
        self._normals = np.concatenate([vertex_normals(inside), vertex_normals(body)])
        self._num_wall, self._num_faces, self._body = count, len(wall.faces), body
        self._body_normals = self._normals[count:].copy()
        assert body.colours is not None, "a vehicle has colours"
        self._colours = np.concatenate([np.zeros((count, 3)), (body.colours / 255.0) ** 2.2])
        self._water, self._textures = water, packed_tile()
        self._passing = transmission(np.arange(0.0, 2.0 * FARTHEST, 1.0 / PASSING_PER_M), water)

    def light(self, eye: Eye, lamps: tuple[Lamp, ...], pose: tuple[Array, Array] | None) -> FloatImage:
        """Return the (H, W, 3) light on the sensor.

        Args:
            eye: Where the camera is.
            lamps: The vehicle's, and last the camera's own where it has one.
            pose: Position, m, and rotation (world from body) of the vehicle; None leaves it out.
        """
        faces = self._faces
        if pose is None:
            faces = faces[: self._num_faces]
        else:
            position, turn = pose
            self._vertices[self._num_wall :] = self._body.vertices @ turn.T + position
            self._normals[self._num_wall :] = self._body_normals @ turn.T
        seen, nearness, origins = see(eye, self._vertices, faces, self._cells)
        solid = self._vertices, self._normals, self._colours, faces, self._kinds
        table = triangle_table(origins, *solid, eye.centre, eye.cam_from_world)
        separation = float(np.linalg.norm(lamps[0].place - eye.centre))
        veil = veil_table(self._water, max(round(separation / VEIL_STEP) * VEIL_STEP, 0.05))
        lens = np.array([eye.focal, CORNER_LOSS * 4.0 * eye.focal**2 / (eye.width**2 + eye.height**2)], np.float32)
        view = np.ascontiguousarray(eye.cam_from_world.T, np.float32)
        light = np.empty((eye.height, eye.width, 3), np.float32)
        arguments = seen, nearness, table, lens, _rays(eye), view, _lamp_table(eye, lamps), self._passing, veil
        in_bands(eye.height, lambda first, end: shade(light, first, end, *arguments, *self._textures))
        return light


def _rays(eye: Eye) -> FloatImage:
    """Return the (8, 4) coordinates of texture and waves at the camera, and their change per depth along its axes.

    Those of texture are in samples, of waves in turns; both repeat, so that they may begin near 0.
    """
    scales = [np.eye(3) / SIZES[0], FINE_TURN / SIZES[1], IRON_WAVES / (2.0 * np.pi), LAYER_WAVES / (2.0 * np.pi)]
    per_metre = np.vstack(scales)
    at = per_metre @ eye.centre
    at[FINER + 1] += FINE_SHIFT / SIZES[1]
    at[:IRON] %= SIDE
    at[IRON:] %= 1.0
    return np.column_stack([at, per_metre @ eye.cam_from_world.T]).astype(np.float32)


def _lamp_table(eye: Eye, lamps: tuple[Lamp, ...]) -> FloatImage:
    """Return (N, 8) place from the camera, direction and power of lamps, and whether it is a vehicle's own."""
    rows = [[*(lamp.place - eye.centre), *lamp.ahead, lamp.power, lamp is not lamps[-1]] for lamp in lamps]
    return np.array(rows, np.float32)


@functools.lru_cache(256)
def veil_table(water: Water, separation: float) -> FloatImage:
    """Return (VEIL_STEPS, 3) light that the water before rock sends back, by distance up to FARTHEST.

    Args:
        water: Scatters.
        separation: Of lamp and camera, m.
    """
    return veil_image(np.linspace(0.0, FARTHEST, VEIL_STEPS), water, separation)


def vertex_normals(mesh: Mesh) -> Array:
    """Return the (V, 3) unit normals at a mesh's vertices: the mean of its faces', by area."""
    areas, sums = mesh.vector_areas, np.zeros_like(mesh.vertices)
    for corner in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(mesh.faces[:, corner], areas[:, axis], len(sums))
    found: Array = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-30)
    return found
