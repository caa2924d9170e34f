"""A rectangular room, in which every ray is known in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
import warp as wp

from aquanav_tools.geometry.volume.field import DistanceField, field_from_dense
from aquanav_tools.sim.batch.caves import Cave, shared_wall
from aquanav_tools.sim.batch.field import make_grid
from aquanav_tools.sim.batch.runtime import find_device
from aquanav_tools.sim.batch.sensors.base import SensorBatch
from aquanav_tools.sim.batch.state import BatchState, make_state
from aquanav_tools.types import Mesh

LOW, HIGH = np.array([-6.0, -4.0, -3.0]), np.array([6.0, 4.0, 3.0])
SECONDS = 0.1
DEVICE = find_device("cpu")


def room_field(spacing: float = 0.1) -> DistanceField:
    """Clearance in the room: the distance to the nearest of its six walls."""
    axes = [np.arange(a - 2 * spacing, b + 2.5 * spacing, spacing) for a, b in zip(LOW, HIGH, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    clearance = np.minimum(points - LOW, HIGH - points).min(axis=-1)
    return field_from_dense(LOW - 2 * spacing, spacing, clearance.astype(np.float32))


def room_mesh() -> Mesh:
    """The room's walls, normals out of the water."""
    box = trimesh.creation.box(bounds=[LOW, HIGH])
    return Mesh(np.array(box.vertices), np.array(box.faces, dtype=np.int64))


_MESH = room_mesh()
_FIELD = room_field()
_GRID = make_grid(_FIELD, DEVICE)
_WIDTHS = {name: 0 for name, field in BatchState.vars.items() if field.type.ndim == 2}  # type: ignore[attr-defined]


def room_cave(source: str = "mesh") -> Cave:
    """The room for rays to the "mesh" or through the "field"; its entrance is 1 m above the middle."""
    cave, middle = Cave(), _MESH.vertices.mean(axis=0)
    cave.grid, cave.middle = _GRID, wp.vec3d(*middle)
    if source == "mesh":
        cave.ray_wall = shared_wall(_MESH, _FIELD, middle, DEVICE)
    cave.rules.entrance_height = 1.0
    return cave


def room_batch(source: str = "mesh", num_threads: int | None = 1, **arrays: Any) -> SensorBatch:
    """Return vehicles in the room: `positions`, (N, 3), and other arrays of `BatchState`.

    What is left out is at rest and level, at the beginning of an episode with seed 0.
    """
    num = len(arrays["positions"])
    state = make_state(num, _WIDTHS, DEVICE)
    state.orientations.assign(np.tile([1.0, 0.0, 0.0, 0.0], (num, 1)))
    for name, values in arrays.items():
        array = np.asarray(values)
        getattr(state, name).assign(array.astype(np.uint32).view(np.int32) if name == "seeds" else array)
    return SensorBatch(state, [room_cave(source)], SECONDS, DEVICE, num_threads)


def distance_to_room(positions: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Return the exact distances from inside the room along unit vectors, (..., 3) each."""
    with np.errstate(divide="ignore"):
        to_walls = np.where(ways > 0.0, HIGH - positions, LOW - positions) / ways
    return np.where(ways == 0.0, np.inf, to_walls).min(axis=-1)


def random_poses(rng: np.random.Generator, num: int, margin: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 3) positions in the room and (N, 4) quaternions in all directions."""
    turns = rng.normal(size=(num, 4))
    return rng.uniform(LOW + margin, HIGH - margin, (num, 3)), turns / np.linalg.norm(turns, axis=1, keepdims=True)
