"""Flows with known velocities: cavities with portals, and the potential flow through them."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, Portal
from aquanav_tools.cave.water.flow import Flow, find_flow
from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.synthetic import networks

AXIS = np.array([0.36, 0.48, 0.8])
TURN = 0.9


def rotation() -> np.ndarray:
    """A rotation about an axis that is no symmetry of a grid (Rodrigues)."""
    x, y, z = AXIS
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(TURN) * cross + (1.0 - np.cos(TURN)) * cross @ cross


def with_ends(cavity: Cavity, length: float) -> Cavity:
    """A passage along x whose lids at x = 0 and x = length are portals 1 and 2."""
    labels, portals = np.full(len(cavity.mesh.faces), WALL), []
    for label, x, sign in ((1, 0.0, -1.0), (2, length, 1.0)):
        is_lid = np.all(np.abs(cavity.mesh.triangles[..., 0] - x) < 1e-9, axis=1)
        labels[is_lid] = label
        middle = cavity.mesh.triangles[is_lid].mean(axis=(0, 1))
        portals.append(Portal(label, middle, np.array([sign, 0.0, 0.0]), float(cavity.mesh.areas[is_lid].sum())))
    return dataclasses.replace(cavity, labels=labels.astype(np.int64), portals=tuple(portals))


def flow_in(cavity: Cavity, field: DistanceField, spacing: float, **choices: tuple[int, ...]) -> Flow:
    flow = find_flow(cavity, field, cavity.portals[-1].centre[None], 1.0, spacing=spacing, **choices)
    assert flow is not None
    return flow


BEND_RADIUS = 3.0


@cache
def bend() -> tuple[Cavity, DistanceField, Flow]:
    """A quarter turn of a round tube, oblique to the grid."""
    cavity = networks.curved(1.0, BEND_RADIUS).turned(rotation()).cavity()
    field = distance_field(cavity.mesh, 0.06)
    return cavity, field, flow_in(cavity, field, 0.15)


@cache
def fork() -> tuple[Cavity, DistanceField]:
    cavity = networks.fork().cavity()
    return cavity, distance_field(cavity.mesh, 0.1)
