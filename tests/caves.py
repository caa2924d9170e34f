"""Tiny caves with known answers."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import trimesh

from aquanav_tools.cave.cavity import WALL, Cavity, Portal
from aquanav_tools.cave.route.guide import Guide, Panel
from aquanav_tools.cave.route.starts import Start
from aquanav_tools.geometry.volume.field import DistanceField, field_from_dense
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import BuiltBy, GoalSettings, LimitSettings, Scenario, ScenarioSettings
from aquanav_tools.types import Mesh, Pose, yaw_quaternion

TUBE_RADIUS = 2.0
TUBE_LENGTH = 20.0
SECTIONS = 64


def tube_cavity() -> Cavity:
    """A tube along +x from x = 0 to TUBE_LENGTH, a portal at either end (1 at x = 0, 2 at the far end)."""
    solid = trimesh.creation.cylinder(TUBE_RADIUS, TUBE_LENGTH, sections=SECTIONS)
    to_x = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])
    solid.apply_transform(to_x)
    solid.apply_translation([TUBE_LENGTH / 2, 0, 0])
    labels = np.full(len(solid.faces), WALL)
    labels[solid.face_normals[:, 0] < -0.9] = 1
    labels[solid.face_normals[:, 0] > 0.9] = 2
    portals = tuple(
        Portal(
            label, np.array([x, 0.0, 0.0]), np.array([sign, 0.0, 0.0]), float(solid.area_faces[labels == label].sum())
        )
        for label, x, sign in ((1, 0.0, -1.0), (2, TUBE_LENGTH, 1.0))
    )
    mesh = Mesh(np.array(solid.vertices), np.array(solid.faces, dtype=np.int64))
    return Cavity(mesh, labels.astype(np.int64), labels == WALL, portals)


def tube_clearance(points: np.ndarray) -> np.ndarray:
    """Exact clearance inside the tube; outside, minus the distance for points beside it."""
    to_wall = TUBE_RADIUS - np.linalg.norm(points[..., 1:], axis=-1)
    to_ends = np.minimum(points[..., 0], TUBE_LENGTH - points[..., 0])
    return np.minimum(to_wall, to_ends)


def tube_field(spacing: float = 0.1) -> DistanceField:
    """The tube's clearance on a grid with two samples of rock around it."""
    low = np.array([0.0, -TUBE_RADIUS, -TUBE_RADIUS]) - 2 * spacing
    high = np.array([TUBE_LENGTH, TUBE_RADIUS, TUBE_RADIUS]) + 2 * spacing
    axes = [np.arange(a, b + spacing / 2, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return field_from_dense(low, spacing, tube_clearance(points).astype(np.float32))


def tube_guide(num_panels: int = 10) -> Guide:
    """Panels from x = 1 to x = 19."""
    angles = np.linspace(0, 2 * np.pi, SECTIONS, endpoint=False)
    ring = TUBE_RADIUS * np.stack([np.zeros(SECTIONS), np.cos(angles), np.sin(angles)], axis=1)
    stations = np.linspace(1.0, TUBE_LENGTH - 1.0, num_panels)
    ahead = np.array([1.0, 0.0, 0.0])
    panels = tuple(
        Panel(np.array([x, 0.0, 0.0]), ahead, ring + [x, 0, 0], float(x - stations[0]), float(min(TUBE_RADIUS, x)))
        for x in stations
    )
    centreline = np.stack([np.linspace(stations[0], stations[-1], 181)] + [np.zeros(181)] * 2, axis=1)
    return Guide(centreline, panels)


def tube_scenario(**overrides: object) -> Scenario:
    """A complete scenario in the tube; keywords replace fields of its settings."""
    cavity = tube_cavity()
    guide = tube_guide()
    goal = tuple(float(c) for c in guide.centres[-1])
    starts = tuple(
        Start(
            Pose(np.array([x, y, 0.0]), yaw_quaternion(0.0)),
            TUBE_RADIUS - abs(y),
            TUBE_LENGTH - 1.0 - x,
            (19.0 - x) / 18.0,
        )
        for x in np.linspace(1.5, 8.0, 10)
        for y in (-0.5, 0.5)
    )
    settings = ScenarioSettings(
        **{"name": "tube", "built": BuiltBy("test", "synthetic"), "goal": GoalSettings(goal), **overrides}  # type: ignore[arg-type]
    )
    return Scenario(settings, cavity, cavity.mesh, tube_field(), guide, starts)


def write_short(scenario: Scenario, path: Path, decisions: int) -> Path:
    """Write a scenario whose episodes end after so many decisions; return its folder."""
    settings = dataclasses.replace(scenario.settings, limits=LimitSettings(decisions=decisions))
    write_scenario(dataclasses.replace(scenario, settings=settings), path)
    return path
