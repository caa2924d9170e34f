"""The styles by name, and drawing a cave of one from a seed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aquanav_tools.synthetic.styles import natural, rooms
from aquanav_tools.synthetic.styles.names import number_of, style_of
from aquanav_tools.synthetic.styles.plan import Plan
from aquanav_tools.synthetic.styles.winding import end_within
from aquanav_tools.types import Array

VEHICLE_WIDTH = 0.34
"""Of a BlueROV2's frame and of its capsule, m: openings are drawn in multiples of it."""
LENGTHS = (20.0, 200.0)
"""Shortest and longest main passage, m; drawn evenly in the logarithm."""
WIDENING = 0.15
"""By how much wider every further attempt is."""
VOXEL_SHARE, MIN_VOXEL, MAX_VOXEL = 0.12, 0.1, 0.32
"""The voxel is this share of the opening, and between so many m."""
WALL_CELLS, MAX_SHARE = 20_000, 0.2
"""Of a long cave the voxel is larger, so that its wall has about so many; up to this share of the opening."""
MAX_CELLS = 22_000
"""A cave whose wall has more of the largest voxels is drawn shorter: with it a cave takes about 3 s to build."""


@dataclass(frozen=True)
class Style:
    """A kind of cave."""

    draws: Callable[[float, float, np.random.Generator], Plan]
    """Returns the plan of a length and an opening, m."""
    openings: tuple[float, float]
    """Narrowest and widest opening, vehicle widths; drawn evenly in the logarithm. The narrowest place of the way
    has 0.5 to 1 of it, 0.75 on average: relief and blocks narrow it."""
    lengths: tuple[float, float] = LENGTHS


STYLES: dict[str, Style] = {
    "phreatic-tube": Style(natural.phreatic_tube, (1.8, 20.0)),
    "vadose-canyon": Style(natural.vadose_canyon, (1.8, 8.0)),
    "bedding-plane": Style(natural.bedding_plane, (1.8, 7.0), (20.0, 120.0)),
    "breakdown-chamber": Style(rooms.breakdown_chamber, (1.8, 10.0)),
    "shaft-ramp": Style(natural.shaft_ramp, (1.8, 12.0)),
    "fault-fissure": Style(natural.fault_fissure, (1.8, 8.0), (20.0, 150.0)),
    "crawlway": Style(natural.crawlway, (1.4, 3.0), (20.0, 150.0)),
    "maze": Style(rooms.maze, (2.0, 7.0), (20.0, 120.0)),
    "sump-series": Style(natural.sump_series, (1.8, 10.0)),
    "flooded-gallery": Style(rooms.flooded_gallery, (8.0, 20.0), (30.0, 200.0)),
    "mine-drift": Style(rooms.mine_drift, (1.9, 9.0)),
}


@dataclass(frozen=True, eq=False)
class DrawnCave:
    """A plan and how finely its surface is to be made."""

    style: str
    seed: int
    plan: Plan
    voxel: float
    """m; a whole number of them makes the plan's extent."""
    noise_seed: int
    """Picks the relief."""
    end: Array | None
    """(3,) where the way ends, m; at the second portal where there is none."""


def draw_cave(style: str, seed: int, attempt: int = 0) -> DrawnCave:
    """Return the cave of a style and a seed; further attempts are other caves of the same length.

    Raises:
        InputError: as in `style_of`.
    """
    name = style_of(style, seed)
    kind = STYLES[name]
    sizes = np.random.default_rng([number_of(name, seed), 1])
    length, opening = (float(np.exp(sizes.uniform(*np.log(limits)))) for limits in (kind.lengths, kind.openings))
    opening *= VEHICLE_WIDTH * (1.0 + WIDENING * attempt)
    coarsest = min(MAX_SHARE * opening, MAX_VOXEL)
    numbers = [number_of(name, seed), 2, attempt]
    rng = np.random.default_rng(numbers)
    plan = kind.draws(length, opening, rng)
    excess = plan.wall_area / (MAX_CELLS * coarsest**2)
    if excess > 1.0:
        rng = np.random.default_rng(numbers)
        plan = kind.draws(max(length / excess, kind.lengths[0]), opening, rng)
    plan = dataclasses.replace(plan, extent=round(plan.extent, 3))  # portals lie at whole millimetres
    enough = float(np.sqrt(plan.wall_area / WALL_CELLS))
    voxel = min(max(VOXEL_SHARE * opening, MIN_VOXEL, enough), coarsest)
    voxel = plan.extent / round(plan.extent / voxel)
    noise_seed = int(rng.integers(1 << 20))
    return DrawnCave(name, seed, plan, voxel, noise_seed, end_within(plan.passages[0].axis, plan.length, rng))
