"""A cave and a vehicle in it by the light of lamps, for films: in a fifth of the time that a photograph takes."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numba
import numpy as np

from aquanav_tools.envs.pictures.bands import in_bands
from aquanav_tools.envs.pictures.rock_tile import look_up, look_up_grey, rock_tile
from aquanav_tools.envs.pictures.triangles import Cells, Eye, corner_shares, see
from aquanav_tools.photograph.options import Water
from aquanav_tools.photograph.rock import AMBIENT, beam
from aquanav_tools.photograph.water import FloatImage, transmission, veil_image
from aquanav_tools.types import Array, BoolArray, Mesh

FAR = 30.0
"""Nothing farther off is lit, m: there, a lamp's light is a ten-thousandth of that at 1 m."""
CELL = 3.0
"""Side of the cubes in which the wall is kept, m."""
LAMP_SIZE = 0.45
"""Width of a vehicle's array of lamps, m: it dazzles less on near wall than a point would."""
ROCK, OPEN, BODY = 0, 1, 2
"""What a face is of: wall, a portal, through which one sees open water, or a vehicle."""
VEIL_STEP = 0.01
"""A camera that follows a vehicle is taken to be a whole number of these away, m."""
VEIL_STEPS = 300
"""Of the table of the water's own light, up to FAR."""
BEYOND = 0.0006, 0.004, 0.006
"""Light of the water beyond an opening."""
PASSING_PER_M = 50.0
"""Of the table of the light that is left after a way through the water: a step is a hundredth of the light at most."""
BODY_AMBIENT = 0.1
"""Light on a vehicle's unlit side, of the lamp's."""
SIZES = 0.024, 0.0057
"""Side of a sample of the rock's texture, m: two layers, the finer one without relief."""
FAINT = 0.12
"""Share of the finer layer from which on it is left out: a pixel is 1.4 of its samples wide there."""
RELIEF = 0.16
"""Slope of the texture's relief, one standard deviation."""
CORNER_LOSS = 0.3
"""Share of the light that the lens loses in the picture's corners."""


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
        self._colours = ((body.colours / 255.0) ** 2.2).astype(np.float32)
        self._water, self._tile = water, rock_tile()
        self._passing = transmission(np.arange(0.0, 2.0 * FAR, 1.0 / PASSING_PER_M), water)

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
        seen, nearness = see(eye, self._vertices, faces, self._cells)
        solid = self._vertices, self._normals, faces, self._kinds, self._colours, self._num_wall
        separation = float(np.linalg.norm(lamps[0].place - eye.centre))
        veil = veil_table(self._water, max(round(separation / VEIL_STEP) * VEIL_STEP, 0.05))
        table = np.array([[*lamp.place, *lamp.ahead, lamp.power] for lamp in lamps])
        view = eye.centre, eye.cam_from_world, eye.focal
        light = np.zeros((eye.height, eye.width, 3), np.float32)
        arguments = seen, nearness, solid, view, table, self._passing, veil, self._tile
        in_bands(eye.height, lambda first, end: _shade(light, first, end, *arguments))
        return light


@functools.lru_cache(256)
def veil_table(water: Water, separation: float) -> FloatImage:
    """Return (VEIL_STEPS, 3) light that the water before rock sends back, by distance up to FAR.

    Args:
        water: Scatters.
        separation: Of lamp and camera, m.
    """
    return veil_image(np.linspace(0.0, FAR, VEIL_STEPS), water, separation)


def vertex_normals(mesh: Mesh) -> Array:
    """Return the (V, 3) unit normals at a mesh's vertices: the mean of its faces', by area."""
    areas, sums = mesh.vector_areas, np.zeros_like(mesh.vertices)
    for corner in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(mesh.faces[:, corner], areas[:, axis], len(sums))
    found: Array = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-30)
    return found


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract", "reassoc", "arcp", "afn", "nsz"})
def _shade(light, first, end, seen, nearness, solid, view, lamps, passing, veil, tile):  # type: ignore[no-untyped-def]
    """Add to (H, W, 3) light what is seen in each pixel of rows from `first` to before `end`."""
    vertices, normals, faces, kinds, colours, num_wall = solid
    centre, turn, focal = view
    height, width = seen.shape
    right, down, ahead = turn[0], turn[1], turn[2]
    for row in range(first, end):
        for column in range(width):
            x, y = (column + 0.5 - 0.5 * width) / focal, (row + 0.5 - 0.5 * height) / focal
            length = np.sqrt(x * x + y * y + 1.0)
            face, far = seen[row, column], FAR
            kind = OPEN if face < 0 else kinds[face]
            if kind != OPEN:
                depth = 1.0 / nearness[row, column]
                far = depth * length
                px = centre[0] + depth * (x * right[0] + y * down[0] + ahead[0])
                py = centre[1] + depth * (x * right[1] + y * down[1] + ahead[1])
                pz = centre[2] + depth * (x * right[2] + y * down[2] + ahead[2])
                i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
                a, b = corner_shares(vertices[i], vertices[j], vertices[k], px, py, pz)
                c = 1.0 - a - b
                nx = a * normals[i, 0] + b * normals[j, 0] + c * normals[k, 0]
                ny = a * normals[i, 1] + b * normals[j, 1] + c * normals[k, 1]
                nz = a * normals[i, 2] + b * normals[j, 2] + c * normals[k, 2]
                if kind == BODY:
                    red, green, blue = colours[i - num_wall, 0], colours[i - num_wall, 1], colours[i - num_wall, 2]
                    ambient = BODY_AMBIENT
                else:
                    red, green, blue, sx, sy, sz = _rock(tile, px, py, pz, depth / focal)
                    along = sx * nx + sy * ny + sz * nz
                    nx, ny, nz = nx - sx + along * nx, ny - sy + along * ny, nz - sz + along * nz
                    ambient = AMBIENT
                scale = 1.0 / max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-9)
                nx, ny, nz = scale * nx, scale * ny, scale * nz
                # A vehicle's own lamps, which come first, do not shine on itself.
                for n in range(len(lamps) - 1 if kind == BODY else 0, len(lamps)):
                    lit, way = _lamp_on(lamps[n], px, py, pz, nx, ny, nz, ambient)
                    left = passing[min(int((way + far) * PASSING_PER_M), len(passing) - 1)]
                    light[row, column, 0] += red * lit * left[0]
                    light[row, column, 1] += green * lit * left[1]
                    light[row, column, 2] += blue * lit * left[2]
            elif face >= 0:
                light[row, column, 0], light[row, column, 1], light[row, column, 2] = BEYOND
            at = int(min(far / FAR, 1.0) * (len(veil) - 1))
            strength = lamps[0, 6] * beam(1.0 / length)
            passed = 1.0 - CORNER_LOSS * (x * x + y * y) * 4.0 * focal * focal / (width * width + height * height)
            for channel in range(3):
                light[row, column, channel] = passed * (light[row, column, channel] + strength * veil[at, channel])


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "arcp", "afn", "nsz"})
def _lamp_on(lamp, px, py, pz, nx, ny, nz, ambient):  # type: ignore[no-untyped-def]
    """Return how much light of a lamp a surface sends back before the water takes its part, and the lamp's distance."""
    lx, ly, lz = lamp[0] - px, lamp[1] - py, lamp[2] - pz
    square = lx * lx + ly * ly + lz * lz
    way = np.sqrt(square)
    facing = max(0.0, (nx * lx + ny * ly + nz * lz) / way)
    on_axis = -(lamp[3] * lx + lamp[4] * ly + lamp[5] * lz) / way
    return lamp[6] * (facing * beam(on_axis) + ambient) / (square + LAMP_SIZE * LAMP_SIZE), way


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _rock(tile, x, y, z, pixel):  # type: ignore[no-untyped-def]
    """Return the rock's red, green and blue, and its relief's slope along x, y and z, seen with a pixel's size, m."""
    grain, east, north, up = look_up(tile, x / SIZES[0], y / SIZES[0], z / SIZES[0])
    share = min(1.0, SIZES[0] / (2.0 * pixel))
    grey, slope = 0.48 + 0.15 * grain, RELIEF * share
    sx, sy, sz = slope * east, slope * north, slope * up
    share = (min(1.0, SIZES[1] / (2.0 * pixel)) ** 2 - FAINT) / (1.0 - FAINT)
    if share > 0.0:
        u, w = 0.8 * x - 0.6 * z, 0.6 * x + 0.8 * z  # turned, against repeats
        grey += 0.11 * share * look_up_grey(tile, u / SIZES[1], (y + 0.37) / SIZES[1], w / SIZES[1])
    iron = 0.5 + 0.5 * wave(1.9 * z + 0.7 * x - 0.5 * y + 1.2 * grain)
    grey = min(1.0, max(0.05, grey + 0.06 * wave(15.0 * z + 3.0 * iron + 0.8 * grain)))
    return grey * (1.0 + 0.22 * iron), grey * (0.92 + 0.02 * iron), grey * (0.82 - 0.18 * iron), sx, sy, sz


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def wave(angle):  # type: ignore[no-untyped-def]
    """Return a sine within 0.06, of two parabolas: in an eighth of the time."""
    turns = angle * (0.5 / np.pi)
    turns -= np.floor(turns + 0.5)
    return 8.0 * turns - 16.0 * turns * abs(turns)
