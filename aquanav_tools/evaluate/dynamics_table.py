"""How collision-free success goes with what episodes drew of their vehicles' dynamics: a table of the report."""

from __future__ import annotations

import numpy as np

from aquanav_tools.evaluate.episode_table import DYNAMICS, EpisodeTable
from aquanav_tools.evaluate.metrics import INFEASIBLE
from aquanav_tools.report.dynamics import label_of, unit_of
from aquanav_tools.report.html import Table
from aquanav_tools.types import Array, BoolArray

PARTS = ("lowest third", "middle third", "highest third")
MIN_EPISODES = 3 * len(PARTS)
"""That drew something; with fewer a part has a rate of one or two."""


def dynamics_tables(episodes: EpisodeTable) -> tuple[Table, ...]:
    """Return the table, or none where fewer than MIN_EPISODES drew anything.

    Each number is split into thirds of the range in which it was drawn; one of at most three values, such as a delay,
    by value. Infeasible episodes are left out, as from all rates.
    """
    names = episodes.drawn
    if not names:
        return ()
    known = episodes.rows(np.logical_not(episodes.are("outcome", INFEASIBLE)))
    free = np.logical_and(known.are("outcome", "success"), known.column("collisions") == 0)
    columns = {name: known.column(DYNAMICS + name) for name in names}
    values = np.stack(list(columns.values()), axis=1)
    values = values[np.isfinite(values).any(axis=1)]
    if len(values) < MIN_EPISODES:
        return ()
    # Episodes of one seed draw the same under every condition, and fare alike: they tell little more than one.
    num = len(np.unique(np.nan_to_num(values, nan=np.inf), axis=0))
    if "weak_thruster_gain" in columns and "weak_thruster" in columns:  # it is drawn always, and acts on a weak one
        columns["weak_thruster_gain"][~(columns["weak_thruster"] > 0.0)] = np.nan
    rows = tuple(_row(name, column, free) for name, column in columns.items() if np.isfinite(column).any())
    title = (
        f"Collision-free success by what {len(values)} episodes drew of their vehicle's dynamics, {num} different "
        f"vehicles. Differences below about {_chance(free, num):.0f} points between thirds are chance"
    )
    return (Table(title, ("drawn", "from", "to", "", *PARTS), rows),)


def _row(name: str, values: Array, free: BoolArray) -> tuple[str, ...]:
    drew = np.isfinite(values)
    values, free = values[drew], free[drew]
    low, high = float(values.min()), float(values.max())
    different = np.unique(values)
    if len(different) <= len(PARTS):
        cells = [f"{value:g}: {_rate(free[values == value])}" for value in different]
        cells += [""] * (len(PARTS) - len(cells))
    else:
        third = np.minimum((len(PARTS) * (values - low) / (high - low)).astype(int), len(PARTS) - 1)
        cells = [_rate(free[third == part]) for part in range(len(PARTS))]
    return (label_of(name), f"{low:.3g}", f"{high:.3g}", unit_of(name), *cells)


def _rate(free: BoolArray) -> str:
    return f"{free.mean():.0%} of {len(free)}".replace("%", " %") if len(free) else "none"


def _chance(free: BoolArray, num: int) -> float:
    """Return the difference between two thirds of `num` different vehicles that 95 % of samples stay below, in points.

    That of two binomial fractions with the same probability, which is taken from all episodes but kept from 0 and 1.
    """
    probability = (float(free.sum()) + 1.0) / (len(free) + 2.0)
    return float(100.0 * 1.96 * np.sqrt(2.0 * probability * (1.0 - probability) / (num / len(PARTS))))
