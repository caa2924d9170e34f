"""A bay in a recording: rocks, reefs, the goal, the shortest way, the boat, and the sea that moves around it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from aquanav_tools.report.recording.cave import GOAL, ROUTE
from aquanav_tools.report.recording.episode import RAY_RADIUS, TIMELINE, layout, log_state_colours, log_vehicle
from aquanav_tools.report.recording.stream import Template
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.sea.sea_map import SeaMap, ShortestPath, rock_solid
from aquanav_tools.types import Array, Mesh

STROKE = 8.0
ROCK, REEF = (122, 105, 90), (60, 160, 165)
STILL_SEA, SEA = (28, 78, 105, 120), (40, 110, 140, 200)
PATCH, CELL = 40.0, 1.25
"""Side of the piece of the sea that moves around the boat, and of its squares, m."""
SEA_EVERY = 0.5
"""Between two pictures of it, s: more would make up most of a recording."""
BUOY_RADIUS, BUOY_HEIGHT = 0.6, 4.0
"""m."""
FOLLOW = np.array([-16.0, 0.0, 9.0])
"""From the boat to the camera that follows it, m."""


class BayScene:
    """One bay with its boat."""

    commands: tuple[str, ...] = ("steer", "thrust")
    stroke = STROKE

    def __init__(
        self,
        identity: str,
        bay: SeaMap,
        path: ShortestPath,
        boat: Mesh,
        beams: Array,
        rise: Callable[[Array, float], Array],
    ) -> None:
        """Prepare what of a voyage does not hang on the policy.

        Args:
            identity: Of the scenario.
            bay: Where it is.
            path: The shortest one.
            boat: How it looks, body frame, m, with colours.
            beams: (R, 3) directions of the sensor's beams, body frame.
            rise: Returns (N,) how far the sea stands above still water at (N, 2) places after a time, m and s.
        """
        import rerun as rr

        self.identity, self.ray_directions, self._rise, self._bay = identity, beams, rise, bay

        def log_scene(stream: Any) -> None:
            stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
            _log_bay(stream, bay, path)
            log_vehicle(stream, boat)
            stream.log("vehicle/rays", rr.LineStrips3D.from_fields(radii=RAY_RADIUS * STROKE), static=True, strict=True)
            log_state_colours(stream)

        self.template = Template(log_scene, self._layout())

    def layout_of(self, trajectory: Trajectory) -> Any:
        """Return the layout, which is the same for all."""
        return self.template.layout

    def log_sea(self, stream: Any, trajectory: Trajectory) -> None:
        """Log the water around the boat as it rises and falls."""
        import rerun as rr

        step = (
            max(round(SEA_EVERY / float(trajectory.times[1] - trajectory.times[0])), 1)
            if len(trajectory.times) > 1
            else 1
        )
        states = range(0, len(trajectory.times), step)
        side = int(PATCH / CELL) + 1
        grid = (np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2) - 0.5 * side) * CELL
        patches = []
        for state in states:
            places = grid + np.round(trajectory.positions[state, :2] / CELL) * CELL
            patches.append(np.column_stack([places, self._rise(places, float(trajectory.times[state]))]))
        faces = _grid_faces(side)
        stream.log("sea", rr.Mesh3D.from_fields(triangle_indices=faces, albedo_factor=SEA), static=True)
        vertices = np.concatenate(patches).astype(np.float32)
        normals = np.concatenate([_grid_normals(patch, side) for patch in patches])
        columns = rr.Mesh3D.columns(vertex_positions=vertices, vertex_normals=normals).partition(
            [side**2] * len(states)
        )
        stream.send_columns(
            "sea", [rr.TimeColumn(TIMELINE, duration=trajectory.times[list(states)])], columns, strict=True
        )

    def _layout(self) -> Any:
        import rerun.blueprint as rrb

        low, high = self._bay.edge[:2], self._bay.edge[2:]
        middle = np.array([*(0.5 * (low + high)), 0.0])
        width, height = high - low
        above = middle + np.array([0.0, -0.55 * float(height) - 0.25 * float(width), 0.55 * float(width)])
        start = np.array([*self._bay.starts[0].position, 0.0])
        up = [0.0, 0.0, 1.0]
        return layout(
            self._bay.name,
            rrb.EyeControls3D(position=above, look_target=middle, eye_up=up),
            rrb.EyeControls3D(position=start + FOLLOW, look_target=start, eye_up=up, tracking_entity="/vehicle"),
        )


def _log_bay(stream: Any, bay: SeaMap, path: ShortestPath) -> None:
    import rerun as rr

    for kind, colour in (("rocks", ROCK), ("reefs", REEF)):
        solids = [rock_solid(rock, bay.depth) for rock in bay.rocks if rock.is_reef == (kind == "reefs")]
        if solids:
            corners = np.concatenate([solid.triangles.reshape(-1, 3) for solid in solids])  # none shared: edges show
            _log_solid(stream, kind, Mesh(corners, np.arange(len(corners)).reshape(-1, 3)), colour)
    (west, south), (east, north) = bay.edge[:2], bay.edge[2:]
    corners = np.array([[west, south, -0.05], [east, south, -0.05], [east, north, -0.05], [west, north, -0.05]])
    still = rr.Mesh3D(vertex_positions=corners, triangle_indices=[[0, 1, 2], [0, 2, 3]], albedo_factor=STILL_SEA)
    stream.log("still-sea", still, static=True)
    level = np.column_stack([path.points, np.full(len(path.points), 0.3)])
    stream.log("route/shortest-way", rr.LineStrips3D([level], colors=ROUTE, radii=0.012 * STROKE), static=True)
    posts = [[[*corner, -0.5], [*corner, BUOY_HEIGHT]] for corner in bay.goal.corners]
    stream.log("route/goal", rr.LineStrips3D(posts, colors=GOAL, radii=BUOY_RADIUS), static=True)


def _log_solid(stream: Any, entity: str, mesh: Mesh, colour: tuple[int, int, int]) -> None:
    import rerun as rr

    normals = np.asarray(mesh.to_trimesh().vertex_normals, dtype=np.float32)
    solid = rr.Mesh3D(
        vertex_positions=mesh.vertices.astype(np.float32),
        triangle_indices=mesh.faces.astype(np.uint32),
        vertex_normals=normals,
        albedo_factor=colour,
    )
    stream.log(entity, solid, static=True, strict=True)


def _grid_faces(side: int) -> Any:
    """Return the triangles of a square grid of corners, row by row."""
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    lower = np.stack([first, first + 1, first + side + 1], axis=1)
    upper = np.stack([first, first + side + 1, first + side], axis=1)
    return np.concatenate([lower, upper]).astype(np.uint32)


def _grid_normals(vertices: Array, side: int) -> Any:
    """Return the (V, 3) normals of a grid's surface."""
    north, east = np.gradient(vertices[:, 2].reshape(side, side), CELL)
    normals = np.stack([-east.ravel(), -north.ravel(), np.ones(side**2)], axis=1)
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
