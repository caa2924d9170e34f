"""Styles of caves that water made: tube, canyon, bedding plane, shaft and ramp, fault, sumps.

The forms are those of textbooks (Palmer, Cave Geology, 2007; Ford and Williams, Karst Hydrogeology and Geomorphology,
2007, chapter 7); sizes are chosen to span 2 to 20 widths of a BlueROV2.
"""

from __future__ import annotations

import numpy as np

from aquanav_tools.synthetic.styles import drawing as draw
from aquanav_tools.synthetic.styles.plan import Passage, Plan, Relief
from aquanav_tools.synthetic.styles.winding import laid, laid_in_fault

Rng = np.random.Generator


def phreatic_tube(length: float, opening: float, rng: Rng) -> Plan:
    """Return a tube that formed under water: elliptical, in loops up and down, with bells in its ceiling, scalloped."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.5, 0.9) * draw.waves(s, rng.uniform(14.0, 26.0) + 2.0 * opening, rng)
    steep = rng.uniform(0.1, 0.3) if rng.random() < 0.5 else rng.uniform(0.3, 0.9)
    slopes = steep * draw.waves(s, rng.uniform(10.0, 22.0) + 2.0 * opening, rng)
    slopes += draw.chutes(s, length, 16.0, rng.uniform(0.4, 0.87), rng, run=(1.5, 2.5 + opening))
    headings, axis = laid(headings, fade * np.clip(slopes, -1.2, 1.2), s, length, 0.8 * opening, rng)
    swell = draw.roomy(s, opening, rng.uniform(0.15, 0.5), rng)
    rooms = draw.spots(int(length // 25), 6.0, length - 6.0, rng)
    if len(rooms):
        swell += draw.bumps(s, rooms, rng.uniform(0.2, 0.7, len(rooms)), rng.uniform(1.0, 2.0, len(rooms)) * opening)
    half = 0.5 * opening * swell
    wide = 1.0 + 0.5 * np.clip(draw.waves(s, 10.0 + 3.0 * opening, rng), 0.0, 1.0)
    bells = rng.uniform(0.1, 0.5) * draw.humps(s, length, 12.0, 0.7 * opening, rng)
    main = Passage(axis, headings, half * wide, half * (1.0 + fade * bells), half)
    sides = tuple(
        draw.dead_end(main, share, rng.uniform(3.0, 6.0), 0.75, rng, rng.uniform(-0.3, 0.3))
        for share in draw.spots(int(rng.integers(0, 2 + int(length // 60))), 0.2, 0.8, rng)
    )
    blocks = draw.blocks_on_floor(main, int(length / 8.0), (0.2, 0.5), 0.7 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.12, scallops=0.08, scallop_length=rng.uniform(0.4, 0.9), grain=0.05)
    return Plan((main, *sides), draw.extent_of(axis, s, length), opening, relief, blocks)


def vadose_canyon(length: float, opening: float, rng: Rng) -> Plan:
    """Return a canyon that a stream cut: narrow, high, meandering, with steps down, swinging walls and ledges."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.7, 1.1) * draw.waves(s, rng.uniform(8.0, 13.0) + opening, rng)
    slopes = -rng.uniform(0.02, 0.3) + rng.uniform(0.05, 0.2) * draw.waves(s, 20.0, rng)
    slopes += draw.chutes(s, length, 11.0, rng.uniform(0.5, 0.87), rng, upwards=0.1, run=(0.8, 2.5))
    headings, axis = laid(headings, fade * slopes, s, length, 1.2 * opening, rng)
    half = 0.5 * opening * draw.roomy(s, opening, rng.uniform(0.2, 0.5), rng)
    tall = min(max(opening * rng.uniform(2.2, 5.5), 1.5), 7.0) * np.exp(0.12 * draw.waves(s, 18.0, rng))
    low = 0.45 * fade * draw.humps(s, length, 14.0, max(opening, 0.8), rng)
    tall = np.maximum(tall, 2.6 * half)
    lean = fade * 0.3 * np.minimum(half, 0.8) * (1.0 + 0.6 * draw.waves(s, 12.0, rng))
    above = np.maximum(0.45 * tall * (1.0 - low), 1.1 * half)
    main = Passage(axis, headings, half, above, 0.55 * tall, 2.6, 3.2, lean, rng.uniform(2.5, 4.5), 0.5 * tall)
    blocks = draw.blocks_on_floor(main, int(length / 3.0), (0.2, 0.8), 0.7 * opening, rng, (0.08, 0.92))
    relief = Relief(swell=0.1, ledges=0.16, bed=rng.uniform(0.45, 0.9), scallops=0.06, dip=(0.05, 0.08), floor=0.1)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks)


def bedding_plane(length: float, opening: float, rng: Rng) -> Plan:
    """Return a low, wide passage along a tilted bed: its ceiling comes down in places, pillars, slabs on its floor."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.3, 0.6) * draw.waves(s, rng.uniform(22.0, 40.0), rng)
    slopes = rng.uniform(-0.6, 0.6) + 0.06 * draw.waves(s, 12.0, rng)
    slopes += draw.chutes(s, length, 14.0, rng.uniform(0.3, 0.7), rng, run=(0.8, 2.0))
    headings, axis = laid(headings, fade * slopes, s, length, min(1.5 * opening + 0.5, 3.0), rng)
    half = 0.5 * opening * draw.roomy(s, opening, 0.3, rng)
    wide = min(max(opening * rng.uniform(1.2, 2.6), 1.0), 4.2) * np.exp(0.3 * draw.waves(s, 13.0, rng))
    wide = np.maximum(wide, 1.8 * half)
    high = half * (1.0 + fade * rng.uniform(0.2, 0.5) * (1.0 - draw.humps(s, length, 7.0, 0.8, rng)))
    deep = half * (1.0 + fade * rng.uniform(0.1, 0.4) * (1.0 - draw.humps(s, length, 9.0, 0.8, rng)))
    main = Passage(axis, headings, wide, high, deep, 3.5, 3.0, floor=0.92 * deep)
    columns = draw.columns_beside(main, int(length / 4.0), (0.2, 0.55), 0.75 * opening, rng)
    blocks = draw.blocks_on_floor(main, int(length / 3.0), (0.2, 0.7), 0.75 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.1, ledges=0.1, bed=rng.uniform(0.3, 0.45), grain=0.05, floor=0.1, dip=(0.03, -0.1))
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks, columns)


def shaft_ramp(length: float, opening: float, rng: Rng) -> Plan:
    """Return level stretches joined by upright shafts and steep ramps, down and up again."""
    s = draw.stations_of(length)
    slopes, headings = np.zeros(len(s)), np.zeros(len(s))
    place, sign = 4.0, -1.0
    while place + 11.0 < length - 3.0:
        run = float(min(rng.uniform(5.0, 16.0), length - 7.0 - place))
        steep = rng.uniform(1.25, 1.5) if rng.random() < 0.4 else rng.uniform(0.5, 0.95)
        edge = 1.2 + 0.4 * opening
        share = np.clip((s - place) / edge, 0.0, 1.0) * np.clip((place + run - s) / edge, 0.0, 1.0)
        slopes += sign * steep * share * share * (3.0 - 2.0 * share)
        place += run + rng.uniform(4.0, 9.0)
        sign = -sign if rng.random() < 0.75 else sign
    level = np.cos(slopes) ** 2 * draw.faded(s, length)
    headings = draw.faded(s, length) * rng.uniform(0.4, 0.9) * draw.waves(s, 24.0, rng)
    headings, axis = laid(headings, slopes, s, length, 0.9 * opening, rng)
    half = 0.5 * opening * (draw.roomy(s, opening, 0.3, rng) + rng.uniform(0.0, 0.35) * (1.0 - level))
    low = 0.3 * level * (1.0 - draw.humps(s, length, 10.0, 0.7 * opening, rng))
    main = Passage(axis, headings, half * 1.15, half * (1.0 + low), half)
    blocks = draw.blocks_on_floor(main, int(length / 6.0), (0.2, 0.6), 0.7 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.15, ledges=0.1, bed=0.8, joints=0.08, grain=0.05)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks)


def fault_fissure(length: float, opening: float, rng: Rng) -> Plan:
    """Return a fissure along a steep fault that winds within it: limbs lie one above the other, joined by hairpins."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    strike = fade * rng.uniform(0.1, 0.7) * draw.waves(s, rng.uniform(15.0, 40.0), rng)
    roomy = draw.roomy(s, opening, rng.uniform(0.15, 0.5), rng)
    half = 0.5 * opening * roomy
    tall = half * (1.0 + fade * rng.uniform(0.0, 0.8))
    axis = laid_in_fault(strike, rng.uniform(0.9, 1.45), s, length, float(tall.mean()), rng)
    main = Passage(axis, strike, half, tall, tall, 2.3, 2.3)
    blocks = draw.blocks_on_floor(main, int(length / 6.0), (0.2, 0.5), 0.7 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.1, ledges=0.06, bed=0.7, joints=0.08, grain=0.05)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks)


def crawlway(length: float, opening: float, rng: Rng) -> Plan:
    """Return a tube hardly wider than who passes it, from end to end: straight legs, up and down, tight at corners.

    So are passages built from surveys: between two stations nothing was measured but the leg.
    """
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    corners = draw.kinks(length, (0.8, rng.uniform(3.0, 8.0)), rng)
    edge = rng.uniform(0.2, 0.8)
    headings = fade * draw.turned(s, corners, rng.uniform(0.2, 0.8), edge, rng)
    slopes = rng.uniform(-0.7, 0.7) + draw.turned(s, corners, rng.uniform(0.1, 0.5), edge, rng)
    headings, axis = laid(headings, fade * np.clip(slopes, -1.2, 1.2), s, length, 0.9 * opening, rng)
    half = 0.5 * opening * draw.roomy(s, opening, rng.uniform(0.2, 0.8), rng)
    waists = draw.bumps(s, corners, rng.uniform(0.0, 0.25, len(corners)), rng.uniform(0.2, 0.5, len(corners)))
    half *= 1.0 - np.clip(waists, 0.0, 0.25)
    flat = np.exp(rng.uniform(0.1, 0.3) * draw.waves(s, rng.uniform(8.0, 16.0), rng))
    tall = half * np.maximum(1.0 / flat, 1.0)
    main = Passage(axis, headings, half * np.maximum(flat, 1.0), tall, tall)
    blocks = draw.blocks_on_floor(main, int(length / 10.0), (0.1, 0.25), 0.8 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.08, scallops=0.06, scallop_length=rng.uniform(0.4, 0.9), grain=0.05)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks)


def sump_series(length: float, opening: float, rng: Rng) -> Plan:
    """Return low sumps that dip between roomy chambers, gravel on their floors."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    count = max(1, int(length // rng.uniform(12.0, 24.0)))
    period = (length - 8.0) / count
    phase = np.clip((s - 4.0) / period, 0.0, count) % 1.0
    # A sump is a dip in the middle of each period; the chamber lies between two of them.
    slopes = -fade * rng.uniform(0.35, 0.85) * np.sin(2.0 * np.pi * phase)
    headings = fade * rng.uniform(0.5, 0.8) * draw.waves(s, 26.0, rng)
    headings, axis = laid(headings, slopes, s, length, 1.3 * opening, rng)
    chamber = np.cos(np.pi * phase) ** 4 * fade
    half = 0.5 * opening * (draw.roomy(s, opening, 0.25, rng) + rng.uniform(0.4, 1.4) * chamber)
    low = fade * rng.uniform(0.2, 0.5) * (1.0 - draw.humps(s, length, 8.0, max(0.7 * opening, 0.6), rng))
    main = Passage(
        axis,
        headings,
        half * (1.25 + 0.5 * chamber),
        half * (1.0 + 0.4 * chamber + low),
        1.15 * half,
        floor=0.95 * half,
    )
    blocks = draw.blocks_on_floor(main, int(length / 4.0), (0.2, 0.6), 0.7 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.12, scallops=0.06, scallop_length=rng.uniform(0.4, 0.9), ledges=0.06, floor=0.14)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks)
