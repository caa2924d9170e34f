"""A passage that winds sideways and up and down, with known clearance: its goal is out of sight of its start."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools.cave.cavity import WALL, Cavity, Portal
from aquanav_tools.cave.route.guide import Guide, Panel
from aquanav_tools.cave.route.starts import Start
from aquanav_tools.geometry.volume.field import DistanceField, field_from_dense
from aquanav_tools.scenario.schema import BuiltBy, GoalSettings, Scenario, ScenarioSettings
from aquanav_tools.synthetic.caves import sweep
from aquanav_tools.types import Pose, yaw_quaternion

RADIUS = 1.1
SECTIONS = 48


def winding_scenario(num_starts: int = 10) -> Scenario:
    """25 m along +x, swinging 2.5 m to either side and 0.8 m up and down, radius 1.1 m."""
    x = np.linspace(0.0, 25.0, 401)
    line = np.stack([x, 2.5 * np.sin(x / 4.0), 0.8 * np.sin(x / 5.0)], axis=1)
    ahead = np.gradient(line, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])

    panels = tuple(_panel(line[i], ahead[i], arc[i] - arc[16]) for i in range(16, 401, 16))[:-1]
    guide = Guide(line[16:], panels)
    goal_arc = arc[16] + guide.length
    starts = tuple(
        Start(
            Pose(line[i] + [0.0, 0.0, 0.2 * (-1) ** i], yaw_quaternion(float(np.arctan2(ahead[i, 1], ahead[i, 0])))),
            RADIUS - 0.2,
            float(goal_arc - arc[i]),
            float((goal_arc - arc[i]) / guide.length),
        )
        for i in np.linspace(20, 150, num_starts).astype(int)
    )
    settings = ScenarioSettings(
        "winding", BuiltBy("test", "synthetic"), GoalSettings(tuple(guide.centres[-1].tolist()))
    )
    cavity = _cavity(line, ahead)
    return Scenario(settings, cavity, cavity.mesh, _field(line), guide, starts)


def _panel(centre: np.ndarray, normal: np.ndarray, arc_length: float) -> Panel:
    side = np.cross([0.0, 0.0, 1.0], normal) / np.linalg.norm(normal[:2])
    turn = np.linspace(0.0, 2 * np.pi, SECTIONS, endpoint=False)[:, None]
    ring = centre + RADIUS * (np.cos(turn) * side + np.sin(turn) * np.cross(normal, side))
    return Panel(centre, normal, ring, float(arc_length), RADIUS)


def _cavity(line: np.ndarray, ahead: np.ndarray) -> Cavity:
    swept = sweep(line, RADIUS, SECTIONS)
    labels = np.full(len(swept.truth.faces), WALL)
    labels[-2 * SECTIONS : -SECTIONS], labels[-SECTIONS:] = 1, 2
    area = np.pi * RADIUS**2
    portals = (Portal(1, line[0], -ahead[0], area), Portal(2, line[-1], ahead[-1], area))
    return Cavity(swept.truth, labels, labels == WALL, portals)


def _field(line: np.ndarray, spacing: float = 0.1) -> DistanceField:
    """The tube's clearance; the lids, which no episode here reaches, do not count."""
    low, high = line.min(axis=0) - RADIUS - 0.3, line.max(axis=0) + RADIUS + 0.3
    axes = [np.arange(a, b, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance, _ = cKDTree(line).query(points, distance_upper_bound=RADIUS + 0.4)
    return field_from_dense(low, spacing, (RADIUS - np.minimum(distance, RADIUS + 0.4)).astype(np.float32))
