"""A recording of one action sequence in still water and in currents: all vehicles swim at the same time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.recording.cave import CaveModel, eye, log_cave, log_route
from aquanav_tools.report.recording.episode import TIMELINE
from aquanav_tools.report.recording.stream import recording
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.types import Array, Capsule

COLOURS = ((42, 157, 143), (31, 111, 139), (123, 44, 191), (233, 162, 59))
"""In the order of the currents, as in the plot."""
IDEAL, CONTACT = (255, 255, 255), (229, 56, 59)


def record_impact(
    cave: CaveModel,
    ideal: Trajectory,
    replays: Sequence[tuple[str, Sequence[tuple[Trajectory, Array]]]],
    hull: Capsule,
    path: Path,
) -> None:
    """Write the recording.

    Args:
        cave: where they swim.
        ideal: the dive in still water.
        replays: for every current, its name and its trajectories with their (D + 1,) deviation, m.
        hull: the vehicle's capsule.
        path: the .rrd file; replaced when it exists.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    scenario = cave.scenario
    scene = rrb.Spatial3DView(contents=["+ /**", "- /plots/**"], name=scenario.name, eye_controls=eye(cave))
    plots = rrb.TimeSeriesView(origin="plots", name="off the ideal way, m")
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed")
    blueprint = rrb.Blueprint(rrb.Vertical(scene, plots, row_shares=[3, 1]), panel, collapse_panels=True)
    identity = f"water impact {scenario.name} {scenario.content_hash} {ideal.seed} {ideal.start_index}"
    with recording(path, identity, blueprint) as stream:
        log_cave(stream, cave)
        log_route(stream, scenario)
        _log_dive(stream, "still", ideal, IDEAL, hull)
        for number, (current, runs) in enumerate(replays):
            for trajectory, deviation in runs:
                name, colour = f"{current}/seed_{trajectory.seed}", COLOURS[number % len(COLOURS)]
                _log_dive(stream, name, trajectory, colour, hull)
                times = [rr.TimeColumn(TIMELINE, duration=trajectory.times[: len(deviation)])]
                stream.send_columns(f"plots/{name}", times, rr.Scalars.columns(scalars=deviation), strict=True)
                stream.log(f"plots/{name}", rr.SeriesLines(colors=colour), static=True, strict=True)


def _log_dive(stream: Any, name: str, trajectory: Trajectory, colour: tuple[int, int, int], hull: Capsule) -> None:
    """Log a dive's whole way, its contacts, and a ball of the hull's width that swims along it."""
    import rerun as rr

    trail = rr.LineStrips3D([trajectory.positions], colors=colour, radii=0.012)
    stream.log(f"dives/{name}/trail", trail, static=True, strict=True)
    contacts = trajectory.positions[trajectory.contact_states]
    if len(contacts):
        points = rr.Points3D(contacts, colors=CONTACT, radii=0.06)
        stream.log(f"dives/{name}/contacts", points, static=True, strict=True)
    times = [rr.TimeColumn(TIMELINE, duration=trajectory.times)]
    columns = rr.Points3D.columns(
        positions=trajectory.positions, colors=np.tile(np.array(colour, dtype=np.uint8), (len(trajectory.times), 1)),
        radii=np.full(len(trajectory.times), hull.radius),
    )  # fmt: skip
    stream.send_columns(f"dives/{name}/vehicle", times, columns, strict=True)
