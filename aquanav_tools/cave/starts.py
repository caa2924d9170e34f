"""Start poses along the route where a vehicle floats free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.contact import CapsuleChecker
from aquanav_tools.cave.field import DistanceField
from aquanav_tools.cave.guide import Guide
from aquanav_tools.cave.options import StartOptions
from aquanav_tools.cave.route import WaterGraph
from aquanav_tools.cave.shortcut import shortest_length
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Capsule, Pose, yaw_quaternion

TRIES_PER_START = 200


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
    """In [0, 1]: share of the guide still to go."""


def draw_starts(
    cavity: Cavity,
    field: DistanceField,
    guide: Guide,
    capsule: Capsule,
    options: StartOptions,
    rng: np.random.Generator,
) -> tuple[Start, ...]:
    """Return start poses spread evenly along the guide, level, at random places of its cross-sections.

    Raises:
        MeshError: no free pose is found on a stretch of the guide.
    """
    checker = CapsuleChecker(cavity, field, capsule)
    arcs = np.linspace(0.0, options.last_share * guide.length, options.count)
    poses = [_draw_pose(guide, field, checker, arc, options, rng) for arc in arcs]
    ways = WaterGraph(field, 0.8 * capsule.radius).ways_from(guide.centres[-1])
    starts = []
    for arc, pose in zip(arcs, poses, strict=True):
        starts.append(
            Start(
                pose,
                field.clearance_at(pose.position),
                shortest_length(ways, pose.position),
                float(1.0 - arc / guide.length),
            )
        )
    return tuple(starts)


def _draw_pose(
    guide: Guide,
    field: DistanceField,
    checker: CapsuleChecker,
    arc: float,
    options: StartOptions,
    rng: np.random.Generator,
) -> Pose:
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(guide.centreline, axis=0), axis=1))])
    index = int(np.clip(np.searchsorted(lengths, arc), 1, len(lengths) - 1))
    centre = guide.centreline[index]
    ahead = guide.centreline[min(index + 5, len(lengths) - 1)] - guide.centreline[max(index - 5, 0)]
    room = field.clearance_at(centre)
    spread = np.deg2rad(options.max_yaw_error_deg)
    for attempt in range(TRIES_PER_START):
        # The search draws in towards the centreline, so that tight places end on it.
        reach = 1.0 - attempt / TRIES_PER_START
        offset = reach * rng.uniform(-room, room, 3)
        yaw = np.arctan2(ahead[1], ahead[0]) + reach * rng.uniform(-spread, spread)
        pose = Pose(centre + offset, yaw_quaternion(float(yaw)))
        if checker.distance(pose) > options.margin:
            return pose
    raise MeshError(
        f"No free start pose near {centre.round(2)} m: the clearance there is {room:.2f} m and the vehicle keeps "
        f"{options.margin:.2f} m from the walls. Choose a smaller vehicle, or fewer starts with --starts.count."
    )
