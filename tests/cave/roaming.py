"""Whether the metres to go jump anywhere: vehicles that roam, and moves cut in half where they change most."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array
from tests.sim.batch.guides import Tracker

MOVE, FINEST = 0.01, 1e-4
"""m."""
ROAM = 400
"""Moves of one vehicle: as far as half a passage is wide and along several panels."""
ROOM = 0.03
"""m: a vehicle's middle comes no nearer to walls. More than a field of 0.1 m errs, so that none ends in rock."""
NUM_HALVED = 50


def largest_change(guide: Guide, field: DistanceField, rng: np.random.Generator, num_starts: int = 60) -> Array:
    """Return the most that a move of 1 cm changes the metres to go, and a hundredth of one where it changes them most.

    Of a slope the second is a hundredth of the first, of a jump it is all of it.
    """
    tracker, moves = Tracker(guide), []
    for start in guide.centreline[np.linspace(0, len(guide.centreline) - 1, num_starts).astype(int)]:
        moves += roam(tracker, guide.locate(start), field, start, rng)
    moves.sort(key=lambda move: -abs(move[2]))
    return np.array([abs(moves[0][2]), max(halved(tracker, *move) for move in moves[:NUM_HALVED])])


def roam(
    tracker: Tracker, gate: int, field: DistanceField, place: Array, rng: np.random.Generator
) -> list[tuple[Array, Array, float, int]]:
    """Return moves from a place of the route, straight on until a wall is near: from, to, change in m, gate before."""
    way, places = direction(rng), [place]
    for _ in range(ROAM):
        after = places[-1] + MOVE * way
        if field.clearance_at(after) < ROOM:
            way = direction(rng)
        else:
            places.append(after)
    gates, left = tracker.follow(places, gate)
    changes = np.diff(left).tolist()
    return list(zip(places[:-1], places[1:], changes, gates[:-1].tolist(), strict=True))


def halved(tracker: Tracker, start: Array, end: Array, change: float, gate: int) -> float:
    """Return the change, m, over at most FINEST of a move: of its halves always the one that changes more."""
    while np.linalg.norm(end - start) > FINEST:
        middle = 0.5 * (start + end)
        first = tracker.follow([start], gate)[1][0]
        gates, (there, last) = tracker.follow([middle, end], gate)
        if abs(there - first) >= abs(last - there):
            end, change = middle, there - first
        else:
            start, gate, change = middle, int(gates[0]), last - there
    return abs(change)


def direction(rng: np.random.Generator) -> Array:
    """Return a random unit vector."""
    way: Array = rng.normal(size=3)
    return way / np.linalg.norm(way)
