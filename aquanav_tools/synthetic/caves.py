"""Caves made of formulas: a rough, winding passage for the demo, and smooth ones whose volume is known exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.synthetic.noise import fractal
from aquanav_tools.types import Array, BoolArray, Mesh

_UNLIMITED = 1e9
_MARGIN = 1.2
"""Rock kept around the passage's nominal wall, m; the relief stays below it."""


@dataclass(frozen=True, eq=False)
class SyntheticCave:
    """A passage open at both ends, and the closed surface it was cut from."""

    truth: Mesh
    """Closed: wall and the two flat lids, normals out of the water."""
    mesh: Mesh
    """The wall alone, open at both ends, normals out of the water."""
    centreline: Array
    """(C, 3) from the middle of one opening to the middle of the other, m."""


@dataclass(frozen=True)
class CaveOptions:
    """The demo cave: a passage along +x that winds sideways and up and down, with sediment on its floor."""

    seed: int = 0
    """Picks the cave."""
    length: float = 9.0
    """Distance between the two openings, m."""
    radius: float = 1.6
    """Mean radius of the passage, m; it varies by a quarter."""
    winding: float = 1.6
    """Sideways swing of the centreline, m."""
    voxel: float = 0.05
    """Spacing of the grid the surface is sampled on, m."""

    def __post_init__(self) -> None:
        if self.length <= 0 or self.winding < 0:
            raise ValueError(f"A cave needs length > 0 and winding >= 0, got {self.length} and {self.winding}.")
        if not 0 < self.voxel <= self.radius / 4:
            raise ValueError(f"voxel = {self.voxel} must be above 0 and at most a quarter of the radius {self.radius}.")


def demo_cave(options: CaveOptions = CaveOptions()) -> SyntheticCave:
    """Return a rough passage of about `options.length` with openings at x = 0 and x = length."""
    centreline, radii = _passage(options)
    axes = _grid_axes(options, centreline)
    field = _rock_field(*axes, centreline, radii, options.seed)
    truth = closed_surface(one_water_body(field), axes)
    ends = (0.0, float(axes[0][-1]))
    is_lid = np.any([np.all(np.abs(truth.triangles[..., 0] - x) < 1e-4, axis=1) for x in ends], axis=0)
    between = (centreline[:, 0] >= 0.0) & (centreline[:, 0] <= ends[1])
    return SyntheticCave(truth, without(truth, is_lid), centreline[between])


def tube(radius: float = 2.0, length: float = 20.0, sections: int = 64, rings: int = 81) -> SyntheticCave:
    """Return a straight tube along +x from the origin; volume pi * radius^2 * length as `sections` grows."""
    centreline = np.zeros((rings, 3))
    centreline[:, 0] = np.linspace(0.0, length, rings)
    return sweep(centreline, radius, sections)


def bend(
    radius: float = 1.5, bend_radius: float = 6.0, angle: float = np.pi / 2, sections: int = 64, rings: int = 81
) -> SyntheticCave:
    """Return a tube bent to the left by `angle`, starting at the origin along +x.

    Its volume tends to pi * radius^2 * bend_radius * angle (Pappus) as `sections` and `rings` grow.
    """
    turn = np.linspace(0.0, angle, rings)
    centreline = bend_radius * np.stack([np.sin(turn), 1.0 - np.cos(turn), np.zeros(rings)], axis=1)
    return sweep(centreline, radius, sections)


def sweep(centreline: Array, radius: float, sections: int) -> SyntheticCave:
    """Return a tube of circular sections around a (C, 3) curve that is nowhere vertical."""
    ahead = np.gradient(centreline, axis=0, edge_order=2)
    side = np.cross([0.0, 0.0, 1.0], ahead)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(ahead, side)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    angles = np.linspace(0.0, 2.0 * np.pi, sections, endpoint=False)[None, :, None]
    wall = centreline[:, None] + radius * (np.cos(angles) * side[:, None] + np.sin(angles) * up[:, None])
    vertices = np.concatenate([wall.reshape(-1, 3), centreline[[0, -1]]])
    faces, is_lid = _tube_faces(len(centreline), sections)
    truth = Mesh(vertices, faces)
    return SyntheticCave(truth, without(truth, is_lid), centreline)


def _tube_faces(rings: int, sections: int) -> tuple[npt.NDArray[np.int64], BoolArray]:
    """Return the faces of a tube of `rings` rings with a fan at either end, and which of them are in the fans."""
    index = np.arange(rings * sections).reshape(rings, sections)
    here, there = index[:-1], index[1:]
    here_next, there_next = np.roll(here, -1, axis=1), np.roll(there, -1, axis=1)
    quads = [np.stack([here, here_next, there_next], axis=-1), np.stack([here, there_next, there], axis=-1)]
    wall = np.concatenate(quads).reshape(-1, 3)
    first, last = np.full(sections, rings * sections), np.full(sections, rings * sections + 1)
    start = np.stack([first, np.roll(index[0], -1), index[0]], axis=1)
    end = np.stack([last, index[-1], np.roll(index[-1], -1)], axis=1)
    faces = np.concatenate([wall, start, end]).astype(np.int64)
    return faces, np.arange(len(faces)) >= len(wall)


def without(mesh: Mesh, is_dropped: BoolArray) -> Mesh:
    """Return the mesh without some faces and the vertices that only they used."""
    kept, inverse = np.unique(mesh.faces[~is_dropped], return_inverse=True)
    return Mesh(mesh.vertices[kept], inverse.reshape(-1, 3).astype(np.int64))


def _passage(options: CaveOptions) -> tuple[Array, Array]:
    """Return the (C, 3) centreline, straight on beyond both openings, and the (C,) radii."""
    rng = np.random.default_rng(options.seed)
    side, rise = rng.choice([-1.0, 1.0], 2) * rng.uniform(0.85, 1.0, 2)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    overshoot = 2.0 * options.radius
    x = np.arange(-overshoot, options.length + overshoot, 0.05)
    along = np.clip(x / options.length, 0.0, 1.0)
    # One and a half waves and one wave: level and straight ahead at both openings.
    y = side * options.winding * 0.5 * (1.0 - np.cos(3.0 * np.pi * along))
    z = rise * 0.3 * options.winding * (1.0 - np.cos(2.0 * np.pi * along))
    radii = options.radius * (1.0 + 0.15 * np.sin(1.1 * x + phase) + 0.1 * np.sin(2.3 * x - phase))
    return np.stack([x, y, z], axis=1), radii


def _grid_axes(options: CaveOptions, centreline: Array) -> tuple[Array, Array, Array]:
    reach = 1.25 * options.radius + _MARGIN
    low, high = centreline[:, 1:].min(axis=0) - reach, centreline[:, 1:].max(axis=0) + reach
    x = np.linspace(0.0, options.length, round(options.length / options.voxel) + 1)
    y, z = (np.arange(a, b, options.voxel) for a, b in zip(low, high, strict=True))
    return x, y, z


@numba.njit(cache=True, parallel=True)
def _rock_field(xs, ys, zs, centreline, radii, seed):  # type: ignore[no-untyped-def]
    """Return (X, Y, Z) values, negative in water, about the distance to the wall near it."""
    field = np.empty((len(xs), len(ys), len(zs)), np.float32)
    step = centreline[1, 0] - centreline[0, 0]
    reach = int(2.0 * radii.max() / step)
    for i in numba.prange(len(xs)):
        middle = int((xs[i] - centreline[0, 0]) / step)
        first, last = max(0, middle - reach), min(len(centreline), middle + reach + 1)
        level = centreline[middle, 2] - 0.62 * radii[middle]
        for j in range(len(ys)):
            for k in range(len(zs)):
                field[i, j, k] = _rock_at(xs[i], ys[j], zs[k], centreline[first:last], radii[first:last], level, seed)
    return field


@numba.njit(cache=True)
def _rock_at(x, y, z, centreline, radii, level, seed):  # type: ignore[no-untyped-def]
    """Return one value of the field: a rough tube, cut by a floor of sediment at about z = level."""
    wall = 1e9
    for c in range(len(centreline)):
        dx, dy, dz = x - centreline[c, 0], y - centreline[c, 1], z - centreline[c, 2]
        wall = min(wall, np.sqrt(dx * dx + dy * dy + dz * dz) - radii[c])
    if abs(wall) > _MARGIN:
        return wall
    boulders = 0.26 * fractal(x, y, z, 0.55, 2, 0.5, _UNLIMITED, seed)
    ledges = 0.16 * (abs(fractal(x, y, 1.6 * z, 0.9, 3, 0.5, _UNLIMITED, seed + 30)) - 0.3)
    grain = 0.035 * fractal(x, y, z, 4.0, 2, 0.5, _UNLIMITED, seed + 20)
    wall += boulders + ledges + grain
    floor = level + 0.14 * fractal(x, y, z, 0.8, 3, 0.5, _UNLIMITED, seed + 40) + 0.5 * grain - z
    blend = max(0.2 - abs(wall - floor), 0.0) / 0.2  # sediment meets rock in a fillet, not an edge
    return max(wall, floor) + 0.05 * blend * blend


def one_water_body(field: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the field with stray pockets of water filled and floating rock removed."""
    from scipy import ndimage

    for sign in (1.0, -1.0):
        pieces, count = ndimage.label(sign * field < 0.0)
        if count > 1:
            sizes = np.bincount(pieces.ravel())
            sizes[0] = 0
            stray = (pieces > 0) & (pieces != sizes.argmax())
            field = np.where(stray, sign * np.abs(field) + sign * 1e-3, field).astype(np.float32)
    return field


def closed_surface(field: npt.NDArray[np.float32], axes: tuple[Array, Array, Array]) -> Mesh:
    """Return the surface of the water, closed by flat lids where the water meets the grid's border."""
    from skimage.measure import marching_cubes

    # Solid rock outside puts a lid within a millionth of a cell of the border; no sample may lie on the level.
    nudged = np.where(np.abs(field) < 1e-4, 1e-4, field).astype(np.float64)
    padded = np.pad(nudged, 1, constant_values=1e6)
    spacing = tuple(float(axis[1] - axis[0]) for axis in axes)
    vertices, faces, _, _ = marching_cubes(padded, 0.0, spacing=spacing, gradient_direction="descent")
    origin = np.array([axis[0] for axis in axes]) - spacing
    return Mesh(vertices + origin, faces.astype(np.int64))
