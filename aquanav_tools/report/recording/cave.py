"""The cave in a recording: its surface, its route, and a recording of it alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aquanav_tools.report.recording.stream import recording
from aquanav_tools.report.relief import plan_and_section
from aquanav_tools.types import Mesh, rotation_matrix

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

MAX_CAVE_TRIANGLES = 20_000
"""Beyond this the cave in a recording is simplified, by 3 cm in a cave of 59,000 that is 32 m long: packing those into
every recording took a third of its time and 0.8 MB."""
FIRST_DEVIATION = 0.004
"""Of the smallest extent; tried first."""

ROCK = (126, 150, 160)
ROUTE = (255, 183, 3)
PANEL = (230, 240, 245, 140)
GOAL = (251, 86, 7)
HULL = (255, 200, 40)


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
    tolerance = FIRST_DEVIATION * float(np.ptp(mesh.vertices, axis=0).min())
    while solid.num_tri() > max_triangles:
        solid = solid.simplify(tolerance)
        tolerance *= 1.5
    simple = solid.to_mesh64()
    return Mesh(np.array(simple.vert_properties)[:, :3], np.array(simple.tri_verts, dtype=np.int64))


def record_cave(cave: CaveModel, path: Path) -> None:
    """Write a recording of a cave alone: surface, portals, route, panels and starts."""
    import rerun.blueprint as rrb

    scenario = cave.scenario
    view = rrb.Spatial3DView(origin="/", name=scenario.name, eye_controls=eye(cave), line_grid=False)
    blueprint = rrb.Blueprint(view, collapse_panels=True)
    with recording(path, f"cave {scenario.name} {scenario.content_hash}", blueprint) as stream:
        log_cave(stream, cave)
        log_route(stream, scenario)
        _log_starts(stream, scenario)


def log_cave(stream: Any, cave: CaveModel) -> None:
    """Log the cave for all times, and which way is up."""
    import rerun as rr

    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    log_surface(stream, cave, static=True)


def log_surface(stream: Any, cave: CaveModel, static: bool) -> None:
    """Log the cave with its inner side only, so that from outside one looks through the near wall into it."""
    import rerun as rr

    surface = rr.Mesh3D(
        vertex_positions=cave.mesh.vertices.astype(np.float32),
        triangle_indices=cave.mesh.faces[:, ::-1].astype(np.uint32),  # turned round: the front is the water's side
        vertex_normals=-cave.normals,
        albedo_factor=ROCK,
        face_rendering=rr.components.MeshFaceRendering.Front,
    )
    stream.log("cave", surface, static=static)


def log_route(stream: Any, scenario: Scenario) -> None:
    """Log the way through the cave with its panels."""
    import rerun as rr

    guide = scenario.guide
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


def eye(cave: CaveModel) -> Any:
    """Return a camera that looks at the long side of the cave from a little above."""
    import rerun.blueprint as rrb

    low, high = cave.mesh.vertices.min(axis=0), cave.mesh.vertices.max(axis=0)
    plan, _ = plan_and_section(cave.scenario.guide.centreline)
    length, width = np.ptp(plan.project(cave.mesh.vertices), axis=0)
    distance = 0.3 * length + 0.6 * (width + high[2] - low[2])  # chosen by eye, for a pane wider than high
    centre = 0.5 * (low + high)
    return rrb.EyeControls3D(position=centre + distance * cave.aside, look_target=centre, eye_up=[0.0, 0.0, 1.0])
