"""Closed caves with known widths, lengths and branches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, from_manifold, to_manifold
from aquanav_tools.cave.route.route import Route
from aquanav_tools.geometry.polyline import resample
from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.types import Mesh

SECTIONS = 64
POLYGON = float(np.cos(np.pi / SECTIONS))
"""Inner radius of the polygon that stands for a unit circle."""


def closed(mesh: Mesh, is_lid: np.ndarray | None = None) -> Cavity:
    """The cavity of a closed surface; faces that `is_lid` marks are portal 1."""
    labels = np.full(len(mesh.faces), WALL) if is_lid is None else np.where(is_lid, 1, WALL)
    return Cavity(mesh, labels.astype(np.int64), labels == WALL, ())


def lathe(
    length: float,
    radius: Callable[[np.ndarray], np.ndarray],
    aside: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    rings: int = 201,
) -> Cavity:
    """A passage along +x from the origin with circular sections of radius(x) around y = aside(x), lids at the ends."""
    mesh = synthetic.tube(1.0, length, SECTIONS, rings).truth
    x = mesh.vertices[:, 0]
    shape = radius(x)[:, None] * mesh.vertices[:, 1:] + np.stack([aside(x), np.zeros_like(x)], axis=1)
    corners = x[mesh.faces]
    is_lid = (corners == 0.0).all(axis=1) | (corners == length).all(axis=1)
    return closed(Mesh(np.column_stack([x, shape]), mesh.faces), is_lid)


def swept(centreline: np.ndarray, radius: float) -> Cavity:
    """A tube around a curve that is nowhere vertical, with a ring about every 0.2 m."""
    return closed(synthetic.sweep(resample(centreline, 0.2), radius, SECTIONS).truth)


def joined(*caves: Cavity) -> Cavity:
    """The union of several passages."""
    solid = to_manifold(caves[0].mesh)
    for cave in caves[1:]:
        solid += to_manifold(cave.mesh)
    return closed(from_manifold(solid))


def field_of(cavity: Cavity, spacing: float = 0.15) -> DistanceField:
    """The cavity's clearance."""
    return distance_field(cavity.mesh, spacing)


def route_along(points: np.ndarray, field: DistanceField, step: float = 0.1) -> Route:
    """A polyline as a route."""
    points = resample(points, step)
    return Route(points, field.clearance(points))


def walk(*corners: tuple[float, float, float], turn: float = 1.5) -> np.ndarray:
    """A polyline through corners in a level plane, each rounded with an arc of radius `turn`, points 0.1 m apart."""
    points = [np.array(corners[0])]
    for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
        here, there = (np.array(end) - corner for end in (before, after))
        here, there = here / np.linalg.norm(here), there / np.linalg.norm(there)
        half = 0.5 * np.arccos(here @ there)
        middle = corner + turn / np.sin(half) * (here + there) / np.linalg.norm(here + there)
        first, last = (corner + turn / np.tan(half) * way - middle for way in (here, there))
        angle = np.pi - 2 * half
        for share in np.linspace(0.0, 1.0, 1 + int(np.ceil(angle * turn / 0.1))):
            blend = np.sin((1 - share) * angle) * first + np.sin(share * angle) * last
            points.append(middle + blend / np.sin(angle))
    return resample(np.array([*points, np.array(corners[-1])]), 0.1)


MAIN = walk((0, 0, 0), (16, 0, 0))
BRANCH = walk((5, 0, 0), (5, 6, 0), (15, 6, 0), turn=2.0)
"""A dead end that leaves MAIN at x = 5 and then runs beside it."""


def fork() -> Cavity:
    """A straight passage of radius 1 m with a dead end of the same radius."""
    return joined(swept(MAIN, 1.0), swept(BRANCH, 1.0))
