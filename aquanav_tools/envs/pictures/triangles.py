"""Which triangle a pinhole camera sees in each pixel: clipped, projected, and drawn with a depth buffer."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.pictures.bands import in_bands
from aquanav_tools.photograph.water import FloatImage
from aquanav_tools.report.raster import NO_FACE, rasterise_rows
from aquanav_tools.types import Array, IntArray, Mesh

NEAR = 0.02
"""Nearest that the camera sees, m."""


@dataclass(frozen=True, eq=False)
class Eye:
    """A pinhole camera; its axis meets the picture in its middle, pixel centres lie at 0.5."""

    width: int
    """px."""
    height: int
    """px."""
    focal: float
    """px."""
    centre: Array
    """(3,) world, m."""
    cam_from_world: Array
    """(3, 3) rotation; camera x right, y down, z ahead."""
    far: float
    """Farthest that it sees, m."""

    def project(self, points: Array) -> Array:
        """Return the (N, 2) column and row of (N, 3) world points, px; NaN for those behind the camera."""
        seen = (points - self.centre) @ self.cam_from_world.T
        ahead = np.where(seen[:, 2:] > NEAR, seen[:, 2:], np.nan)
        pixels: Array = self.focal * seen[:, :2] / ahead + 0.5 * np.array([self.width, self.height])
        return pixels


class Cells:
    """Triangles sorted by where they are, so that those out of sight are passed over together."""

    def __init__(self, mesh: Mesh, side: float) -> None:
        """Sort the triangles of a mesh into cubes of a side, m; only the front of each can be seen."""
        middles = mesh.triangles.mean(axis=1)
        cubes = np.floor(middles / side).astype(np.int64)
        _, number = np.unique(cubes, axis=0, return_inverse=True)
        self.order: IntArray = np.argsort(number, kind="stable")
        """(F,) the mesh's faces in the cells' order."""
        counts = np.bincount(number.ravel())
        self.first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        corners = mesh.triangles[self.order].reshape(-1, 3)
        low, high = (take.reduceat(corners, 3 * self.first[:-1], axis=0) for take in (np.minimum, np.maximum))
        self.spheres = np.column_stack([0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=1)])
        """(C, 4) middle and radius of a ball around each cell's triangles, m."""


def see(
    eye: Eye, vertices: Array, faces: IntArray, cells: Cells | None = None
) -> tuple[npt.NDArray[np.int32], FloatImage, IntArray]:
    """Return what is in each pixel.

    Args:
        eye: Looks.
        vertices: (V, 3) world, m.
        faces: (F, 3), seen from the side on which they run counter-clockwise. With cells, in the cells' order, and
            further faces behind them.
        cells: Of the first faces.

    Returns:
        (H, W) number of the triangle in sight, NO_FACE for none, (H, W) one over its depth along the camera's axis,
        1/m, -inf for none, and the face that each of the (N,) triangles is of: what is left of it before the camera.
    """
    first = np.array([0, len(faces)]) if cells is None else np.append(cells.first, len(faces))
    spheres = np.empty((0, 4)) if cells is None else cells.spheres
    lens = np.array([eye.focal, 0.5 * eye.width, 0.5 * eye.height, eye.far])
    corners, origins = _project(vertices, faces, first, spheres, eye.centre, eye.cam_from_world, lens)
    seen, nearness = (
        np.full((eye.height, eye.width), NO_FACE, np.int32),
        np.full((eye.height, eye.width), -np.inf, np.float32),
    )
    in_bands(eye.height, lambda first, end: rasterise_rows(corners, seen, nearness, first, end))
    return seen, nearness, origins


@numba.njit(cache=True, error_model="numpy")
def _project(vertices, faces, first, spheres, centre, turn, lens):  # type: ignore[no-untyped-def]
    """Return (N, 3, 3) column, row and one over depth of the visible triangles' corners, and the face of each."""
    is_chosen = np.ones(len(first) - 1, np.bool_)
    count = 0
    for cell in range(len(first) - 1):
        if cell < len(spheres):
            is_chosen[cell] = _is_in_sight(spheres[cell], centre, turn, lens)
        if is_chosen[cell]:
            count += first[cell + 1] - first[cell]
    corners, origins = np.empty((2 * count, 3, 3)), np.empty(2 * count, np.int64)
    seen, kept = np.empty((3, 3)), np.empty((4, 3))
    count = 0
    for cell in range(len(first) - 1):
        if not is_chosen[cell]:
            continue
        for face in range(first[cell], first[cell + 1]):
            for k in range(3):
                vertex = vertices[faces[face, k]]
                x, y, z = vertex[0] - centre[0], vertex[1] - centre[1], vertex[2] - centre[2]
                for axis in range(3):
                    seen[k, axis] = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z
            if not _is_facing(seen):
                continue
            number = _clip(seen, kept)
            for k in range(number - 2):
                _place(kept[0], lens, corners[count, 0])
                _place(kept[k + 1], lens, corners[count, 1])
                _place(kept[k + 2], lens, corners[count, 2])
                origins[count] = face
                count += 1
    return corners[:count], origins[:count]


@numba.njit(cache=True, error_model="numpy")
def _is_in_sight(sphere, centre, turn, lens):  # type: ignore[no-untyped-def]
    x, y, z = sphere[0] - centre[0], sphere[1] - centre[1], sphere[2] - centre[2]
    radius, focal, half_width, half_height, far = sphere[3], lens[0], lens[1], lens[2], lens[3]
    right = abs(turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z)
    down = abs(turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z)
    ahead = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z
    if ahead < -radius or ahead > far + radius:
        return False
    beside = (right * focal - ahead * half_width) / np.sqrt(focal * focal + half_width * half_width)
    above = (down * focal - ahead * half_height) / np.sqrt(focal * focal + half_height * half_height)
    return beside < radius and above < radius


@numba.njit(cache=True, error_model="numpy")
def _is_facing(seen):  # type: ignore[no-untyped-def]
    """Return whether a triangle in the camera's frame shows its front: the camera is at the origin."""
    ax, ay, az = seen[1, 0] - seen[0, 0], seen[1, 1] - seen[0, 1], seen[1, 2] - seen[0, 2]
    bx, by, bz = seen[2, 0] - seen[0, 0], seen[2, 1] - seen[0, 1], seen[2, 2] - seen[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return nx * seen[0, 0] + ny * seen[0, 1] + nz * seen[0, 2] < 0.0


@numba.njit(cache=True, error_model="numpy")
def _clip(seen, kept):  # type: ignore[no-untyped-def]
    """Cut off what is nearer than NEAR (Sutherland and Hodgman); return the number of corners left, up to 4."""
    number, before = 0, 2
    for here in range(3):
        a, b = seen[before, 2] - NEAR, seen[here, 2] - NEAR
        if (a > 0.0) != (b > 0.0):
            share = a / (a - b)
            for axis in range(3):
                kept[number, axis] = seen[before, axis] + share * (seen[here, axis] - seen[before, axis])
            number += 1
        if b > 0.0:
            kept[number] = seen[here]
            number += 1
        before = here
    return number


@numba.njit(cache=True, error_model="numpy")
def _place(point, lens, corner):  # type: ignore[no-untyped-def]
    corner[2] = 1.0 / point[2]
    corner[0] = lens[0] * point[0] * corner[2] + lens[1]
    corner[1] = lens[0] * point[1] * corner[2] + lens[2]
