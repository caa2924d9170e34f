"""Where a passage leads: ways that turn off, double back and wind, clear of themselves and of both portals' planes.

Real passages lead away from where they come out: along the way through Mylna Rura (Tatra) half of all places point more
than 90 degrees off the straight line to its end. Who dives by the bearing of the goal is lost there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquanav_tools.synthetic.styles import drawing as draw
from aquanav_tools.types import Array

CANDIDATES = 160
"""Windings that are drawn, of which one is taken."""
DIRECT = (0.15, 0.9)
"""Distance between the portals as a share of the way between them: drawn from here, and met as nearly as may be."""
FOLDED = (0.1, 0.6)
"""As DIRECT, of ways within a fault."""
FOLDING, TURNED = 0.7, 0.15
"""Share of faults whose ways fold, and of folds that lead up where those before led down, or the other way round."""
SHARPEST, MEANDER = 3.1, 2.2
"""By how much limbs and meanders turn off the way straight through at most, rad."""
RUN, MEAN_RUN, MEAN_FOLD = 1.0, 6.0, 3.0
"""Limbs are straight for at least and on average about so many m; those of folds for the last."""
STEEPEST = 1.5
"""rad: the way is never quite upright, so that ahead and sideways are told apart."""
EVERY = 8
"""Stations between two that are looked at for nearness."""
INSIDE = 0.5
"""Share of caves whose way ends within the passage, which leads on: only there may a way end close to its beginning."""
ENDS = (0.55, 0.95)
"""Where on the way through it may end, as a share of it."""
SHORTEST = 16.0
"""It is no shorter than this, m."""
NEAR_END = (0.0, 0.6)
"""As DIRECT, of ways that end within."""
SPARE = 0.4
"""Rock between a passage and the plane of a portal that it is not at, m."""
Winding = Callable[[Array, float, float, float, np.random.Generator], Array]
"""Returns (C,) angles (rad) from (C,) stations, length (m), how much (0 to 1), least radius of bends (m), generator."""


def laid(
    headings: Array, slopes: Array, stations: Array, length: float, reach: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the (C,) headings (rad) and the (C, 3) axis (m) of a passage, wound as much as is drawn.

    Args:
        headings: (C,) that it has without winding, rad; 0 at both portals.
        slopes: (C,) rad; 0 at both portals.
        stations: (C,) along the passage, m.
        length: of the way between the portals, m.
        reach: of its cross-sections, from the axis, m: it keeps twice as far from itself, and some rock.
        rng: draws how it winds.
    """
    slopes = np.clip(slopes, -STEEPEST, STEEPEST)

    def axis_when(winding: Array) -> Array:
        return draw.shifted(draw.axis_of(headings + winding, slopes), stations)

    winding = _wound(axis_when, (_limbs, _meanders), stations, length, reach, DIRECT, rng)
    return headings + winding, axis_when(winding)


def laid_in_fault(
    strike: Array, dip: float, stations: Array, length: float, reach: float, rng: np.random.Generator
) -> Array:
    """Return the (C, 3) axis of a passage that winds within a steep fault: limbs double back above and below others.

    In mylna rura (Tatra) the way sinks by a metre and comes back below itself, where the bearing of its end turns from
    behind to ahead; a passage that winds in plan has no such place.

    Args:
        strike: (C,) level direction of the fault, rad; 0 at both portals.
        dip: of the fault, rad, from level.
        stations: (C,) along the passage, m.
        length: of the way between the portals, m.
        reach: of its cross-sections within the fault, from the axis, m.
        rng: draws how it winds.
    """
    level = np.stack([np.cos(strike), np.sin(strike), np.zeros(len(strike))], axis=1)
    steep = np.stack(
        [-np.sin(strike) * np.cos(dip), np.cos(strike) * np.cos(dip), np.full(len(strike), np.sin(dip))], 1
    )

    def axis_when(winding: Array) -> Array:
        ahead = np.cos(winding)[:, None] * level + np.sin(winding)[:, None] * steep
        return draw.shifted(draw.joined(ahead), stations)

    windings = (_folds,) if rng.random() < FOLDING else (_limbs, _meanders)
    return axis_when(_wound(axis_when, windings, stations, length, reach, FOLDED, rng))


def _wound(
    axis_when: Callable[[Array], Array],
    windings: tuple[Winding, ...],
    stations: Array,
    length: float,
    reach: float,
    direct: tuple[float, float],
    rng: np.random.Generator,
) -> Array:
    """Return (C,) angles by which a passage turns off, rad: of many that are drawn, one whose ends are apart as wanted.

    Args:
        axis_when: returns the (C, 3) axis of such angles, m, station 0 at the origin.
        windings: kinds that are drawn in turn.
        stations: (C,) along the passage, m.
        length: of the way between the portals, m.
        reach: of its cross-sections, from the axis, m.
        direct: least and most that may be wanted, as DIRECT.
        rng: draws them.
    """
    wanted = rng.uniform(*direct)
    best = np.zeros(len(stations))
    nearest = _directness(axis_when(best), stations, length) - wanted
    fade = draw.faded(stations, length, 3.0)
    for number, share in enumerate(rng.uniform(0.0, 1.0, CANDIDATES)):
        winding = fade * windings[number % len(windings)](stations, length, share, reach + 0.5, rng)
        axis = axis_when(winding)
        off = _directness(axis, stations, length) - wanted
        if abs(off) < abs(nearest) and _is_clear(axis, stations, length, reach):
            best, nearest = winding, off
    return best


def end_within(axis: Array, length: float, rng: np.random.Generator) -> Array | None:
    """Return the (3,) place on an axis at which the way ends, m, or None where it leads through the second portal.

    Args:
        axis: (C, 3) of the main passage, STEP apart, which begins and ends as far from its portals, m.
        length: between these, m.
        rng: draws it.
    """
    wanted = rng.uniform(*NEAR_END)
    if rng.random() >= INSIDE or ENDS[1] * length <= SHORTEST:
        return None
    first = round(0.5 * (len(axis) - length / draw.STEP))
    ways = draw.STEP * np.arange(len(axis) - first)
    within = (ways >= max(ENDS[0] * length, SHORTEST)) & (ways <= ENDS[1] * length)
    places, ways = axis[first:][within], ways[within]
    directness = np.linalg.norm(places - axis[first], axis=1) / ways
    place: Array = places[np.argmin(np.abs(directness - wanted))]
    return place


def _meanders(stations: Array, length: float, share: float, radius: float, rng: np.random.Generator) -> Array:
    """Return (C,) headings that swing to and fro along a sine, in bends of a radius (m) or more.

    The form of rivers, whose loops meet where it swings by 2.2 rad (Langbein and Leopold, River Meanders, 1966).
    """
    swing = MEANDER * share
    shortest = 2.0 * np.pi * swing * radius
    period = rng.uniform(shortest, max(1.5 * shortest, 1.2 * length))
    return swing * np.sin(2.0 * np.pi * (stations - draw.STRAIGHT) / period + rng.choice([0.0, np.pi]))


def _limbs(stations: Array, length: float, share: float, radius: float, rng: np.random.Generator) -> Array:
    """Return (C,) headings of straight limbs joined by arcs of a radius (m), off by up to a share of SHARPEST."""
    places, headings = [draw.STRAIGHT], [0.0]
    while places[-1] < length - 2.0 * draw.STRAIGHT:
        heading = rng.choice([-1.0, 1.0]) * SHARPEST * share * rng.uniform(0.3, 1.0)
        arc = radius * abs(heading - headings[-1])
        run = RUN + rng.exponential(MEAN_RUN - RUN)
        places += [places[-1] + arc, places[-1] + arc + run]
        headings += [heading, heading]
    return np.interp(stations, places, headings)


def _folds(stations: Array, length: float, share: float, radius: float, rng: np.random.Generator) -> Array:
    """Return (C,) headings of straight limbs joined by arcs of a radius (m), every second off by a share of pi."""
    places, headings = [draw.STRAIGHT], [0.0]
    side = rng.choice([-1.0, 1.0])
    while places[-1] < length - 2.0 * draw.STRAIGHT:
        is_back = len(headings) % 4 == 1
        side *= -1.0 if is_back and rng.random() < TURNED else 1.0
        least, most = (np.pi * (0.5 + 0.4 * share), np.pi) if is_back else (-0.4, 0.5)
        heading = side * rng.uniform(least, most)
        arc = rng.uniform(1.1, 1.8) * radius * abs(heading - headings[-1])
        run = RUN + rng.exponential(MEAN_FOLD - RUN)
        places += [places[-1] + arc, places[-1] + arc + run]
        headings += [heading, heading]
    return np.interp(stations, places, headings)


def _directness(axis: Array, stations: Array, length: float) -> float:
    """Return the distance between both ends of the way as a share of its length."""
    first, last = (int(np.argmin(np.abs(stations - place))) for place in (0.0, length))
    return float(np.linalg.norm(axis[last] - axis[first]) / length)


def _is_clear(axis: Array, stations: Array, length: float, reach: float) -> bool:
    """Return whether a passage keeps off itself, and off the portals' planes but where it goes through them."""
    last = int(np.argmin(np.abs(stations - length)))
    inside = (stations > reach + 0.5) & (stations < length - reach - 0.5)
    x = axis[inside, 0]
    if x.size == 0 or x.min() < reach + SPARE or x.max() > axis[last, 0] - reach - SPARE:
        return False
    within = (stations >= 0.0) & (stations <= length)
    places, points = stations[within][::EVERY], axis[within][::EVERY]
    apart = 2.0 * reach + 1.0
    far = np.abs(places[:, None] - places) > 1.5 * apart
    return not (far & (((points[:, None] - points) ** 2).sum(axis=2) < apart**2)).any()
