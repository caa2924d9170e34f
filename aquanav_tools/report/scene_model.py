"""The 3D view of a report: a cave with its route, a vehicle to scale, and the trails of episodes, as a GLB."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.cavity import WALL
from aquanav_tools.report.glb import Part, glb, line
from aquanav_tools.report.trajectory import TrajectorySummary
from aquanav_tools.report.viewer_model import PORTAL_COLOUR, cave_part
from aquanav_tools.types import Array, Mesh, Pose, rotation_matrix

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

MAX_TRIANGLES = 30_000
"""Of the cave: 0.9 MB, and 1.2 MB in a page."""
MAX_POINTS = 150
"""Of a trail: 3 kB."""
ROUTE = (255, 183, 3)
CLEAN, TOUCHED = (120, 220, 190), (240, 70, 70)
"""Trails of episodes without and with a contact."""
LOW, HIGH = np.array([38.0, 84.0, 124.0]), np.array([226.0, 214.0, 190.0])
"""Colours of the lowest and the highest wall."""


def write_scene(
    scenario: Scenario,
    path: Path,
    vehicle: tuple[Mesh, Pose] | None = None,
    trajectories: Sequence[TrajectorySummary] = (),
    colours: npt.NDArray[np.uint8] | None = None,
) -> None:
    """Write a cave as a GLB for `html.Model`.

    Args:
        scenario: The cave.
        path: Of the file.
        vehicle: How it looks, body frame, m, with colours; and where it is shown.
        trajectories: Of episodes.
        colours: (V, 3) sRGB per vertex of the cavity; None for colours by height.
    """
    shown = by_height(scenario.cavity.mesh.vertices) if colours is None else colours
    parts = [cave_part(scenario.cavity, scenario.collision, MAX_TRIANGLES, shown)]
    parts.append(line("route", scenario.guide.centreline, ROUTE))
    goal = scenario.guide.panels[-1].polygon
    parts.append(line("goal", np.vstack([goal, goal[:1]]), PORTAL_COLOUR))
    parts += [
        line(f"trail-{n}", _some(trajectory.positions), TOUCHED if trajectory.num_collisions else CLEAN)
        for n, trajectory in enumerate(trajectories)
    ]
    if vehicle is not None:
        parts.append(_placed(*vehicle))
    path.write_bytes(glb(parts))


def by_height(vertices: Array) -> npt.NDArray[np.uint8]:
    """Return (V, 3) sRGB colours from the lowest to the highest of (V, 3) vertices."""
    heights = vertices[:, 2]
    share = (heights - heights.min()) / max(float(np.ptp(heights)), 1e-9)
    return np.round(LOW + share[:, None] * (HIGH - LOW)).astype(np.uint8)


def scene_caption(
    scenario: Scenario, num_trajectories: int = 0, total: int = 0, *, has_own_colours: bool = False
) -> str:
    """Return what the view shows and how it is turned; its own colours are those of the scan or the photos."""
    labels, observed = scenario.cavity.labels, scenario.cavity.observed
    wall = "the wall in its own colours" if has_own_colours else "pale wall high and blue wall low"
    guessed = "" if observed[labels == WALL].all() else ", pink where it was filled in"
    portals = "; portals are orange" if (labels != WALL).any() else ""
    trails = (
        f" Trails of {num_trajectories} of {total} episodes, red where the hull touched the wall."
        if num_trajectories
        else ""
    )
    return (
        f"The cave in 3D with its route in yellow{portals}, the vehicle to scale, {wall}{guessed}."
        f"{trails} Drag to turn, right button or Shift to move, wheel to zoom, double-click to begin again."
    )


def _some(points: Array) -> Array:
    """Return at most MAX_POINTS of (N, 3) points, the last among them."""
    rows = np.unique(np.linspace(0, len(points) - 1, min(len(points), MAX_POINTS)).round().astype(np.int64))
    found: Array = points[rows]
    return found


def _placed(mesh: Mesh, pose: Pose) -> Part:
    turn = rotation_matrix(pose.orientation)
    assert mesh.colours is not None, "a vehicle has colours"
    normals = np.asarray(mesh.to_trimesh().vertex_normals)
    return Part(
        "vehicle", mesh.vertices @ turn.T + pose.position, mesh.colours.astype(np.float64), mesh.faces, normals @ turn.T
    )
