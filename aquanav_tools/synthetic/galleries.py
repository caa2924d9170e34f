"""Caves that are made up: winding galleries with chambers, squeezes, forks that join again and dead ends.

A gallery is drawn as balls along a curve, whose radius swells and shrinks; all galleries together are one body of
water, with rock relief, and sediment on the floor where a gallery is wide enough. The curves that rock was carved along
are known, and nothing is drawn but from the options and their seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.geometry.polyline import arc_lengths
from aquanav_tools.synthetic.caves import SyntheticCave, closed_surface, one_water_body, without
from aquanav_tools.synthetic.noise import fractal
from aquanav_tools.types import Array

Float32Array = npt.NDArray[np.float32]

STEP = 0.2
"""Distance between the balls of a gallery, m."""
MARGIN = 1.2
"""Rock around the galleries that is looked at, m; the relief stays below it."""
RELIEF_RADIUS = 1.6
"""Radius at which the relief has its full height, m."""
FLOOR = 0.62
"""Sediment lies this share of the radius below the middle."""
MIN_PILLAR = 1.2
"""Rock between a gallery and its by-pass, m."""
_UNLIMITED = 1e9


@dataclass(frozen=True)
class GalleryOptions:
    """One cave. Its main gallery runs along x, from the opening at 0 to the one at `length`."""

    seed: int
    """Picks the cave."""
    length: float
    """Distance between the two openings, m."""
    radius: float
    """Mean radius of the main gallery, m."""
    winding: float = 2.0
    """Sideways swing of the main gallery, m."""
    rise: float = 1.0
    """Its swing up and down, m."""
    swings: float = 2.0
    """How often it swings to and fro."""
    chambers: int = 0
    """Places where it widens."""
    chamber_radius: float = 3.0
    """Radius there, m."""
    narrows: int = 0
    """Places where it is tight."""
    narrow_radius: float = 0.8
    """Radius there, m."""
    loops: int = 0
    """By-passes, which leave the main gallery and join it again."""
    dead_ends: int = 0
    """Galleries that lead nowhere."""
    voxel: float = 0.12
    """Spacing of the grid the surface is sampled on, m."""

    def __post_init__(self) -> None:
        for name in ("length", "radius", "chamber_radius", "narrow_radius", "swings"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)} must be positive.")
        for name in ("winding", "rise", "chambers", "narrows", "loops", "dead_ends"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} = {getattr(self, name)} must not be negative.")
        if not 0.0 < self.voxel <= min(self.radius, self.narrow_radius) / 4.0:
            raise ValueError(f"voxel = {self.voxel} must be above 0 and at most a quarter of the narrowest radius.")


@dataclass(frozen=True, eq=False)
class Gallery:
    """Balls along a curve."""

    axis: Array
    """(C, 3) m."""
    radii: Array
    """(C,) m."""


def galleries(options: GalleryOptions) -> list[Gallery]:
    """Return the curves of a cave, the main one first; it is straight beyond both openings."""
    rng = np.random.default_rng(options.seed)
    main = _main(options, rng)
    spots = _spots(options.loops + options.dead_ends, options.length, rng)
    branches = [_by_pass(main, spot, options, rng) for spot in spots[: options.loops]]
    branches += [_dead_end(main, spot, options, rng) for spot in spots[options.loops :]]
    return [main, *branches]


def gallery_cave(options: GalleryOptions) -> SyntheticCave:
    """Return the cave, with openings at x = 0 and x = length.

    Raises:
        ValueError: its galleries leave the space between the openings, or are so tight that the water parts.
    """
    parts = galleries(options)
    for branch in parts[1:]:
        if (branch.axis[:, 0] - branch.radii).min() < MARGIN or (branch.axis[:, 0] + branch.radii).max() > (
            options.length - MARGIN
        ):
            raise ValueError("A gallery leads out between the openings. Choose another seed or a longer cave.")
    axes = _grid(options, parts)
    distance, floor, scale = _balls(parts, axes)
    field = one_water_body(_with_rock(distance, floor, scale, *axes, options.seed))
    truth = closed_surface(field, axes)
    ends = (0.0, float(axes[0][-1]))
    is_lid = np.any([np.all(np.abs(truth.triangles[..., 0] - x) < 1e-4, axis=1) for x in ends], axis=0)
    main = parts[0].axis
    inside = (main[:, 0] >= 0.0) & (main[:, 0] <= options.length)
    if not all((np.abs(truth.vertices[:, 0] - x) < 1e-4).any() for x in ends):
        raise ValueError("The water does not reach both openings. Choose another seed or larger radii.")
    return SyntheticCave(truth, without(truth, is_lid), main[inside])


def _main(options: GalleryOptions, rng: np.random.Generator) -> Gallery:
    overshoot = 2.0 * options.chamber_radius
    x = np.arange(-overshoot, options.length + overshoot, 0.05)
    along = np.clip(x / options.length, 0.0, 1.0)
    fade = np.sin(np.pi * along) ** 0.5 * np.where((along > 0.0) & (along < 1.0), 1.0, 0.0)
    fade = np.minimum(fade, np.minimum(along, 1.0 - along) * options.length / (2.0 * options.radius)).clip(0.0, 1.0)
    fade = fade * fade * (3.0 - 2.0 * fade)  # level and straight ahead at the openings
    y, z = np.zeros_like(x), np.zeros_like(x)
    for part, share in ((1.0, 0.75), (1.7, 0.35), (2.9, 0.12)):
        turns = 2.0 * np.pi * options.swings * part * along
        y += options.winding * share * np.sin(turns + rng.uniform(0.0, 2.0 * np.pi))
        z += options.rise * share * np.sin(0.8 * turns + rng.uniform(0.0, 2.0 * np.pi))
    axis = _resampled(np.stack([x, fade * y, fade * z], axis=1))
    radii = options.radius * (1.0 + 0.12 * np.sin(1.3 * axis[:, 0] + rng.uniform(0, 6)))
    rooms = [options.chamber_radius] * options.chambers + [options.narrow_radius] * options.narrows
    for spot, room in zip(_spots(len(rooms), options.length, rng), rng.permutation(rooms), strict=True):
        width = max(1.2 * room, 1.5)
        share = np.exp(-(((axis[:, 0] - spot) / width) ** 2))
        radii = radii + share * (room - radii)
    return Gallery(axis, radii)


def _spots(count: int, length: float, rng: np.random.Generator) -> Array:
    """Return places along x, one in each of as many equal parts of the middle of the cave, in random order, m."""
    borders = np.linspace(0.18, 0.82, count + 1) * length
    return rng.permutation([rng.uniform(0.65 * a + 0.35 * b, 0.35 * a + 0.65 * b) for a, b in pairwise(borders)])


def _by_pass(main: Gallery, spot: float, options: GalleryOptions, rng: np.random.Generator) -> Gallery:
    """Return a gallery beside the main one, with a pillar between them."""
    radius = 0.75 * options.radius
    half = 4.0 * options.radius + 2.0
    first, last = np.searchsorted(main.axis[:, 0], [spot - half, spot + half])
    part = main.axis[first:last]
    ahead = (part[-1] - part[0]) * [1.0, 1.0, 0.0]
    side = rng.choice([-1.0, 1.0]) * np.cross(ahead / np.linalg.norm(ahead), [0.0, 0.0, 1.0])
    share = np.linspace(0.0, 1.0, len(part))
    straight = part[0] + share[:, None] * (part[-1] - part[0])
    offset = ((part - straight) @ side).max() + main.radii[first:last].max() + radius + MIN_PILLAR
    lift = rng.uniform(-0.4, 0.4) * options.radius
    bow = np.sin(np.pi * share)[:, None]
    axis = _resampled(straight + bow * (offset * side + [0.0, 0.0, lift]))
    return Gallery(axis, np.full(len(axis), radius))


def _dead_end(main: Gallery, spot: float, options: GalleryOptions, rng: np.random.Generator) -> Gallery:
    """Return a gallery that leads aside and gets lower and narrower to its end."""
    start = main.axis[np.searchsorted(main.axis[:, 0], spot)]
    length = rng.uniform(4.0, 6.0) * options.radius
    side, way = rng.choice([-1.0, 1.0]), np.arange(0.0, length, STEP)
    turn = rng.uniform(0.15, 0.45) * np.sin(way / length * np.pi)
    axis = start + np.stack([way * np.sin(turn), side * way * np.cos(turn), -0.12 * way], axis=1)
    return Gallery(axis, options.radius * np.linspace(0.8, 0.5, len(axis)))


def _resampled(curve: Array) -> Array:
    ways = arc_lengths(curve)
    stations = np.arange(0.0, ways[-1], STEP)
    return np.stack([np.interp(stations, ways, column) for column in curve.T], axis=1)


def _grid(options: GalleryOptions, parts: list[Gallery]) -> tuple[Array, Array, Array]:
    low = np.min([(part.axis - part.radii[:, None]).min(axis=0) for part in parts], axis=0) - MARGIN
    high = np.max([(part.axis + part.radii[:, None]).max(axis=0) for part in parts], axis=0) + MARGIN
    x = np.linspace(0.0, options.length, round(options.length / options.voxel) + 1)
    y, z = (np.arange(low[axis], high[axis], options.voxel) for axis in (1, 2))
    return x, y, z


def _balls(parts: list[Gallery], axes: tuple[Array, Array, Array]) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Return (X, Y, Z) distances to all balls together, negative inside; the floor's height and the radius there."""
    shape = tuple(len(axis) for axis in axes)
    distance, floor, scale = (np.full(shape, value, np.float32) for value in (MARGIN, 0.0, RELIEF_RADIUS))
    for part in parts:
        _carve(distance, floor, scale, *axes, part.axis, part.radii)
    return distance, floor, scale


@numba.njit(cache=True)
def _carve(distance, floor, scale, xs, ys, zs, axis, radii):  # type: ignore[no-untyped-def]
    """Write the balls of one gallery into the grid, each as far as its margin."""
    steps = xs[1] - xs[0], ys[1] - ys[0], zs[1] - zs[0]
    for c in range(len(axis)):
        reach = radii[c] + MARGIN
        bounds = np.empty((3, 2), np.int64)
        for k in range(3):
            first = (xs[0], ys[0], zs[0])[k]
            size = (len(xs), len(ys), len(zs))[k]
            bounds[k, 0] = max(0, int(np.floor((axis[c, k] - reach - first) / steps[k])))
            bounds[k, 1] = min(size, int(np.ceil((axis[c, k] + reach - first) / steps[k])) + 1)
        for i in range(bounds[0, 0], bounds[0, 1]):
            for j in range(bounds[1, 0], bounds[1, 1]):
                for k in range(bounds[2, 0], bounds[2, 1]):
                    dx, dy, dz = xs[i] - axis[c, 0], ys[j] - axis[c, 1], zs[k] - axis[c, 2]
                    away = np.sqrt(dx * dx + dy * dy + dz * dz) - radii[c]
                    if away < distance[i, j, k]:
                        distance[i, j, k] = away
                        floor[i, j, k] = axis[c, 2] - FLOOR * radii[c]
                        scale[i, j, k] = radii[c]


@numba.njit(cache=True, parallel=True)
def _with_rock(distance, floor, scale, xs, ys, zs, seed):  # type: ignore[no-untyped-def]
    """Return the field with relief on its walls, smaller in tight places, and a floor of sediment."""
    field = np.empty_like(distance)
    for i in numba.prange(len(xs)):
        for j in range(len(ys)):
            for k in range(len(zs)):
                wall = distance[i, j, k]
                if abs(wall) < MARGIN:
                    size = min(scale[i, j, k] / RELIEF_RADIUS, 1.0)
                    x, y, z = xs[i], ys[j], zs[k]
                    wall += size * 0.26 * fractal(x, y, z, 0.55, 2, 0.5, _UNLIMITED, seed)
                    wall += size * 0.16 * (abs(fractal(x, y, 1.6 * z, 0.9, 3, 0.5, _UNLIMITED, seed + 30)) - 0.3)
                    wall += size * 0.035 * fractal(x, y, z, 2.0, 2, 0.5, _UNLIMITED, seed + 20)
                    rise = 0.14 * size * fractal(x, y, z, 0.8, 3, 0.5, _UNLIMITED, seed + 40)
                    ground = floor[i, j, k] + rise - z
                    blend = max(0.2 - abs(wall - ground), 0.0) / 0.2  # sediment meets rock in a fillet, not an edge
                    wall = max(wall, ground) + 0.05 * blend * blend
                field[i, j, k] = wall
    return field
