"""Rerun recordings: what happened, to look at in 3D and over time. The only importer of rerun.

One file per episode, with a blueprint inside: cave, route, vehicle with its rays and trail, and the plots below.
"""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aquanav_tools.report.relief import plan_and_section
from aquanav_tools.report.track import Track
from aquanav_tools.types import Array, Capsule, Mesh, rotation_matrix

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

APPLICATION = "aquanav"
MAX_CAVE_TRIANGLES = 60_000
"""Beyond this the cave in a recording is simplified: 1.1 MB of 2 MB per episode at this number."""
MAX_RAY_STATES = 600
"""Beyond this number of states the rays are shown at every second, third, ... state."""
FOLLOW_DISTANCE = 2.5
"""Of the camera that follows the vehicle, m."""
TIMELINE = "time"

ROCK = (126, 150, 160)
ROUTE = (255, 183, 3)
PANEL = (230, 240, 245, 140)
GOAL = (251, 86, 7)
HULL = (255, 200, 40)
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


class CaveModel:
    """What all recordings of one cave share, prepared once: the simplified cave with its shading."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        is_small = len(scenario.cavity.mesh.faces) <= MAX_CAVE_TRIANGLES
        self.mesh = scenario.cavity.mesh if is_small else thin(scenario.collision, MAX_CAVE_TRIANGLES)
        self.normals = np.asarray(self.mesh.to_trimesh().vertex_normals, dtype=np.float32)
        _, section = plan_and_section(scenario.guide.centreline)
        self.aside = section.towards + np.array([0.0, 0.0, 0.6])
        """(3,) from the cave to a viewer at its long side and a little above."""


def thin(mesh: Mesh, max_triangles: int) -> Mesh:
    """Return a closed mesh with at most about `max_triangles` triangles, by allowing ever larger deviations."""
    if len(mesh.faces) <= max_triangles:
        return mesh
    from aquanav_tools.cave.cavity import to_manifold

    solid = to_manifold(mesh)
    tolerance = 0.002 * float(np.ptp(mesh.vertices, axis=0).min())
    while solid.num_tri() > max_triangles:
        solid = solid.simplify(tolerance)
        tolerance *= 1.5
    simple = solid.to_mesh64()
    return Mesh(np.array(simple.vert_properties)[:, :3], np.array(simple.tri_verts, dtype=np.int64))


def record_cave(cave: CaveModel, path: Path) -> None:
    """Write a recording of a cave alone: surface, portals, route, panels and starts."""
    import rerun.blueprint as rrb

    scenario = cave.scenario
    view = rrb.Spatial3DView(origin="/", name=scenario.name, eye_controls=_eye(cave), line_grid=False)
    blueprint = rrb.Blueprint(view, collapse_panels=True)
    with _recording(path, f"cave {scenario.name} {scenario.content_hash}", blueprint) as stream:
        _log_cave(stream, cave)
        _log_starts(stream, scenario)


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
    with _recording(path, identity, _episode_blueprint(cave, track)) as stream:
        _log_properties(stream, track)
        _log_cave(stream, cave)
        _log_vehicle(stream, track, hull)
        _log_rays(stream, track, ray_directions)
        _log_scalars(stream, track)


@contextmanager
def _recording(path: Path, identity: str, blueprint: Any) -> Iterator[Any]:
    """Open a stream into a file that appears under its name only when complete.

    The recording's id follows from `identity`, so that a repeated run replaces its recording in the viewer.
    """
    import rerun as rr

    recording_id = uuid.uuid5(uuid.NAMESPACE_OID, identity)
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    partial = path.with_name(path.name + ".partial")
    stream.save(partial, default_blueprint=blueprint)
    try:
        yield stream
    finally:
        stream.disconnect()
    os.replace(partial, path)


def _log_properties(stream: Any, track: Track) -> None:
    import rerun as rr

    stream.send_recording_name(f"seed {track.seed}: {track.outcome}")
    stream.send_property(
        "episode",
        rr.AnyValues(seed=track.seed, start=track.start_index, outcome=track.outcome, collisions=track.num_collisions),
    )


def _log_cave(stream: Any, cave: CaveModel) -> None:
    """Log the cave with its inner side only, so that from outside one looks through the near wall into it."""
    import rerun as rr

    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    surface = rr.Mesh3D(
        vertex_positions=cave.mesh.vertices.astype(np.float32),
        triangle_indices=cave.mesh.faces[:, ::-1].astype(np.uint32),  # turned round: the front is the water's side
        vertex_normals=-cave.normals,
        albedo_factor=ROCK,
        face_rendering=rr.components.MeshFaceRendering.Front,
    )
    stream.log("cave", surface, static=True)
    guide = cave.scenario.guide
    outlines = [np.vstack([panel.polygon, panel.polygon[:1]]) for panel in guide.panels]
    stream.log("route/centreline", rr.LineStrips3D([guide.centreline], colors=ROUTE, radii=0.012), static=True)
    stream.log("route/panels", rr.LineStrips3D(outlines[:-1], colors=PANEL, radii=0.008), static=True)
    stream.log("route/goal", rr.LineStrips3D(outlines[-1:], colors=GOAL, radii=0.03), static=True)
    ends = rr.Points3D(guide.centres[[0, -1]], labels=["entrance", "goal"], colors=[ROUTE, GOAL], radii=0.06)
    stream.log("route/ends", ends, static=True)


def _log_starts(stream: Any, scenario: Scenario) -> None:
    import rerun as rr

    positions = [start.pose.position for start in scenario.starts]
    ahead = [0.3 * rotation_matrix(start.pose.orientation)[:, 0] for start in scenario.starts]
    labels = [f"start {index}" for index in range(len(scenario.starts))]
    arrows = rr.Arrows3D(origins=positions, vectors=ahead, colors=HULL, labels=labels, show_labels=False)
    stream.log("starts", arrows, static=True)


def _log_vehicle(stream: Any, track: Track, hull: Capsule) -> None:
    """Log the hull, its motion, and the trail as one static line per decision, coloured by clearance."""
    import rerun as rr

    quaternions = track.orientations[:, [1, 2, 3, 0]]  # rerun's order is (x, y, z, w)
    motion = rr.Transform3D.columns(translation=track.positions, quaternion=quaternions)
    stream.send_columns("vehicle", [_time_column(track.times)], motion, strict=True)
    capsule = rr.Capsules3D(
        lengths=[hull.axis_length],
        radii=[hull.radius],
        translations=[[-0.5 * hull.axis_length, 0.0, 0.0]],
        quaternions=[rr.Quaternion(xyzw=Z_TO_X)],  # rerun's capsules lie along z, ours along x
        colors=HULL,
        fill_mode="solid",
    )
    stream.log("vehicle/hull", capsule, static=True, strict=True)
    segments = np.stack([track.positions[:-1], track.positions[1:]], axis=1)
    trail = rr.LineStrips3D(segments, colors=_distance_colours(track.clearances[1:], NEAR_WALL * 4), radii=0.015)
    stream.log("trail", trail, static=True, strict=True)


def _log_rays(stream: Any, track: Track, directions: Array) -> None:
    import rerun as rr

    every = -(-len(track.times) // MAX_RAY_STATES)
    ranges = track.rays[::every]
    num_states, num_rays = ranges.shape
    strips = np.zeros((num_states * num_rays, 2, 3), dtype=np.float32)
    strips[:, 1] = (ranges[..., None] * directions).reshape(-1, 3)
    colours = _distance_colours(ranges.ravel(), float(track.rays.max()))
    columns = rr.LineStrips3D.columns(strips=strips, colors=colours).partition([num_rays] * num_states)
    stream.send_columns("vehicle/rays", [_time_column(track.times[::every])], columns, strict=True)
    stream.log("vehicle/rays", rr.LineStrips3D.from_fields(radii=0.004), static=True, strict=True)


def _distance_colours(distances: Array, far: float) -> Any:
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
    states = np.where(track.collided, "collision", np.where(track.clearances < NEAR_WALL, "near wall", "cruise"))
    states = np.append(states[:-1], track.outcome)
    changes = np.flatnonzero(np.append(True, states[1:] != states[:-1]))
    columns = rr.StateChange.columns(state=states[changes].tolist())
    stream.send_columns("state", [_time_column(track.times[changes])], columns, strict=True)
    stream.log("state", _state_colours(), static=True, strict=True)


def _state_colours() -> Any:
    import rerun as rr

    names = list(STATE_COLOURS)
    return rr.StateConfiguration(values=names, labels=names, colors=list(STATE_COLOURS.values()))


def _time_column(times: Array) -> Any:
    import rerun as rr

    return rr.TimeColumn(TIMELINE, duration=times)


def _episode_blueprint(cave: CaveModel, track: Track) -> Any:
    """Return the layout: the whole cave, a close view that follows the vehicle, and the plots beside them."""
    import rerun.blueprint as rrb

    contents = ["+ /**", "- /plots/**", "- /state"]
    scenes = rrb.Vertical(
        rrb.Spatial3DView(contents=contents, name=cave.scenario.name, eye_controls=_eye(cave), line_grid=False),
        rrb.Spatial3DView(contents=contents, name="vehicle", eye_controls=_following_eye(cave, track), line_grid=False),
        row_shares=[2, 3],
    )
    plots = rrb.Vertical(
        rrb.StateTimelineView(origin="state", name="state"),
        rrb.TimeSeriesView(origin="plots/clearance", name="clearance, m"),
        rrb.TimeSeriesView(origin="plots/progress", name="progress, m"),
        rrb.TimeSeriesView(origin="plots/reward", contents=_lasting_terms(track), name="reward, by term"),
        rrb.TimeSeriesView(origin="plots/cost", name="cost"),
        row_shares=[1, 2, 2, 2, 2],
    )
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(scenes, plots, column_shares=[2, 1]), panel, collapse_panels=True)


def _lasting_terms(track: Track) -> list[str]:
    """Return the plots of reward terms that are paid more than once: a goal's 500 would flatten all others."""
    return [f"plots/reward/{name}" for name, values in track.reward_terms.items() if np.count_nonzero(values) > 1]


def _eye(cave: CaveModel) -> Any:
    """Return a camera that looks at the long side of the cave from a little above."""
    import rerun.blueprint as rrb

    low, high = cave.mesh.vertices.min(axis=0), cave.mesh.vertices.max(axis=0)
    plan, _ = plan_and_section(cave.scenario.guide.centreline)
    length, width = np.ptp(plan.project(cave.mesh.vertices), axis=0)
    distance = 0.3 * length + 0.6 * (width + high[2] - low[2])  # chosen by eye, for a pane wider than high
    centre = 0.5 * (low + high)
    return rrb.EyeControls3D(position=centre + distance * cave.aside, look_target=centre, eye_up=[0.0, 0.0, 1.0])


def _following_eye(cave: CaveModel, track: Track) -> Any:
    """Return a camera that stays beside the vehicle."""
    import rerun.blueprint as rrb

    begin = track.positions[0]
    return rrb.EyeControls3D(
        position=begin + FOLLOW_DISTANCE * cave.aside,
        look_target=begin,
        eye_up=[0.0, 0.0, 1.0],
        tracking_entity="/vehicle",
    )
