"""Start poses all over the reachable water, where a vehicle floats free and looks the way to the goal."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.options import StartOptions
from aquanav_tools.cave.route.capsule_checker import CapsuleChecker
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.geometry.volume.geodesic import WaterGraph, Ways
from aquanav_tools.types import Array, Capsule, Pose, yaw_quaternion

logger = logging.getLogger(__name__)

TRIES_PER_START = 200
MIN_FILLED = 0.5
"""With fewer starts than this share of those asked for, success rates would speak of a small part of the cave."""


@dataclass(frozen=True, eq=False)
class Start:
    """A place to begin an episode."""

    pose: Pose
    """World from body; the vehicle's capsule touches nothing."""
    clearance: float
    """m to the nearest wall."""
    geodesic_to_goal: float
    """Length of the shortest way through the water to the goal, m."""
    difficulty: float
    """In [0, 1]: that length as a share of the longest there is, from the farthest place with room for a start."""


@dataclass(frozen=True, eq=False)
class _Places:
    """Where a vehicle can float and from where it can reach the goal."""

    ways: Ways
    points: Array
    """(N, 3) m."""
    lengths: Array
    """(N,) way to the goal, m."""


def draw_starts(
    cavity: Cavity,
    field: DistanceField,
    guide: Guide,
    capsule: Capsule,
    options: StartOptions,
    rng: np.random.Generator,
    graph: WaterGraph | None = None,
) -> tuple[Start, ...]:
    """Return level start poses, the first nearest to the goal: one each from equal ranges of the way to the goal.

    Within its range a start is drawn evenly from all water that the vehicle can reach and keep its margin in, side
    passages and dead ends too. Where a range has no free pose there is no start; the caller sees it by their number.
    The graph of the water at the capsule's radius is made anew unless given.

    Raises:
        MeshError: no place is far enough from the goal, or at least half of the ranges have no free pose.
    """
    places = _places(graph or WaterGraph(field, capsule.radius), guide.centres[-1], capsule.radius, options.margin)
    farthest = float(places.lengths.max())
    nearest = max((1.0 - options.last_share) * farthest, options.min_goal_distance)
    if nearest >= farthest:
        raise MeshError(
            f"No start: the farthest place with room for the vehicle is {farthest:.2f} m from the goal, and starts "
            f"keep {nearest:.2f} m from it. Scan more of the passage, or set a smaller --starts.min-goal-distance."
        )
    checker = CapsuleChecker(cavity, field, capsule)
    starts = []
    for low, high in pairwise(np.linspace(nearest, farthest, options.count + 1)):
        found = _draw(places, low, high, checker, capsule.radius, options, rng)
        if found is None:
            logger.info("No free start pose between %.2f m and %.2f m from the goal", low, high)
        else:
            pose, length = found
            starts.append(Start(pose, field.clearance_at(pose.position), length, length / farthest))
    _check_number(len(starts), options, nearest, farthest)
    return tuple(starts)


def _places(graph: WaterGraph, goal: Array, radius: float, margin: float) -> _Places:
    ways = graph.ways_from(goal)
    free = np.flatnonzero((graph.clearance >= radius + margin) & np.isfinite(ways.lengths))
    if not len(free):
        raise MeshError(
            f"No start: no place from which the goal can be reached has {radius + margin:.2f} m of clearance (the "
            f"vehicle's radius and --starts.margin {margin:.2f}). Choose a smaller vehicle or margin."
        )
    return _Places(ways, graph.points[free], ways.lengths[free])


def _draw(
    places: _Places,
    low: float,
    high: float,
    checker: CapsuleChecker,
    radius: float,
    options: StartOptions,
    rng: np.random.Generator,
) -> tuple[Pose, float] | None:
    """Return a free pose drawn evenly from the places with a way of `low` to `high` m, and its way, m, or None."""
    half_cell = 0.5 * places.ways.graph.spacing
    slack = np.sqrt(3.0) * half_cell
    inside = np.flatnonzero((places.lengths >= low - slack) & (places.lengths <= high + slack))
    spread = np.deg2rad(options.max_yaw_error_deg)
    for _ in range(TRIES_PER_START if len(inside) else 0):
        position = places.points[rng.choice(inside)] + rng.uniform(-half_cell, half_cell, 3)
        turn = rng.uniform(-spread, spread)
        path = places.ways.path_to(position)
        length = np.inf if path is None else length_of(path)
        if path is None or not low <= length <= high:
            continue
        pose = Pose(position, yaw_quaternion(_yaw_along(path[::-1], radius) + turn))
        if checker.distance(pose) > options.margin:
            return pose, length
    return None


def _yaw_along(way: Array, radius: float) -> float:
    """Return the direction of a way's first part that leads away sideways, rad; 0 for a way straight up or down."""
    offsets = way - way[0]
    aside = np.flatnonzero(np.hypot(offsets[:, 0], offsets[:, 1]) > radius)
    return float(np.arctan2(offsets[aside[0], 1], offsets[aside[0], 0])) if len(aside) else 0.0


def _check_number(found: int, options: StartOptions, nearest: float, farthest: float) -> None:
    if found < MIN_FILLED * options.count:
        raise MeshError(
            f"Only {found} of {options.count} starts have a free pose {nearest:.2f} to {farthest:.2f} m from the goal: "
            f"the passage is too tight to float in with {options.margin:.2f} m around the vehicle. Choose a smaller "
            "vehicle with --vehicle, or a smaller --starts.margin."
        )
