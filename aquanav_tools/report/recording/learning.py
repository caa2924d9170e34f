"""The curves of a training run as a recording, over the decisions learned from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.recording.stream import recording

TIMELINE = "decisions"


def record_learning(series: Mapping[str, Sequence[tuple[int, float]]], identity: str, path: Path) -> None:
    """Write a recording.

    Args:
        series: (decisions, value) pairs by a name with one slash, such as "rollout/mean_reward"; no nan.
        identity: what the recording's id follows from.
        path: the .rrd file; replaced when it exists.
    """
    import rerun as rr

    with recording(path, f"learning {identity}", _blueprint(series)) as stream:
        for name, pairs in series.items():
            steps, values = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
            times = rr.TimeColumn(TIMELINE, sequence=steps.astype(np.int64))
            stream.send_columns(name, [times], rr.Scalars.columns(scalars=values), strict=True)


def _blueprint(series: Mapping[str, Sequence[tuple[int, float]]]) -> Any:
    """Return the layout: a plot per number, in a tab for each group."""
    import rerun.blueprint as rrb

    groups: dict[str, list[str]] = {}
    for name in series:
        groups.setdefault(name.split("/")[0], []).append(name)
    tabs = [
        rrb.Grid(*(rrb.TimeSeriesView(origin=name, name=name.split("/")[1]) for name in names), name=group)
        for group, names in groups.items()
    ]
    return rrb.Blueprint(rrb.Tabs(*tabs), rrb.TimePanel(timeline=TIMELINE, state="collapsed"), collapse_panels=True)
