"""Open tubes with known answers, as a scanner would leave them."""

from __future__ import annotations

import numpy as np

from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.types import Mesh

RADIUS = 1.0
LENGTH = 10.0
SECTIONS = 48


def straight() -> Mesh:
    """A tube of RADIUS along x from 0 to LENGTH."""
    return synthetic.tube(RADIUS, LENGTH, SECTIONS, 101).mesh


def bend(turn_radius: float) -> Mesh:
    """A quarter turn to the left around (0, turn_radius, 0)."""
    return synthetic.bend(RADIUS, turn_radius, np.pi / 2, SECTIONS, 101).mesh


def without_faces_near(mesh: Mesh, point: np.ndarray, distance: float) -> Mesh:
    """The mesh with a hole."""
    far = np.linalg.norm(mesh.triangles.mean(axis=1) - point, axis=1) > distance
    return Mesh(mesh.vertices, mesh.faces[far])


def disc(x: float, inner: float, towards: float) -> Mesh:
    """A disc, or a ring, across the tube at x, its normal along x or against it."""
    angle = np.linspace(0.0, 2.0 * np.pi, SECTIONS, endpoint=False)
    rings = [np.column_stack([np.full(SECTIONS, x), r * np.cos(angle), r * np.sin(angle)]) for r in (inner, RADIUS)]
    here, there = np.arange(SECTIONS), np.roll(np.arange(SECTIONS), -1)
    faces = np.concatenate(
        [np.stack([here, here + SECTIONS, there], 1), np.stack([there, here + SECTIONS, there + SECTIONS], 1)]
    )
    mesh = Mesh(np.concatenate(rings), faces)
    return mesh if mesh.normals[0, 0] * towards > 0.0 else Mesh(mesh.vertices, faces[:, ::-1])


def joined(*meshes: Mesh) -> Mesh:
    """All in one."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def tube_volume(length: float) -> float:
    """Volume of a prism over the regular polygon that stands for the circle, m^3."""
    return float(0.5 * SECTIONS * np.sin(2 * np.pi / SECTIONS) * RADIUS**2 * length)


def wavy_sheet() -> Mesh:
    """A single wall of 4 x 4 m."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 4, 20), np.linspace(0, 4, 20), indexing="ij"))
    corner = (20 * np.arange(19)[:, None] + np.arange(19)).ravel()
    faces = [np.stack([corner, corner + 20, corner + 1], 1), np.stack([corner + 1, corner + 20, corner + 21], 1)]
    return Mesh(np.stack([x, y, 0.1 * np.sin(3 * x)], axis=1), np.concatenate(faces))
