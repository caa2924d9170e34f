"""Drawn caves made larger or smaller: more caves from each that is built, and squeezes as tight as the vehicle fits.

To a vehicle a passage is as narrow as it is in widths of its hull: in a cave that is made smaller, squeezes are
tighter and bends sharper than its style has them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquanav_tools.cave.route.starts import Start
from aquanav_tools.envs.starting import can_begin_anywhere
from aquanav_tools.envs.vehicles import dived_by, vehicle_of, ways_to_goal
from aquanav_tools.scenario.scaling import scaled
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.hull import hull_clearance
from aquanav_tools.types import Capsule

NARROWEST = 1.15
"""A cave is not made smaller than so many vehicle widths, at the narrowest place of the way to its goal."""
MARGIN = 0.03
"""Clearance of the hull at a start, m."""
MIN_STARTS = 4
"""Fewer would be nearly the same dive again and again."""
MAX_NODES = 60_000
"""Places in the water among which a way is sought: a tenth of a second."""
MAX_TRIES = 5
"""Factors that are tried, each half as far from 1, in the logarithm, as the one before."""


def scaled_to_fit(scenario: Scenario, factor: float, vehicle: str | None = None) -> Scenario:
    """Return a cave made larger or smaller by a factor, or by one nearer to 1 where its vehicle would not fit through.

    Starts that it does not fit at any more are left out. A cave that fits by no factor stays as it is.

    Args:
        scenario: The cave.
        factor: By which its lengths are multiplied.
        vehicle: What dives there, by name or path; None for the cave's own.

    Raises:
        InputError: the vehicle fits through by no factor.
    """
    capsule = vehicle_of(scenario, vehicle).capsule
    for _ in range(MAX_TRIES):
        other = scaled(scenario, factor)
        starts = _usable(other, capsule)
        if len(starts) >= MIN_STARTS and can_begin_anywhere(other, capsule):
            return dived_by(replace(other, starts=starts), vehicle)
        factor = float(np.sqrt(factor))
    return dived_by(scenario, vehicle)


def _usable(scenario: Scenario, capsule: Capsule) -> tuple[Start, ...]:
    """Return the starts where a hull is free and from which a way with room to spare leads to the goal."""
    positions = np.array([start.pose.position for start in scenario.starts])
    lengths = ways_to_goal(scenario, NARROWEST * capsule.radius, positions, MAX_NODES)
    return tuple(
        start
        for start, length in zip(scenario.starts, lengths, strict=True)
        if np.isfinite(length) and _room(scenario, start, capsule) > MARGIN
    )


def _room(scenario: Scenario, start: Start, capsule: Capsule) -> float:
    state = np.concatenate([start.pose.position, start.pose.orientation])
    return float(hull_clearance(state, 0.5 * capsule.axis_length, capsule.radius, *scenario.field.grid))
