"""Plain values shared by all rooms: arrays, poses, capsules, meshes and point clouds.

World frame: metres, right-handed, z up. Body frame: x ahead, y left, z up. Quaternions are (w, x, y, z).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import trimesh

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

Progress = Callable[[int, int], None]
"""Called with (units done, units in all) by work that takes long; whoever shows it decides how."""


def ignore_progress(done: int, total: int) -> None:
    """Show no progress."""


Stages = Callable[[str], AbstractContextManager[Progress]]
"""Opens a stage of long work under a title; leaving the context ends it."""


@contextlib.contextmanager
def silent(title: str) -> Iterator[Progress]:
    """Show nothing: the Stages of whoever does not want to see progress."""
    yield ignore_progress


@dataclass(frozen=True)
class Capsule:
    """A cylinder with two half spheres, its axis along body x: the shape a vehicle collides with."""

    radius: float
    """Radius of the cylinder and of the caps, m."""
    axis_length: float
    """Length of the cylinder alone, m; the whole capsule is axis_length + 2 * radius long."""

    def __post_init__(self) -> None:
        if not self.radius > 0 or not self.axis_length >= 0:
            raise ValueError(
                f"A capsule needs radius > 0 and axis_length >= 0, got {self.radius} and {self.axis_length}."
            )

    @property
    def length(self) -> float:
        """Overall length, m."""
        return self.axis_length + 2.0 * self.radius


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a body is: `world_from_body`."""

    position: Array
    """(3,) world, m."""
    orientation: Array
    """(4,) unit quaternion (w, x, y, z), body to world."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles without any promise about their topology."""

    vertices: Array
    """(V, 3) world, m."""
    faces: IntArray
    """(F, 3) vertex indices, counter-clockwise seen from outside."""
    colours: npt.NDArray[np.uint8] | None = None
    """(V, 3) RGB of the vertices, or None when unknown."""

    @property
    def triangles(self) -> Array:
        """(F, 3, 3) corner positions."""
        corners: Array = self.vertices[self.faces]
        return corners

    @property
    def vector_areas(self) -> Array:
        """(F, 3) normals as long as the faces are large, m^2."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def areas(self) -> Array:
        """(F,) m^2."""
        areas: Array = np.linalg.norm(self.vector_areas, axis=1)
        return areas

    @property
    def normals(self) -> Array:
        """(F, 3) unit normals, zero for faces without an area."""
        vectors = self.vector_areas
        normals: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
        return normals

    @property
    def volume(self) -> float:
        """Signed volume inside a closed mesh, m^3; positive with the normals outwards (divergence theorem)."""
        a, b, c = np.moveaxis(self.triangles, 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    def to_trimesh(self) -> trimesh.Trimesh:
        """Return the same triangles, in the same order, as a trimesh object."""
        import trimesh

        return trimesh.Trimesh(self.vertices, self.faces, process=False)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points on a surface, with unit normals towards the side they were seen from where known."""

    points: Array
    """(N, 3), m."""
    normals: Array | None = None
    """(N, 3) unit vectors, or None when unknown."""
    colours: npt.NDArray[np.uint8] | None = None
    """(N, 3) RGB, or None when unknown."""
    num_photos: IntArray | None = None
    """(N,) photos that agree on each point; None unless the cloud comes from photos, which show the water's side."""
    spread: Array | None = None
    """(N,) standard deviation of the distances that these photos give it, m; None as above."""
    seen_from: Array | None = None
    """(N, 3) where the scanner stood that measured each point, m, NaN where unknown; None unless the file tells."""

    @property
    def faces_water(self) -> bool:
        """Whether its normals are known to point into the water: photos are taken from there."""
        return self.normals is not None and self.num_photos is not None

    def moved(self, b_from_a: Sim3) -> PointCloud:
        """Return the same cloud in another frame."""
        normals = None if self.normals is None else b_from_a.turn(self.normals)
        spread = None if self.spread is None else b_from_a.scale * self.spread
        seen_from = None if self.seen_from is None else b_from_a.apply(self.seen_from)
        return PointCloud(b_from_a.apply(self.points), normals, self.colours, self.num_photos, spread, seen_from)


@dataclass(frozen=True, eq=False)
class Sim3:
    """b_from_a: turns, scales and moves points of frame a into frame b."""

    scale: float = 1.0
    rotation: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3)."""
    translation: Array = field(default_factory=lambda: np.zeros(3))
    """(3,)."""

    def apply(self, points: Array) -> Array:
        """Return (N, 3) points of frame a in frame b."""
        moved: Array = self.scale * points @ self.rotation.T + self.translation
        return moved

    def turn(self, directions: Array) -> Array:
        """Return (N, 3) unit vectors of frame a in frame b."""
        turned: Array = directions @ self.rotation.T
        return turned

    def __matmul__(self, a_from_c: Sim3) -> Sim3:
        """Return b_from_c."""
        return Sim3(self.scale * a_from_c.scale, self.rotation @ a_from_c.rotation, self.apply(a_from_c.translation))


def yaw_quaternion(yaw: float) -> Array:
    """Return the (4,) quaternion (w, x, y, z) of a turn by `yaw` radians about world z."""
    return np.array([np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)])


def rotation_rows(w: Any, x: Any, y: Any, z: Any) -> tuple[tuple[Any, Any, Any], ...]:
    """Return the three rows of the matrix `world_from_body` of a quaternion of any length but 0.

    Its four components are numbers, or arrays of one shape, which each entry then has; numba compiles it as it is.
    """
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)),
        (s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)),
        (s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)),
    )


def rotation_matrix(quaternions: Array) -> Array:
    """Return the matrix `world_from_body` of each quaternion (w, x, y, z), of any length but 0.

    Args:
        quaternions: (4,) or (N, 4).

    Returns:
        (3, 3) or (N, 3, 3).
    """
    if quaternions.ndim == 1:
        return np.array(rotation_rows(*quaternions.tolist()))
    return np.array(rotation_rows(*quaternions.T)).transpose(2, 0, 1)
