"""What the styles draw with: winding axes, widths that swell and shrink, fallen blocks, columns, side passages."""

from __future__ import annotations

import numpy as np

from aquanav_tools.geometry.polyline import arc_lengths
from aquanav_tools.synthetic.styles.plan import Block, Column, Passage
from aquanav_tools.types import Array

STEP = 0.1
"""Distance between the stations of an axis, m."""
STRAIGHT = 2.0
"""The main axis is straight and level this far before either portal, m; a bend would lead beside the lid."""
BLOCK_FACES = 9


def axis_of(headings: Array, slopes: Array, start: Array | None = None) -> Array:
    """Return the (C, 3) axis of headings and slopes (rad) at stations STEP apart, from a (3,) start, m."""
    axis = joined(np.stack([np.cos(slopes) * np.cos(headings), np.cos(slopes) * np.sin(headings), np.sin(slopes)], 1))
    return axis if start is None else axis + start


def joined(ahead: Array) -> Array:
    """Return the (C, 3) axis that leads along (C, 3) unit vectors, STEP each, from the origin, m."""
    return np.concatenate([np.zeros((1, 3)), np.cumsum(STEP * ahead, axis=0)[:-1]])


def waves(stations: Array, period: float, rng: np.random.Generator) -> Array:
    """Return smooth noise of about unit height over (C,) stations: three sines with periods that do not repeat, m."""
    total = np.zeros(len(stations))
    for share, rate in ((0.6, 1.0), (0.45, 1.73), (0.25, 3.1)):
        rate *= rng.uniform(0.85, 1.15)
        total += share * np.sin(2.0 * np.pi * rate * stations / period + rng.uniform(0.0, 2.0 * np.pi))
    return total


def stations_of(length: float) -> Array:
    """Return the (C,) distances along a main axis of a length, from before its first portal to beyond its last, m."""
    return np.arange(-2.0 * STRAIGHT, length + 2.0 * STRAIGHT, STEP)


def faded(stations: Array, length: float, over: float = 5.0) -> Array:
    """Return (C,) shares that are 0 within STRAIGHT of both portals and 1 from `over` m behind that."""
    inside = np.minimum(stations, length - stations) - STRAIGHT
    share = np.clip(inside / min(over, 0.25 * length), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def shifted(axis: Array, stations: Array) -> Array:
    """Return the axis moved so that station 0 is the origin."""
    return np.asarray(axis - axis[np.argmin(np.abs(stations))])


def extent_of(axis: Array, stations: Array, length: float) -> float:
    """Return x at the end of the main axis, m."""
    return float(axis[np.argmin(np.abs(stations - length)), 0])


def bumps(stations: Array, places: Array, values: Array, widths: Array) -> Array:
    """Return the (C,) sum of smooth bumps of given heights and half widths (m) at given stations."""
    return np.asarray(
        sum(v * np.exp(-(((stations - p) / w) ** 2)) for p, v, w in zip(places, values, widths, strict=True))
    )


def roomy(stations: Array, opening: float, amount: float, rng: np.random.Generator) -> Array:
    """Return (C,) factors of 1 and more by which a passage is wider than at its narrowest.

    Args:
        stations: (C,) along the passage, m.
        opening: at its narrowest, m; narrow passages change over shorter ways.
        amount: by about how much the widest places are wider.
        rng: draws where these are.
    """
    return 1.0 + amount * np.clip(waves(stations, 8.0 + 5.0 * opening, rng), -1.0, 1.0) ** 2


def humps(stations: Array, length: float, every: float, size: float, rng: np.random.Generator) -> Array:
    """Return (C,) shares in [0, 1], 1 at some places: ceilings that come down, or floors that rise, with steep sides.

    Args:
        stations: (C,) along the passage, m.
        length: of the way, m.
        every: a place lies in each so many metres of it.
        size: half width of a place is 0.5 to 1.1 of this, m.
        rng: draws them.
    """
    places = spots(max(1, int(length / every)), 3.0, length - 3.0, rng)
    widths = size * rng.uniform(0.5, 1.1, len(places))
    heights = rng.uniform(0.6, 1.0, len(places))
    parts = (h * np.exp(-(((stations - p) / w) ** 4)) for p, w, h in zip(places, widths, heights, strict=True))
    return np.asarray(np.clip(sum(parts), 0.0, 1.0))


def chutes(
    stations: Array,
    length: float,
    every: float,
    steepest: float,
    rng: np.random.Generator,
    upwards: float = 0.5,
    run: tuple[float, float] = (1.0, 4.0),
) -> Array:
    """Return (C,) slopes (rad) of short steep pieces in a passage that is level elsewhere.

    Args:
        stations: (C,) along the passage, m.
        length: of the way, m.
        every: one in each so many metres is tried; in a third of them there is none.
        steepest: slope of the steepest, rad; the least steep have half of it.
        rng: draws them.
        upwards: share of those that lead up.
        run: shortest and longest, m.
    """
    slopes = np.zeros(len(stations))
    for place in spots(int((length - 8.0) / every), 4.0, length - 4.0, rng):
        half, slope = 0.5 * rng.uniform(*run), steepest * rng.uniform(0.5, 1.0)
        sign = 1.0 if rng.random() < upwards else -1.0
        if rng.random() < 0.67:
            slopes += sign * slope * np.exp(-(((stations - place) / half) ** 4))
    return np.clip(slopes, -steepest, steepest)


def kinks(length: float, run: tuple[float, float], rng: np.random.Generator) -> Array:
    """Return the (K,) stations of corners between straight legs of a passage, m.

    Args:
        length: of the way, m.
        run: shortest and longest leg, m.
        rng: draws them.
    """
    legs = rng.uniform(*run, max(1, int(length / run[0])))
    places = 0.5 * (run[0] + run[1]) + np.cumsum(legs)
    return np.asarray(places[places < length - run[0]])


def turned(stations: Array, corners: Array, most: float, edge: float, rng: np.random.Generator) -> Array:
    """Return (C,) angles that stay the same on each leg between (K,) corners, up to `most` either way, rad.

    Over `edge` m at each corner they go from one to the next.
    """
    angles = rng.uniform(-most, most, len(corners) + 1)
    places = np.stack([corners - 0.5 * edge, corners + 0.5 * edge], axis=1).ravel()
    return np.interp(stations, places, np.repeat(angles, 2)[1:-1]) if len(corners) else np.zeros(len(stations))


def spots(count: int, low: float, high: float, rng: np.random.Generator) -> Array:
    """Return places, one in the middle half of each of as many equal parts of a range."""
    borders = np.linspace(low, high, count + 1)
    return borders[:-1] + np.diff(borders) * rng.uniform(0.25, 0.75, count)


def fallen_block(centre: Array, size: float, rng: np.random.Generator) -> Block:
    """Return a block of about a size (m across): a slab along its bed, broken on all sides."""
    yaw, pitch, roll = rng.uniform(0.0, 2.0 * np.pi), rng.normal(0.0, 0.35), rng.normal(0.0, 0.35)
    along = rng.uniform(0.0, 0.5, 6) + np.arange(6) * np.pi / 3.0
    normals = np.concatenate(
        [
            [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]],
            np.stack([np.cos(along), np.sin(along), rng.normal(0.0, 0.25, 6)], axis=1),
            [[rng.normal(0.0, 0.6), rng.normal(0.0, 0.6), 1.0]],
        ]
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    c, s = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    turn = np.array([[c[0], -s[0], 0.0], [s[0], c[0], 0.0], [0.0, 0.0, 1.0]])
    turn = turn @ np.array([[c[1], 0.0, s[1]], [0.0, 1.0, 0.0], [-s[1], 0.0, c[1]]])
    turn = turn @ np.array([[1.0, 0.0, 0.0], [0.0, c[2], -s[2]], [0.0, s[2], c[2]]])
    flat = rng.uniform(0.5, 0.9)
    distances = 0.5 * size * np.concatenate([[flat, flat], rng.uniform(0.75, 1.1, 6), [rng.uniform(0.7, 0.95)]])
    return Block(np.asarray(centre, dtype=np.float64), normals @ turn.T, distances)


def blocks_on_floor(
    passage: Passage,
    count: int,
    sizes: tuple[float, float],
    lane: float,
    rng: np.random.Generator,
    range_: tuple[float, float],
) -> tuple[Block, ...]:
    """Return fallen blocks on the floor of a passage, beside a lane that stays free.

    Args:
        passage: that they lie in.
        count: how many.
        sizes: least and largest, m; small ones are more common.
        lane: from the axis, sideways, that stays free of blocks that reach as high as the axis, m.
        rng: draws them.
        range_: first and last share of the passage's stations that blocks lie at.
    """
    blocks = []
    for _ in range(count):
        n = int(rng.uniform(*range_) * (len(passage.axis) - 1))
        size = float(np.exp(rng.uniform(np.log(sizes[0]), np.log(sizes[1]))))
        floor = passage.below[n] if passage.floor is None else min(passage.floor[n], passage.below[n])
        room = passage.half_width[n]
        out = rng.uniform(-0.95, 0.95) * room
        if floor - 0.75 * size < lane:  # it would stand in the way
            out = np.sign(out) * max(abs(out), lane + 0.65 * size)
            if abs(out) > room + 0.3 * size:
                continue
        side = np.array([-np.sin(passage.heading[n]), np.cos(passage.heading[n]), 0.0])
        depth = floor * (np.sqrt(max(1.0 - (out / room) ** 2, 0.0)) if passage.floor is None else 1.0)
        blocks.append(fallen_block(passage.axis[n] + out * side + [0.0, 0.0, 0.2 * size - depth], size, rng))
    return tuple(blocks)


def columns_beside(
    passage: Passage, count: int, radii: tuple[float, float], lane: float, rng: np.random.Generator
) -> tuple[Column, ...]:
    """Return columns of rock from floor to ceiling of a passage, beside a lane that stays free (m from the axis)."""
    columns = []
    for _ in range(count):
        n = int(rng.uniform(0.12, 0.88) * (len(passage.axis) - 1))
        radius = rng.uniform(*radii)
        room = 0.85 * passage.half_width[n]
        nearest = lane + 1.5 * radius
        if nearest > room:
            continue
        out = rng.choice([-1.0, 1.0]) * rng.uniform(nearest, room)
        side = np.array([-np.sin(passage.heading[n]), np.cos(passage.heading[n]), 0.0])
        foot = passage.axis[n] + out * side - [0.0, 0.0, passage.below[n] + 0.5]
        columns.append(Column(foot, float(passage.above[n] + passage.below[n] + 1.0), radius))
    return tuple(columns)


def dead_end(
    main: Passage, share: float, length: float, size: float, rng: np.random.Generator, slope: float = 0.0
) -> Passage:
    """Return a side passage that leaves the main one, gets tighter, and ends.

    Args:
        main: passage that it leaves.
        share: of the main passage's stations, where.
        length: of the side passage, m.
        size: of its cross-section, relative to the main one's.
        rng: draws its side and bends.
        slope: rad, positive is up.
    """
    n = int(share * (len(main.axis) - 1))
    way = np.arange(0.0, length, STEP)
    turn = rng.choice([-1.0, 1.0]) * rng.uniform(0.9, 1.4)
    headings = main.heading[n] + turn + 0.4 * waves(way, 6.0, rng) * way / length
    shrink = size * np.linspace(1.0, 0.55, len(way))
    floor = None if main.floor is None else main.floor[n] * shrink
    return Passage(
        axis_of(headings, np.full(len(way), slope), main.axis[n]),
        headings,
        main.half_width[n] * shrink,
        main.above[n] * shrink,
        main.below[n] * shrink,
        main.exponent_above,
        main.exponent_below,
        floor=floor,
    )


def by_pass(main: Passage, first: int, last: int, offset: float, size: float, rng: np.random.Generator) -> Passage:
    """Return a passage beside the main one that joins it at two of its stations.

    Args:
        main: passage that it leaves and joins.
        first: station where it leaves.
        last: station where it joins.
        offset: how far it leads aside, m; its sign is the side where the main one hardly bends.
        size: of its cross-section, relative to the main one's.
        rng: draws its bends.
    """
    part = slice(first, last + 1)
    share = np.linspace(0.0, 1.0, last - first + 1)
    bow = np.sin(np.pi * share)
    # It bows from the straight line, away from where the main one bends to: beside bends it would fold.
    start, end = main.axis[first], main.axis[last]
    straight = start + share[:, None] * (end - start)
    side = np.array([start[1] - end[1], end[0] - start[0], 0.0])
    side /= max(float(np.linalg.norm(side)), 1e-9)
    bulge = float(((main.axis[part] - straight) @ side).mean())
    offset = -np.sign(bulge) * abs(offset) if abs(bulge) > 0.3 else offset
    level = rng.uniform(-0.25, 0.25) * abs(offset)
    rough = straight + bow[:, None] * offset * side
    rough[:, 2] += bow**2 * level  # it leaves level: floors that meet at an angle would cut each other
    ways = arc_lengths(rough)
    even = np.arange(0.0, ways[-1], STEP)
    axis = np.stack([np.interp(even, ways, column) for column in rough.T], axis=1)
    along = np.gradient(axis, axis=0)
    headings = np.arctan2(along[:, 1], along[:, 0])
    wide, above, below = (
        size * np.interp(even, ways, values[part]) for values in (main.half_width, main.above, main.below)
    )
    floor = None if main.floor is None else size * np.interp(even, ways, main.floor[part])
    return Passage(axis, headings, wide, above, below, main.exponent_above, main.exponent_below, floor=floor)
