"""Numbered places on drawings: "add photos here"."""

from __future__ import annotations

from typing import Any

from aquanav_tools.report.figures import BAD
from aquanav_tools.report.labels import Labels
from aquanav_tools.types import Array


def draw_number(axes: Any, labels: Labels, place: Array, number: int) -> None:
    """Mark a (2,) place with a red diamond and write its number beside it."""
    axes.scatter(*place, marker="D", s=26, color=BAD, edgecolors="white", linewidths=0.8, zorder=12, clip_on=False)
    labels.add(place, str(number), color=BAD, fontweight="bold", fontsize=11)
