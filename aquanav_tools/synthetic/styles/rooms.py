"""Styles of wide or branching caves, and of mines: chamber, maze, gallery, drift."""

from __future__ import annotations

import numpy as np

from aquanav_tools.synthetic.styles import drawing as draw
from aquanav_tools.synthetic.styles.plan import Block, Passage, Plan, Relief
from aquanav_tools.synthetic.styles.winding import laid

Rng = np.random.Generator


def breakdown_chamber(length: float, opening: float, rng: Rng) -> Plan:
    """Return chambers whose ceilings fell: domes over heaps of angular blocks, pillars, tight ways in and out."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.3, 0.6) * draw.waves(s, 30.0, rng)
    slopes = rng.uniform(0.1, 0.5) * draw.waves(s, 18.0, rng)
    slopes += draw.chutes(s, length, 12.0, rng.uniform(0.4, 0.8), rng, run=(1.0, 3.0))
    headings, axis = laid(headings, fade * slopes, s, length, 0.9 * opening + 0.5, rng)
    half = 0.5 * opening * draw.roomy(s, opening, 0.3, rng)
    count = max(1, int(length // 32))
    places = draw.spots(count, 0.1 * length, 0.9 * length, rng)
    reach = rng.uniform(0.6, 1.0, count) * min(0.2 * length / count, 2.0 + 1.6 * opening, 6.0)
    room = draw.bumps(s, places, rng.uniform(0.6, 1.0, count), reach) * fade * min(0.5 + 0.3 * opening, 1.0)
    wide = half * 1.2 + room * rng.uniform(1.8, 3.4)
    # Rubble lies in cones under where the ceiling fell.
    heap = fade * rng.uniform(0.2, 0.5) * (1.0 - draw.humps(s, length, 6.0, max(0.8 * opening, 0.7), rng))
    main = Passage(
        axis,
        headings,
        wide,
        half + room * rng.uniform(1.0, 2.6),
        half * (1.0 + heap) + 0.9 * room,
        2.2,
        2.6,
        floor=0.9 * half * (1.0 + heap) + 0.7 * room,
    )
    blocks: list[Block] = []
    for place, extent in zip(places, reach, strict=True):
        ends = tuple((place + sign * 1.1 * extent - s[0]) / (s[-1] - s[0]) for sign in (-1.0, 1.0))
        largest = min(0.5 + 0.6 * opening, 2.2)
        blocks += draw.blocks_on_floor(main, int(16.0 * extent), (0.3, largest), 0.65 * opening, rng, ends)
    blocks += draw.blocks_on_floor(main, int(length / 3.0), (0.2, 0.7), 0.7 * opening, rng, (0.08, 0.92))
    columns = draw.columns_beside(main, 2 * count, (0.35, 0.8), 0.9 * opening, rng)
    relief = Relief(swell=0.1, joints=0.16, ledges=0.08, bed=0.8, grain=0.06, floor=0.25)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, tuple(blocks), columns)


def maze(length: float, opening: float, rng: Rng) -> Plan:
    """Return fissures along two directions of joints: corners, ways that part and join again, dead ends."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length, 2.5)
    corner, angle = rng.uniform(4.5, 7.5), rng.uniform(0.5, 0.8)
    borders = np.cumsum(corner * rng.uniform(0.6, 1.5, int(2.5 * length / corner)))
    sides = np.where(np.arange(len(borders) + 1) % 2 == 0, 1.0, -1.0) * rng.choice([-1.0, 1.0])
    # Joints are straight, and corners take about a metre.
    turns = np.interp(s, s, sides[np.searchsorted(borders, s)] * angle)
    headings = fade * np.convolve(np.pad(turns, 6, mode="edge"), np.ones(13) / 13.0, mode="valid")
    slopes = rng.uniform(0.05, 0.4) * draw.waves(s, 15.0, rng)
    slopes += draw.chutes(s, length, 15.0, rng.uniform(0.3, 0.7), rng, run=(0.8, 2.0))
    headings, axis = laid(headings, fade * slopes, s, length, 0.9 * opening + 0.5, rng)
    half = 0.5 * opening * draw.roomy(s, opening, 0.3, rng)
    tall = half * (1.25 + 0.4 * draw.waves(s, 11.0, rng) ** 2)
    high = tall * (1.0 + 0.4 * fade * (1.0 - draw.humps(s, length, 8.0, max(0.7 * opening, 0.6), rng)))
    main = Passage(axis, headings, half, high, tall, 2.4, 2.8, floor=0.85 * tall)
    branches, step = [], 14.0 + 6.0 * opening
    for number, place in enumerate(draw.spots(max(1, int((length - 8.0) // step)), 4.0, length - 4.0, rng)):
        first, last = (int((place + sign * (4.0 + 2.0 * opening) - s[0]) / draw.STEP) for sign in (-1.0, 1.0))
        offset = rng.choice([-1.0, 1.0]) * (2.6 * half.max() + 1.5)
        if number % 3 != 2:
            branches.append(draw.by_pass(main, max(first, 60), min(last, len(s) - 61), offset, 0.9, rng))
    ends = draw.spots(max(1, int(length // 14)), 0.15, 0.85, rng)
    branches += [draw.dead_end(main, share, rng.uniform(3.0, 7.0), 0.9, rng) for share in ends]
    blocks = draw.blocks_on_floor(main, int(length / 5.0), (0.2, 0.5), 0.7 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.09, joints=0.08, ledges=0.07, bed=0.6, grain=0.05, floor=0.12)
    return Plan((main, *branches), draw.extent_of(axis, s, length), opening, relief, blocks)


def flooded_gallery(length: float, opening: float, rng: Rng) -> Plan:
    """Return a wide gallery: flat sand, domed ceiling, columns of dripstone, slabs from the ceiling."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.25, 0.5) * draw.waves(s, rng.uniform(35.0, 60.0), rng)
    slopes = 0.06 * draw.waves(s, 30.0, rng) + draw.chutes(s, length, 25.0, rng.uniform(0.2, 0.6), rng, run=(3.0, 8.0))
    headings, axis = laid(headings, fade * slopes, s, length, 1.1 * opening, rng)
    half = 0.5 * opening * np.exp(0.18 * draw.waves(s, 20.0, rng) ** 2)
    wide = half * rng.uniform(1.2, 1.8) * np.exp(0.15 * draw.waves(s, 14.0, rng))
    main = Passage(axis, headings, wide, half, half * 1.1, 2.2, 2.6, floor=0.8 * half)
    columns = draw.columns_beside(main, int(length / 5.0), (0.15, 0.5), 0.45 * opening, rng)
    blocks = draw.blocks_on_floor(main, int(length / 3.0), (0.3, 1.6), 0.4 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.22, ledges=0.14, bed=1.0, scallops=0.08, scallop_length=1.2, joints=0.08, floor=0.3)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks, columns)


def mine_drift(length: float, opening: float, rng: Rng) -> Plan:
    """Return a flooded drift: an arch over a flat floor, straight between corners, crosscuts, rock that fell."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length, 2.0)
    borders = np.cumsum(rng.uniform(7.0, 20.0, int(length / 7.0) + 3))
    angles = np.append(0.0, rng.choice([-1.0, 1.0], len(borders)) * rng.uniform(0.2, 0.8, len(borders)))
    turns = angles[np.searchsorted(borders, s)]
    headings = fade * np.convolve(np.pad(turns, 7, mode="edge"), np.ones(15) / 15.0, mode="valid")
    # Drifts are level, for carts; inclines lead from one level to the next.
    slopes = 0.005 + draw.chutes(s, length, 30.0, rng.uniform(0.3, 0.75), rng, run=(4.0, 14.0))
    headings, axis = laid(headings, fade * slopes, s, length, 0.7 * opening + 0.5, rng)
    half = 0.5 * opening * (1.05 + 0.06 * draw.waves(s, 5.0, rng) ** 2)
    main = Passage(axis, headings, half, 1.1 * half, 1.0 * half, 2.4, 9.0, floor=0.97 * half)
    sides = [
        draw.dead_end(main, share, rng.uniform(3.0, 9.0), 0.9, rng)
        for share in draw.spots(1 + int(length // 30), 0.15, 0.85, rng)
    ]
    if length > 45.0:
        middle = len(s) // 2
        run = int((5.0 + 2.0 * opening) / draw.STEP)
        offset = rng.choice([-1.0, 1.0]) * (2.4 * half.max() + 1.8)
        sides.append(draw.by_pass(main, middle - run, middle + run, offset, 0.92, rng))
    blocks = draw.blocks_on_floor(main, int(length / 2.5), (0.2, 0.7), 0.65 * opening, rng, (0.08, 0.92))
    relief = Relief(swell=0.06, joints=0.14, grain=0.06, floor=0.08)
    return Plan((main, *sides), draw.extent_of(axis, s, length), opening, relief, blocks)
