"""One episode: cave, route, vehicle with its rays and trail, and the plots below, with a blueprint inside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.recording.cave import HULL, CaveModel, eye, log_cave, log_route
from aquanav_tools.report.recording.stream import recording
from aquanav_tools.report.track import Track
from aquanav_tools.types import Array, Capsule

MAX_RAY_STATES = 600
"""Beyond this number of states the rays are shown at every second, third, ... state."""
FOLLOW_DISTANCE = 2.5
"""Of the camera that follows the vehicle, m."""
TIMELINE = "time"
TRAIL_RADIUS, RAY_RADIUS = 0.015, 0.004
"""Of the lines drawn, m."""

NEAR, FAR = np.array([229, 56, 59]), np.array([120, 200, 220])
STATE_COLOURS = {
    "cruise": (31, 111, 139),
    "near wall": (233, 162, 59),
    "collision": (229, 56, 59),
    "success": (42, 157, 143),
    "timeout": (92, 111, 123),
}
NEAR_WALL = 0.25
"""Clearance below which the state lane says "near wall", m."""
Z_TO_X = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))
"""Quaternion (x, y, z, w) of the quarter turn that brings z to x."""


def record_episode(cave: CaveModel, track: Track, hull: Capsule, ray_directions: Array, path: Path) -> None:
    """Write a recording of one episode.

    Args:
        cave: The cave it happened in.
        track: What happened.
        hull: The vehicle's capsule.
        ray_directions: (R, 3) unit vectors in the body frame, in the order of the track's rays.
        path: The .rrd file; replaced when it exists.
    """
    scenario = cave.scenario
    identity = f"episode {scenario.name} {scenario.content_hash} {track.seed} {track.start_index}"
    blueprint = dive_blueprint(cave, track.positions[0], _lasting_terms(track))
    with recording(path, identity, blueprint) as stream:
        _log_properties(stream, track)
        log_cave(stream, cave)
        log_route(stream, scenario)
        _log_vehicle(stream, track, hull)
        _log_rays(stream, track, ray_directions)
        _log_scalars(stream, track)


def _log_properties(stream: Any, track: Track) -> None:
    import rerun as rr

    stream.send_recording_name(f"seed {track.seed}: {track.outcome}")
    stream.send_property(
        "episode",
        rr.AnyValues(seed=track.seed, start=track.start_index, outcome=track.outcome, collisions=track.num_collisions),
    )


def _log_vehicle(stream: Any, track: Track, hull: Capsule) -> None:
    """Log the hull, its motion, and the trail as one static line per decision, coloured by clearance."""
    import rerun as rr

    quaternions = track.orientations[:, [1, 2, 3, 0]]  # rerun's order is (x, y, z, w)
    motion = rr.Transform3D.columns(translation=track.positions, quaternion=quaternions)
    stream.send_columns("vehicle", [_time_column(track.times)], motion, strict=True)
    log_hull(stream, hull)
    segments = np.stack([track.positions[:-1], track.positions[1:]], axis=1)
    trail = rr.LineStrips3D(segments, colors=distance_colours(track.clearances[1:], NEAR_WALL * 4), radii=TRAIL_RADIUS)
    stream.log("trail", trail, static=True, strict=True)


def log_hull(stream: Any, hull: Capsule) -> None:
    """Log the hull, in the vehicle's frame, for all times."""
    import rerun as rr

    capsule = rr.Capsules3D(
        lengths=[hull.axis_length],
        radii=[hull.radius],
        translations=[[-0.5 * hull.axis_length, 0.0, 0.0]],
        quaternions=[rr.Quaternion(xyzw=Z_TO_X)],  # rerun's capsules lie along z, ours along x
        colors=HULL,
        fill_mode="solid",
    )
    stream.log("vehicle/hull", capsule, static=True, strict=True)


def _log_rays(stream: Any, track: Track, directions: Array) -> None:
    import rerun as rr

    every = -(-len(track.times) // MAX_RAY_STATES)
    ranges = track.rays[::every]
    num_states, num_rays = ranges.shape
    strips = np.zeros((num_states * num_rays, 2, 3), dtype=np.float32)
    strips[:, 1] = (ranges[..., None] * directions).reshape(-1, 3)
    colours = distance_colours(ranges.ravel(), float(track.rays.max()))
    columns = rr.LineStrips3D.columns(strips=strips, colors=colours).partition([num_rays] * num_states)
    stream.send_columns("vehicle/rays", [_time_column(track.times[::every])], columns, strict=True)
    stream.log("vehicle/rays", rr.LineStrips3D.from_fields(radii=RAY_RADIUS), static=True, strict=True)


def distance_colours(distances: Array, far: float) -> Any:
    """Return (N, 3) colours from red at no distance to pale blue at `far`."""
    share = np.clip(distances / far, 0.0, 1.0)[:, None]
    return (NEAR * (1.0 - share) + FAR * share).astype(np.uint8)


def _log_scalars(stream: Any, track: Track) -> None:
    import rerun as rr

    series = {
        "clearance": (track.times, track.clearances),
        "progress": (track.times, track.progress),
        "cost": (track.times, track.costs),
        **{f"reward/{term}": (track.times[1:], values) for term, values in track.reward_terms.items()},
    }
    for name, (times, values) in series.items():
        stream.send_columns(f"plots/{name}", [_time_column(times)], rr.Scalars.columns(scalars=values), strict=True)
    states = np.append(states_of(track.collided, track.clearances)[:-1], track.outcome)
    changes = np.flatnonzero(np.append(True, states[1:] != states[:-1]))
    columns = rr.StateChange.columns(state=states[changes].tolist())
    stream.send_columns("state", [_time_column(track.times[changes])], columns, strict=True)
    log_state_colours(stream)


def states_of(are_collided: Any, clearances: Any) -> Any:
    """Return what the state lane says of a vehicle under way."""
    return np.where(are_collided, "collision", np.where(np.asarray(clearances) < NEAR_WALL, "near wall", "cruise"))


def log_state_colours(stream: Any) -> None:
    """Log what the colours of the state lane mean."""
    import rerun as rr

    names = list(STATE_COLOURS)
    colours = rr.StateConfiguration(values=names, labels=names, colors=list(STATE_COLOURS.values()))
    stream.log("state", colours, static=True, strict=True)


def _time_column(times: Array) -> Any:
    import rerun as rr

    return rr.TimeColumn(TIMELINE, duration=times)


def dive_blueprint(cave: CaveModel, begin: Array, terms: list[str], is_live: bool = False) -> Any:
    """Return the layout: the whole cave, a close view that follows the vehicle, and the plots beside them.

    Args:
        cave: Where the dive is.
        begin: (3,) where the vehicle is first, m.
        terms: Entities of the reward's terms that are plotted.
        is_live: Whether the viewer shows what comes last.
    """
    import rerun.blueprint as rrb

    contents = ["+ /**", "- /plots/**", "- /state"]
    scenes = rrb.Vertical(
        rrb.Spatial3DView(contents=contents, name=cave.scenario.name, eye_controls=eye(cave), line_grid=False),
        rrb.Spatial3DView(contents=contents, name="vehicle", eye_controls=_following_eye(cave, begin), line_grid=False),
        row_shares=[2, 3],
    )
    plots = rrb.Vertical(
        rrb.StateTimelineView(origin="state", name="state"),
        rrb.TimeSeriesView(origin="plots/clearance", name="clearance, m"),
        rrb.TimeSeriesView(origin="plots/progress", name="progress, m"),
        rrb.TimeSeriesView(origin="plots/reward", contents=terms, name="reward, by term"),
        rrb.TimeSeriesView(origin="plots/cost", name="cost"),
        row_shares=[1, 2, 2, 2, 2],
    )
    play_state = "following" if is_live else None
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state=play_state)
    return rrb.Blueprint(rrb.Horizontal(scenes, plots, column_shares=[2, 1]), panel, collapse_panels=True)


def _lasting_terms(track: Track) -> list[str]:
    """Return the plots of reward terms that are paid more than once: a goal's 500 would flatten all others."""
    return [f"plots/reward/{name}" for name, values in track.reward_terms.items() if np.count_nonzero(values) > 1]


def _following_eye(cave: CaveModel, begin: Array) -> Any:
    """Return a camera that stays beside the vehicle."""
    import rerun.blueprint as rrb

    return rrb.EyeControls3D(
        position=begin + FOLLOW_DISTANCE * cave.aside,
        look_target=begin,
        eye_up=[0.0, 0.0, 1.0],
        tracking_entity="/vehicle",
    )
