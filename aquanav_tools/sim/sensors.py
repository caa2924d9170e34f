"""The vehicle's 28 range rays, in the original benchmark's pattern.

The original has four fans of rays over the frontal 180 degrees. A ray runs from the vehicle's middle to a point
`reach` away in the horizontal and `rise` above, all scaled by 0.25; within a fan the order is straight ahead, then
right and left alternately. Distances end at the ray's length when nothing is hit.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.sim.rotation import rotation_rows
from aquanav_tools.types import Array, Mesh

SCALE = 0.25
"""The original's vehicle is drawn at a quarter of its size, and its rays with it."""
BOAT_REACH, BOAT_RADIUS = 30.0, 1.0
"""Rays of the original's boat and their spheres, m."""
SPHERE_RADIUS = 0.5
"""The original casts spheres of this radius, before scaling, m; their scale is that of the whole ray to its reach."""


@dataclass(frozen=True)
class Fan:
    """Rays over the frontal half plane, all with the same elevation."""

    num_per_side: int
    """Rays on either side of the one straight ahead."""
    reach: float
    """Horizontal extent before scaling, m."""
    rise: float
    """Vertical extent before scaling, m."""

    @property
    def num_rays(self) -> int:
        """On both sides, and the one straight ahead."""
        return 2 * self.num_per_side + 1


FANS = (Fan(4, 15.0, 4.0), Fan(4, 15.0, -4.0), Fan(2, 7.0, -8.0), Fan(2, 7.0, 8.0))
"""The original's sensors 0 to 3, elevation 14.9, -14.9, -48.8 and 48.8 degrees."""


@dataclass(frozen=True, eq=False)
class RayPattern:
    """Where the rays point."""

    directions: Array
    """(R, 3) unit vectors, body frame."""
    lengths: Array
    """(R,) m."""
    radii: Array
    """(R,) of the spheres that the original casts along the rays, m."""


def original_pattern() -> RayPattern:
    """Return the original's 28 rays."""
    ends = np.concatenate([_fan_ends(fan) for fan in FANS])
    lengths = np.linalg.norm(ends, axis=1)
    reaches = np.repeat([fan.reach for fan in FANS], [fan.num_rays for fan in FANS])
    return RayPattern(ends / lengths[:, None], lengths, SPHERE_RADIUS * lengths / reaches)


def boat_pattern() -> RayPattern:
    """Return the 7 level rays of the original's boat, which is drawn at twice its size."""
    azimuth = _azimuths(3)
    directions = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(azimuth.shape)], axis=1)
    return RayPattern(directions, np.full(7, BOAT_REACH), np.full(7, BOAT_RADIUS))


def _fan_ends(fan: Fan) -> Array:
    """Return the (2 * num_per_side + 1, 3) ends of a fan's rays relative to the vehicle, body frame, m."""
    azimuth = _azimuths(fan.num_per_side)
    ends = np.stack(
        [fan.reach * np.cos(azimuth), fan.reach * np.sin(azimuth), np.full(azimuth.shape, fan.rise)], axis=1
    )
    return SCALE * ends


def _azimuths(num_per_side: int) -> Array:
    """Return the (2 * num_per_side + 1,) angles of a fan: straight ahead, then right and left alternately, rad."""
    sides = np.radians(90.0) * np.arange(1, num_per_side + 1) / num_per_side
    return np.concatenate([[0.0], np.stack([-sides, sides], axis=1).ravel()])  # left is positive


class RangeSensor:
    """Casts a pattern of rays against a mesh."""

    def __init__(self, mesh: Mesh, pattern: RayPattern) -> None:
        # embree computes in float32, so it works near the mesh's middle.
        self._middle = mesh.vertices.mean(axis=0)
        self._scene = _scene_of(mesh, self._middle)
        self._directions = np.ascontiguousarray(pattern.directions)
        self._lengths: npt.NDArray[np.float32] = pattern.lengths.astype(np.float32)
        self.tags = np.zeros(len(pattern.lengths), dtype=np.int64)
        """(R,) rays do not tell what they meet: always 0."""
        self._origins = np.empty((len(pattern.lengths), 3), dtype=np.float32)
        self._rays = np.empty_like(self._origins)

    def sense(self, state: Array) -> npt.NDArray[np.float32]:
        """Return the (R,) distances to the mesh from a (13,) state, m; at most the rays' lengths."""
        _aim(state, self._middle, self._directions, self._origins, self._rays)
        distances = self._lengths.copy()  # embreex takes the rays' lengths and writes the hits over them
        self._scene.run(self._origins, self._rays, dists=distances, query="DISTANCE")
        return distances


_scenes: weakref.WeakKeyDictionary[Mesh, Any] = weakref.WeakKeyDictionary()


def _scene_of(mesh: Mesh, middle: Array) -> Any:
    """Return the Embree scene of a mesh about a middle; sensors in the same cave share it."""
    from embreex import mesh_construction, rtcore_scene

    scene = _scenes.get(mesh)
    if scene is None:
        scene = _scenes[mesh] = rtcore_scene.EmbreeScene()
        mesh_construction.TriangleMesh(scene, (mesh.vertices - middle).astype(np.float32), mesh.faces.astype(np.int32))
    return scene


@numba.njit(cache=True)
def _aim(state, middle, directions, origins, rays):  # type: ignore[no-untyped-def]
    """Write every ray's origin and world direction for a vehicle at `state`."""
    rotation = rotation_rows(state)
    for n in range(len(directions)):
        for axis in range(3):
            row = rotation[axis]
            origins[n, axis] = state[axis] - middle[axis]
            rays[n, axis] = row[0] * directions[n, 0] + row[1] * directions[n, 1] + row[2] * directions[n, 2]
