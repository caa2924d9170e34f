"""Room-and-pillar mines: level workings on a grid, scanned or drawn as thousands of loose panels.

Rooms of one height run along x and y and leave rectangular pillars of rock between them; an adit leads in at either
end. The water is a plan times a height, so its volume and its number of pillars are known in closed form. The scan is
what plans of mines are exported as: every wall, and floor and roof between the pillars, in flat panels that share no
corner, do not quite meet, and of which some are missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from aquanav_tools.cave.cavity import from_manifold
from aquanav_tools.synthetic.damage import DamagedScan, Truth
from aquanav_tools.types import Array, Mesh


@dataclass(frozen=True)
class MineOptions:
    """One mine. Its workings fill a rectangle from the origin; its adits lie at y < 0 and beyond the far side."""

    seed: int = 0
    """Picks the pillars' sizes, and how the panels lie."""
    rooms: tuple[int, int] = (20, 33)
    """Pillars along x and y; the rooms are one more each."""
    room: float = 6.0
    """Width of the rooms, m."""
    pillar: float = 9.0
    """Largest side of a pillar, m."""
    uneven: float = 0.3
    """A pillar's sides are shorter by up to this share."""
    height: float = 6.0
    """Of all rooms, m."""
    adit: float = 12.0
    """Length of the adits, m."""
    gap: float = 0.03
    """Slits between panels, m."""
    offset: float = 0.02
    """Panels lie this far off their plane (standard deviation), m."""
    missing: float = 0.01
    """Share of the panels that are not there."""
    split: tuple[int, int] = (2, 1)
    """Panels that a wall, or a rectangle of floor or roof, is made of along each of its sides."""

    def __post_init__(self) -> None:
        if min(*self.rooms, *self.split) < 1:
            raise ValueError(f"rooms = {self.rooms} and split = {self.split} must be at least 1.")
        if not min(self.room, self.pillar, self.height, self.adit) > 0.0:
            raise ValueError("room, pillar, height and adit must be positive.")
        if not (0.0 <= self.uneven < 0.9 and 0.0 <= self.missing < 1.0):
            raise ValueError(f"uneven = {self.uneven} must be below 0.9 and missing = {self.missing} below 1.")

    @property
    def size(self) -> Array:
        """(2,) of the workings along x and y, m."""
        return np.array(self.rooms) * (self.room + self.pillar) + self.room


def pillars(options: MineOptions) -> Array:
    """Return the (P, 2, 2) lowest and highest corners of the pillars in plan, m."""
    rng = np.random.default_rng(options.seed)
    places = np.indices(options.rooms).reshape(2, -1).T
    low = options.room + places * (options.room + options.pillar)
    sides = options.pillar * (1.0 - options.uneven * rng.random((len(low), 2)))
    low = low + rng.random((len(low), 2)) * (options.pillar - sides)
    return np.stack([low, low + sides], axis=1)


def mine(options: MineOptions) -> DamagedScan:
    """Return the panels of a mine, with its water, a way from adit to adit, two open ends and a handle per pillar."""
    blocks = pillars(options)
    solid = _solid(options, blocks)
    x, length = 0.5 * options.room, options.size[1]
    way = np.array([[x, -options.adit, 0.0], [x, length + options.adit, 0.0]]) + [0.0, 0.0, 0.5 * options.height]
    truth = Truth(solid, (way,), num_portals=2, genus=len(blocks))
    return DamagedScan(_panels(options, blocks), truth)


def _adits(options: MineOptions) -> list[Array]:
    """Return the (2, 2) corners of both adits in plan, m."""
    length = options.size[1]
    return [
        np.array([[0.0, -options.adit], [options.room, 0.0]]),
        np.array([[0.0, length], [options.room, length + options.adit]]),
    ]


def _solid(options: MineOptions, blocks: Array) -> Mesh:
    """Return the water, closed."""
    import manifold3d

    def rectangle(low: Array, high: Array) -> Array:
        return np.array([low, [high[0], low[1]], high, [low[0], high[1]]])

    plan = manifold3d.CrossSection([rectangle(np.zeros(2), options.size)])
    for low, high in _adits(options):
        plan = plan + manifold3d.CrossSection([rectangle(low, high)])
    plan = plan - manifold3d.CrossSection([rectangle(*block) for block in blocks])
    return from_manifold(plan.extrude(options.height))


def _panels(options: MineOptions, blocks: Array) -> Mesh:
    """Return all panels as triangles that share no vertex between panels."""
    rng = np.random.default_rng([options.seed, 1])
    quads = np.concatenate([_walls(options, blocks), *_levels(options, blocks)])
    quads = _split(quads, options.split)
    quads = quads[rng.random(len(quads)) >= options.missing]
    middles = quads.mean(axis=1, keepdims=True)
    sizes = np.linalg.norm(quads - middles, axis=2, keepdims=True)
    normals = np.cross(quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    quads = middles + (1.0 - np.minimum(options.gap / sizes, 0.5)) * (quads - middles)
    quads = quads + (options.offset * rng.standard_normal(len(quads)))[:, None, None] * normals[:, None]
    corners = 4 * np.arange(len(quads))[:, None]
    return Mesh(quads.reshape(-1, 3), np.concatenate([corners + [0, 1, 2], corners + [0, 2, 3]]).astype(np.int64))


def _walls(options: MineOptions, blocks: Array) -> Array:
    """Return the (N, 4, 3) corners of the walls: those of pillars, of the workings' rim between them, and of adits."""
    (width, length), room = options.size, options.room
    lines = [np.stack([block[[0, 1, 1, 0], 0], block[[0, 0, 1, 1], 1]], axis=1) for block in blocks]
    walls = [np.stack([line, np.roll(line, -1, axis=0)], axis=1) for line in lines]
    across, along = (np.append(steps, end) for steps, end in zip(_steps(options), (width, length), strict=True))
    across[0] = room  # the adits lead in through the first room
    rim = [[[x, y], [end, y]] for y in (0.0, length) for x, end in pairwise(across)]
    rim += [[[x, y], [x, end]] for x in (0.0, width) for y, end in pairwise(along)]
    rim += [[[x, low[1]], [x, high[1]]] for low, high in _adits(options) for x in (0.0, room)]
    plan = np.concatenate([*walls, np.array(rim)])
    low, high = (np.concatenate([plan, np.full((*plan.shape[:2], 1), z)], axis=2) for z in (0.0, options.height))
    return np.concatenate([low, high[:, ::-1]], axis=1)


def _levels(options: MineOptions, blocks: Array) -> list[Array]:
    """Return the (N, 4, 3) corners of the rectangles that floor and roof are made of."""
    rectangles = _adits(options)
    pitch, size = options.room + options.pillar, options.size
    for block, place in zip(blocks, np.indices(options.rooms).reshape(2, -1).T, strict=True):
        cell = np.array([place * pitch, (place + 1) * pitch])
        (x0, y0), (x1, y1) = cell
        (a, c), (b, d) = block
        rectangles += [np.array([[x0, y0], [x1, c]]), np.array([[x0, d], [x1, y1]])]
        rectangles += [np.array([[x0, c], [a, d]]), np.array([[b, c], [x1, d]])]
    across, along = _steps(options)
    rectangles += [np.array([[across[-1], y], [size[0], end]]) for y, end in pairwise([*along, size[1]])]
    rectangles += [np.array([[x, along[-1]], [end, size[1]]]) for x, end in pairwise(across)]
    boxes = np.array(rectangles)
    boxes = boxes[(boxes[:, 1] - boxes[:, 0]).min(axis=1) > 0.0]
    plan = np.stack([boxes[:, [0, 1, 1, 0], 0], boxes[:, [0, 0, 1, 1], 1]], axis=2)
    return [np.concatenate([plan, np.full((*plan.shape[:2], 1), z)], axis=2) for z in (0.0, options.height)]


def _steps(options: MineOptions) -> list[Array]:
    """Return where the rooms across x, and across y, begin, m."""
    return [np.arange(float(count + 1)) * (options.room + options.pillar) for count in options.rooms]


def _split(quads: Array, counts: tuple[int, int]) -> Array:
    """Return each of (N, 4, 3) quadrangles as some smaller ones along each of its sides."""
    shares = (np.linspace(0.0, 1.0, count + 1) for count in counts)
    u, v = np.meshgrid(*shares, indexing="ij")
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=-1)
    points = np.einsum("uvc,nck->nuvk", weights, quads)
    parts = [points[:, :-1, :-1], points[:, 1:, :-1], points[:, 1:, 1:], points[:, :-1, 1:]]
    return np.stack(parts, axis=3).reshape(-1, 4, 3)
