"""Rendering triangles from any side, in parallel or perspective projection, without a graphics driver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.report.raster import NO_FACE, rasterise
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

SUPERSAMPLING = 2
"""Samples per pixel along each side."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole, or for a parallel projection the middle of the picture."""

    position: Array
    """(3,) m."""
    right: Array
    """(3,) unit vector that points right in the picture."""
    up: Array
    """(3,) unit vector that points up in the picture."""
    reach: float
    """Half the picture's width: metres in a parallel projection, else the tangent of half its angle."""
    aspect: float
    """Width of the picture over its height."""
    is_parallel: bool

    @property
    def ahead(self) -> Array:
        """(3,) unit vector into the picture."""
        return np.cross(self.up, self.right)

    def height(self, width: int) -> int:
        """Return the height of a picture `width` pixels wide, pixels."""
        return max(1, round(width / self.aspect))

    def rays(self, width: int) -> tuple[Array, Array]:
        """Return the origins and unit directions, (H, W, 3) each, of the pixels of a picture `width` pixels wide."""
        height = self.height(width)
        across = self.reach * ((np.arange(width) + 0.5) * 2.0 / width - 1.0)
        upward = self.reach * (height - (np.arange(height) + 0.5) * 2.0) / width
        offsets = across[None, :, None] * self.right + upward[:, None, None] * self.up
        if self.is_parallel:
            return self.position + offsets, np.broadcast_to(self.ahead, offsets.shape).copy()
        directions = self.ahead + offsets
        return np.broadcast_to(self.position, directions.shape).copy(), directions / np.linalg.norm(
            directions, axis=-1, keepdims=True
        )

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return where (N, 3) points appear and how far they are.

        Returns:
            (N, 2) picture coordinates, in which x runs from -1 left to 1 right and y upwards on the same scale, and the
            (N,) distance along their rays, m; points behind a pinhole have NaN coordinates.
        """
        offsets = points - self.position
        flat, depth = offsets @ np.stack([self.right, self.up], axis=1), offsets @ self.ahead
        if self.is_parallel:
            return flat / self.reach, depth
        safe = np.where(depth > 1e-9, depth, np.nan)
        return flat / safe[:, None] / self.reach, np.linalg.norm(offsets, axis=1)


@dataclass(frozen=True, eq=False)
class Shot:
    """What a camera sees, per pixel."""

    faces: IntArray
    """(H, W) index of the face that is hit, NO_FACE for none."""
    distance: Array
    """(H, W) m along the ray, inf for none."""
    facing: Array
    """(H, W) cosine between the ray and the face's normal, in [0, 1]; meaningless for none."""

    @property
    def is_hit(self) -> BoolArray:
        """(H, W) whether there is a face."""
        return self.faces != NO_FACE


class Scene:
    """Triangles, ready to be looked at many times."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._normals = mesh.normals

    @cached_property
    def _rays(self) -> RayScene:
        return RayScene(self._mesh)

    def look(self, camera: Camera, width: int) -> Shot:
        """Return what a camera sees in a picture `width` pixels wide; both sides of faces are visible."""
        return self._project(camera, width) if camera.is_parallel else self._cast(camera, width)

    def normals_towards(self, camera: Camera) -> Array:
        """Return the (F, 3) unit normals of the faces, turned to the viewer of a parallel projection."""
        away = self._normals @ camera.ahead > 0.0
        return np.where(away[:, None], -self._normals, self._normals)

    def _project(self, camera: Camera, width: int) -> Shot:
        height = camera.height(width)
        flat, depth = camera.project(self._mesh.vertices)
        places = np.column_stack([0.5 * width * (flat[:, 0] + 1.0), 0.5 * (height - flat[:, 1] * width), -depth])
        faces, nearness = rasterise(places[self._mesh.faces], width, height)
        return Shot(faces, -nearness, np.abs(self._normals @ camera.ahead)[faces])

    def _cast(self, camera: Camera, width: int) -> Shot:
        origins, directions = camera.rays(width)
        hits = self._rays.hits(origins.reshape(-1, 3), directions.reshape(-1, 3))
        faces, distance = hits.faces.reshape(directions.shape[:2]), hits.lengths.reshape(directions.shape[:2])
        return Shot(faces, distance, np.abs(np.einsum("...i,...i->...", self._normals[faces], directions)))


def is_visible(shot: Shot, camera: Camera, points: Array, slack: float) -> BoolArray:
    """Return which of (N, 3) points are in the picture and not hidden, by more than `slack` metres, behind a face."""
    pixels, distance = pixel_of(shot, camera, points)
    height, width = shot.faces.shape
    is_inside: BoolArray = np.asarray(np.isfinite(pixels).all(axis=1))
    rows, columns = np.where(is_inside[:, None], pixels, 0.0).astype(int).T
    is_inside &= (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    rows, columns = np.where(is_inside, rows, 0), np.where(is_inside, columns, 0)
    visible: BoolArray = is_inside & (distance <= shot.distance[rows, columns] + slack)
    return visible


def pixel_of(shot: Shot, camera: Camera, points: Array) -> tuple[Array, Array]:
    """Return the (N, 2) row and column, with fractions, of (N, 3) points in a picture, and their (N,) distance, m."""
    height, width = shot.faces.shape
    flat, distance = camera.project(points)
    return np.stack([0.5 * (height - flat[:, 1] * width), 0.5 * width * (flat[:, 0] + 1.0)], axis=1), distance


def shrink(colours: Array) -> Array:
    """Return an (H, W, 3) picture made of SUPERSAMPLING x SUPERSAMPLING samples per pixel."""
    height, width = (size // SUPERSAMPLING for size in colours.shape[:2])
    blocks = colours[: height * SUPERSAMPLING, : width * SUPERSAMPLING]
    mean: Array = blocks.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING, 3).mean(axis=(1, 3))
    return mean
