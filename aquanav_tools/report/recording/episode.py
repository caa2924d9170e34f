"""One episode: cave, route, vehicle with its rays and trail, and the plots below, with a blueprint inside."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np

from aquanav_tools.report.dynamics import dynamics_document
from aquanav_tools.report.recording.cave import CaveModel, eye, log_cave, log_route
from aquanav_tools.report.recording.stream import Template, kept_layout, recording
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.types import Array, Mesh

MAX_RAY_STATES = 600
"""Beyond this number of states the rays are shown at every second, third, ... state."""
FOLLOW_DISTANCE = 2.5
"""Of the camera that follows the vehicle, m."""
TIMELINE = "time"
TRAIL_RADIUS, RAY_RADIUS = 0.015, 0.004
"""Of the lines drawn, m."""
CONTACT_RADIUS = 0.06
"""Of the ball where the hull came to touch the wall, m."""
CURRENT_SECONDS = 2.0
"""The current's arrow is as long as the way that the water goes in this time."""
COMMANDS = ("ballast", "steer", "thrust")
"""Columns of a trajectory's commands."""
PAID_ONCE = ("goal", "collision", "timeout")
"""Terms of the reward that would flatten the others' plots: a goal is worth 500."""

WATER = (72, 149, 239)
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


class Scene(Protocol):
    """Where an episode happened, and the vehicle in it."""

    identity: str
    """Of the place: recordings with the same one replace each other, where seed and start are the same too."""
    template: Template
    """The place and the hull."""
    ray_directions: Array
    """(R, 3) unit vectors in the body frame, in the order of the trajectories' rays."""
    commands: tuple[str, ...]
    """Those of COMMANDS that the vehicle obeys."""
    stroke: float
    """How much thicker lines are, and how much farther from a wall is near, than for a vehicle in a cave."""

    def layout_of(self, trajectory: Trajectory) -> Any:
        """Return the layout of a trajectory's recording."""

    def log_sea(self, stream: Any, trajectory: Trajectory) -> None:
        """Log the surface of the water over time, where there is one."""


class DiveScene:
    """What all recordings of one vehicle's dives in one cave have in common."""

    commands: tuple[str, ...] = COMMANDS
    stroke = 1.0

    def __init__(self, cave: CaveModel, vehicle: Mesh, ray_directions: Array) -> None:
        """Prepare them.

        Args:
            cave: Where the dives are.
            vehicle: How it looks, body frame, m, with colours.
            ray_directions: (R, 3) unit vectors in the body frame, in the order of the trajectories' rays.
        """
        import rerun as rr

        self.scenario, self.ray_directions = cave.scenario, ray_directions
        self.identity = f"{cave.scenario.name} {cave.scenario.content_hash}"

        def log_scene(stream: Any) -> None:
            log_cave(stream, cave)
            log_route(stream, cave.scenario)
            log_vehicle(stream, vehicle)
            stream.log("vehicle/rays", rr.LineStrips3D.from_fields(radii=RAY_RADIUS), static=True, strict=True)
            log_state_colours(stream)

        self.template = Template(log_scene, dive_blueprint(cave))
        self._drawn_layout: Any = None
        self._cave = cave

    def layout_of(self, trajectory: Trajectory) -> Any:
        """Return the layout: with the vehicle's dynamics beside the plots where the episode drew them."""
        if not trajectory.dynamics:
            return self.template.layout
        if self._drawn_layout is None:
            self._drawn_layout = kept_layout(dive_blueprint(self._cave, has_dynamics=True))
        return self._drawn_layout

    def log_sea(self, stream: Any, trajectory: Trajectory) -> None:
        """Do nothing: a cave is full of water."""


def record_episode(scene: Scene, trajectory: Trajectory, path: Path) -> None:
    """Write a recording of one episode.

    Args:
        scene: Where it happened.
        trajectory: What happened.
        path: The .rrd file; replaced when it exists.
    """
    identity = f"episode {scene.identity} {trajectory.seed} {trajectory.start_index}"
    with recording(path, identity, scene.layout_of(trajectory)) as stream:
        scene.template.send(stream)
        _log_properties(stream, trajectory)
        _log_dynamics(stream, trajectory)
        scene.log_sea(stream, trajectory)
        _log_motion(stream, trajectory, scene.stroke)
        _log_contacts(stream, trajectory, scene.stroke)
        _log_current(stream, trajectory)
        _log_rays(stream, trajectory, scene.ray_directions)
        _log_scalars(stream, trajectory, scene.commands)
        _log_states(stream, trajectory, scene.stroke)


def _log_properties(stream: Any, trajectory: Trajectory) -> None:
    import rerun as rr

    stream.send_recording_name(f"seed {trajectory.seed}: {trajectory.outcome}")
    stream.send_property(
        "episode",
        rr.AnyValues(
            seed=trajectory.seed,
            start=trajectory.start_index,
            outcome=trajectory.outcome,
            collisions=trajectory.num_collisions,
        ),
    )


def _log_dynamics(stream: Any, trajectory: Trajectory) -> None:
    """Log what the episode drew of its vehicle's dynamics, as a text to read and as properties."""
    import rerun as rr

    if trajectory.dynamics:
        text = rr.TextDocument(dynamics_document(trajectory.dynamics), media_type=rr.MediaType.MARKDOWN)
        stream.log("dynamics", text, static=True, strict=True)
        stream.send_property("dynamics", rr.AnyValues(**trajectory.dynamics))


def _log_motion(stream: Any, trajectory: Trajectory, stroke: float) -> None:
    """Log the hull's motion, and the trail as one static line per decision, coloured by clearance."""
    import rerun as rr

    quaternions = trajectory.orientations[:, [1, 2, 3, 0]]  # rerun's order is (x, y, z, w)
    motion = rr.Transform3D.columns(translation=trajectory.positions, quaternion=quaternions)
    stream.send_columns("vehicle", [_time_column(trajectory.times)], motion, strict=True)
    strips = _strips(np.stack([trajectory.positions[:-1], trajectory.positions[1:]], axis=1))
    colours = distance_colours(trajectory.clearances[1:], NEAR_WALL * 4 * stroke)
    trail = rr.LineStrips3D(strips, colors=colours, radii=TRAIL_RADIUS * stroke)
    stream.log("trail", trail, static=True, strict=True)


def _log_contacts(stream: Any, trajectory: Trajectory, stroke: float) -> None:
    """Log a ball wherever the hull came to touch the wall."""
    import rerun as rr

    places = trajectory.positions[trajectory.contact_states]
    if len(places):
        balls = rr.Points3D(places, colors=STATE_COLOURS["collision"], radii=CONTACT_RADIUS * stroke)
        stream.log("contacts", balls, static=True, strict=True)


def _log_current(stream: Any, trajectory: Trajectory) -> None:
    """Log which way the water flows past the vehicle, where it does."""
    import rerun as rr

    if not trajectory.currents.any():
        return
    arrows = rr.Arrows3D.columns(
        origins=trajectory.positions,
        vectors=CURRENT_SECONDS * trajectory.currents,
        colors=np.tile(np.array(WATER, dtype=np.uint8), (len(trajectory.times), 1)),
    )
    stream.send_columns("current", [_time_column(trajectory.times)], arrows, strict=True)


def _strips(corners: Array) -> Any:
    """Return (N, K, 3) corners as N lines of K corners each: rerun itself takes a second for 100,000."""
    import pyarrow as pa
    import rerun as rr

    count, num_corners, _ = corners.shape
    points = rr.encodings.Vec3DBatch(corners.reshape(-1, 3).astype(np.float32)).as_arrow_array()
    ends = pa.array(np.arange(count + 1, dtype=np.int32) * num_corners)
    return pa.ListArray.from_arrays(ends, points, type=rr.components.LineStrip3DBatch([]).as_arrow_array().type)


def log_vehicle(stream: Any, vehicle: Mesh) -> None:
    """Log how the vehicle looks, in its own frame, for all times."""
    import rerun as rr

    solid = vehicle.to_trimesh()
    mesh = rr.Mesh3D(
        vertex_positions=vehicle.vertices.astype(np.float32),
        triangle_indices=vehicle.faces.astype(np.uint32),
        vertex_normals=np.asarray(solid.vertex_normals, dtype=np.float32),
        vertex_colors=vehicle.colours,
    )
    stream.log("vehicle/hull", mesh, static=True, strict=True)


def _log_rays(stream: Any, trajectory: Trajectory, directions: Array) -> None:
    import rerun as rr

    every = -(-len(trajectory.times) // MAX_RAY_STATES)
    ranges = trajectory.rays[::every]
    num_states, num_rays = ranges.shape
    corners = np.zeros((num_states * num_rays, 2, 3), dtype=np.float32)
    corners[:, 1] = (ranges[..., None] * directions).reshape(-1, 3)
    colours = distance_colours(ranges.ravel(), float(trajectory.rays.max()))
    columns = rr.LineStrips3D.columns(strips=_strips(corners), colors=colours).partition([num_rays] * num_states)
    stream.send_columns("vehicle/rays", [_time_column(trajectory.times[::every])], columns, strict=True)


def distance_colours(distances: Array, far: float) -> Any:
    """Return (N, 3) colours from red at no distance to pale blue at `far`."""
    share = np.clip(distances / far, 0.0, 1.0)[:, None]
    return (NEAR * (1.0 - share) + FAR * share).astype(np.uint8)


def _log_scalars(stream: Any, trajectory: Trajectory, commands: tuple[str, ...]) -> None:
    import rerun as rr

    series = {
        "clearance": (trajectory.times, trajectory.clearances),
        "progress": (trajectory.times, trajectory.progress),
        "cost": (trajectory.times, trajectory.costs),
        **{f"reward/{term}": (trajectory.times[1:], values) for term, values in trajectory.reward_terms.items()},
        **{
            f"command/{name}": (trajectory.times[:-1], trajectory.commands[:, COMMANDS.index(name)])
            for name in commands
        },
    }
    for name, (times, values) in series.items():
        stream.send_columns(f"plots/{name}", [_time_column(times)], rr.Scalars.columns(scalars=values), strict=True)


def _log_states(stream: Any, trajectory: Trajectory, stroke: float) -> None:
    """Log what the vehicle was at, wherever that changes."""
    import rerun as rr

    states = np.append(states_of(trajectory.collided, trajectory.clearances / stroke)[:-1], trajectory.outcome)
    changes = np.flatnonzero(np.append(True, states[1:] != states[:-1]))
    columns = rr.StateChange.columns(state=states[changes].tolist())
    stream.send_columns("state", [_time_column(trajectory.times[changes])], columns, strict=True)


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


def dive_blueprint(cave: CaveModel, is_live: bool = False, has_dynamics: bool = False) -> Any:
    """Return the layout: the whole cave, a close view that follows the vehicle, and the plots beside them.

    Args:
        cave: Where the dive is.
        is_live: Whether the viewer shows what comes last.
        has_dynamics: Whether the episode drew its vehicle's dynamics, which are then told below the plots.
    """
    return layout(cave.scenario.name, eye(cave), _following_eye(cave), is_live, has_dynamics)


def layout(name: str, whole_eye: Any, following_eye: Any, is_live: bool = False, has_dynamics: bool = False) -> Any:
    """Return a layout of two views, each with its camera, and the plots beside them; see `dive_blueprint`."""
    import rerun.blueprint as rrb

    contents = ["+ /**", "- /plots/**", "- /state", "- /dynamics"]
    lasting = ["+ /plots/reward/**", *(f"- /plots/reward/{term}" for term in PAID_ONCE)]
    scenes = rrb.Vertical(
        rrb.Spatial3DView(contents=contents, name=name, eye_controls=whole_eye, line_grid=False),
        rrb.Spatial3DView(contents=contents, name="vehicle", eye_controls=following_eye, line_grid=False),
        row_shares=[2, 3],
    )
    plots = [
        rrb.StateTimelineView(origin="state", name="state"),
        rrb.TimeSeriesView(origin="plots/clearance", name="clearance, m"),
        rrb.TimeSeriesView(origin="plots/progress", name="progress, m"),
        rrb.TimeSeriesView(origin="plots/reward", contents=lasting, name="reward, by term"),
        rrb.TimeSeriesView(origin="plots/cost", name="cost"),
    ]
    if not is_live:  # where an environment does not tell its commands
        plots.append(rrb.TimeSeriesView(origin="plots/command", name="command, share of the full"))
    shares = [1] + [2] * (len(plots) - 1)
    if has_dynamics:
        plots.append(rrb.TextDocumentView(origin="dynamics", name="dynamics"))
        shares.append(4)
    beside = rrb.Vertical(*plots, row_shares=shares)
    play_state = "following" if is_live else None
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state=play_state)
    return rrb.Blueprint(rrb.Horizontal(scenes, beside, column_shares=[2, 1]), panel, collapse_panels=True)


def _following_eye(cave: CaveModel) -> Any:
    """Return a camera that stays beside the vehicle. Only its direction counts: the viewer brings it there."""
    import rerun.blueprint as rrb

    begin = cave.scenario.guide.centres[0]
    return rrb.EyeControls3D(
        position=begin + FOLLOW_DISTANCE * cave.aside,
        look_target=begin,
        eye_up=[0.0, 0.0, 1.0],
        tracking_entity="/vehicle",
    )
