"""Styles of caves that water made: tube, canyon, bedding plane, shaft and ramp, sumps.

The forms are those of textbooks (Palmer, Cave Geology, 2007; Ford and Williams, Karst Hydrogeology and Geomorphology,
2007, chapter 7); sizes are chosen to span 2 to 20 widths of a BlueROV2.
"""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.styles import drawing as draw
from aquanav_tools.cave.styles.plan import Passage, Plan, Relief

Rng = np.random.Generator


def phreatic_tube(length: float, opening: float, rng: Rng) -> Plan:
    """Return a tube that formed under water: elliptical, winding, up and down, scalloped, with a few swellings."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.5, 0.9) * draw.waves(s, rng.uniform(18.0, 32.0), rng)
    slopes = fade * rng.uniform(0.15, 0.38) * draw.waves(s, rng.uniform(14.0, 26.0), rng)
    axis = draw.shifted(draw.axis_of(headings, slopes), s)
    swell = np.exp(0.22 * draw.waves(s, 11.0, rng) ** 2 + 0.12 * draw.waves(s, 4.0, rng) ** 2)
    rooms = draw.spots(int(length // 25), 6.0, length - 6.0, rng)
    swell += (
        draw.bumps(s, rooms, rng.uniform(0.3, 1.1, len(rooms)), rng.uniform(1.5, 3.5, len(rooms)))
        if len(rooms)
        else 0.0
    )
    half = 0.5 * opening * swell
    wide = 1.0 + 0.5 * np.clip(draw.waves(s, 16.0, rng), 0.0, 1.0)
    main = Passage(axis, headings, half * wide, half, half)
    sides = tuple(
        draw.dead_end(main, share, rng.uniform(3.0, 6.0), 0.75, rng, rng.uniform(-0.3, 0.3))
        for share in draw.spots(int(rng.integers(0, 2 + int(length // 60))), 0.2, 0.8, rng)
    )
    relief = Relief(swell=0.26, scallops=0.13, scallop_length=rng.uniform(0.7, 1.2), grain=0.04)
    return Plan((main, *sides), draw.extent_of(axis, s, length), opening, relief)


def vadose_canyon(length: float, opening: float, rng: Rng) -> Plan:
    """Return a canyon that a stream cut: narrow, high, meandering, with walls that swing and beds that stand out."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.8, 1.15) * draw.waves(s, rng.uniform(9.0, 15.0), rng)
    slopes = fade * (-rng.uniform(0.02, 0.08) + 0.06 * draw.waves(s, 20.0, rng))
    axis = draw.shifted(draw.axis_of(headings, slopes), s)
    half = 0.5 * opening * np.exp(0.3 * draw.waves(s, 8.0, rng) ** 2)
    tall = rng.uniform(2.8, 6.5) * np.exp(0.12 * draw.waves(s, 18.0, rng))
    tall = np.maximum(tall, 2.2 * half)
    lean = fade * 0.35 * np.minimum(half, 0.8) * (1.0 + 0.6 * draw.waves(s, 12.0, rng))
    main = Passage(axis, headings, half, 0.45 * tall, 0.55 * tall, 2.6, 3.2, lean, rng.uniform(2.5, 4.5), 0.5 * tall)
    blocks = draw.blocks_on_floor(main, int(length / 5.0), (0.25, 0.6), 0.75 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.16, ledges=0.28, bed=rng.uniform(0.45, 0.9), scallops=0.08, dip=(0.05, 0.08), floor=0.1)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks)


def bedding_plane(length: float, opening: float, rng: Rng) -> Plan:
    """Return a low, wide passage along a tilted bed: flat ceiling, rock pillars, pockets above, slabs on its floor."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    headings = fade * rng.uniform(0.3, 0.6) * draw.waves(s, rng.uniform(22.0, 40.0), rng)
    slopes = fade * (rng.uniform(-0.12, 0.12) + 0.05 * draw.waves(s, 12.0, rng))
    axis = draw.shifted(draw.axis_of(headings, slopes), s)
    half = 0.5 * opening * (1.05 + 0.3 * draw.waves(s, 9.0, rng) ** 2)
    wide = np.maximum(rng.uniform(2.2, 4.2) * np.exp(0.3 * draw.waves(s, 13.0, rng)), 2.0 * half)
    main = Passage(axis, headings, wide, half, half, 3.5, 3.0, floor=0.92 * half)
    columns = draw.columns_beside(main, int(length / 4.0), (0.2, 0.55), 0.75 * opening, rng)
    blocks = draw.blocks_on_floor(main, int(length / 5.0), (0.25, 0.7), 0.8 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.16, ledges=0.16, bed=rng.uniform(0.3, 0.45), grain=0.04, floor=0.1, dip=(0.03, -0.1))
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks, columns)


def shaft_ramp(length: float, opening: float, rng: Rng) -> Plan:
    """Return level stretches joined by upright shafts and steep ramps, down and up again."""
    s = draw.stations_of(length)
    slopes, headings = np.zeros(len(s)), np.zeros(len(s))
    place, sign = 4.0, -1.0
    while place + 11.0 < length - 3.0:
        run = float(min(rng.uniform(5.0, 16.0), length - 7.0 - place))
        steep = rng.uniform(1.25, 1.5) if rng.random() < 0.5 else rng.uniform(0.55, 0.95)
        edge = 1.6
        share = np.clip((s - place) / edge, 0.0, 1.0) * np.clip((place + run - s) / edge, 0.0, 1.0)
        slopes += sign * steep * share * share * (3.0 - 2.0 * share)
        place += run + rng.uniform(4.0, 9.0)
        sign = -sign if rng.random() < 0.75 else sign
    level = np.cos(slopes) ** 2 * draw.faded(s, length)
    headings = draw.faded(s, length) * rng.uniform(0.4, 0.9) * draw.waves(s, 24.0, rng)
    axis = draw.shifted(draw.axis_of(headings, slopes), s)
    half = 0.5 * opening * (1.0 + 0.35 * draw.waves(s, 9.0, rng) ** 2 + 0.35 * (1.0 - level))
    main = Passage(axis, headings, half * 1.15, half, half)
    relief = Relief(swell=0.32, ledges=0.16, bed=0.8, joints=0.12, grain=0.06)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief)


def sump_series(length: float, opening: float, rng: Rng) -> Plan:
    """Return low sumps that dip between roomy chambers, gravel on their floors."""
    s = draw.stations_of(length)
    fade = draw.faded(s, length)
    count = max(1, int(length // rng.uniform(16.0, 24.0)))
    period = (length - 8.0) / count
    phase = np.clip((s - 4.0) / period, 0.0, count) % 1.0
    # A sump is a dip in the middle of each period; the chamber lies between two of them.
    slopes = -fade * rng.uniform(0.35, 0.65) * np.sin(2.0 * np.pi * phase) * (np.abs(phase - 0.5) < 0.5)
    headings = fade * rng.uniform(0.5, 0.8) * draw.waves(s, 26.0, rng)
    axis = draw.shifted(draw.axis_of(headings, slopes), s)
    roomy = np.cos(np.pi * phase) ** 4 * fade
    half = 0.5 * opening * (1.0 + 0.25 * draw.waves(s, 7.0, rng) ** 2 + rng.uniform(0.5, 1.2) * roomy)
    main = Passage(
        axis, headings, half * (1.25 + 0.5 * roomy), half * (1.0 + 0.4 * roomy), 1.15 * half, floor=0.95 * half
    )
    blocks = draw.blocks_on_floor(main, int(length / 6.0), (0.25, 0.6), 0.75 * opening, rng, (0.1, 0.9))
    relief = Relief(swell=0.26, scallops=0.1, scallop_length=rng.uniform(0.7, 1.1), ledges=0.1, floor=0.16)
    return Plan((main,), draw.extent_of(axis, s, length), opening, relief, blocks)
