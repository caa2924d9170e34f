"""Branching caves made of round tubes and spheres, whose centreline graph is known exactly.

A network is a union of passages (round tubes around a curve) and chambers (spheres) that manifold3d computes. A
passage's axis keeps the passage's radius from every wall, so the axes are the true centreline.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, Portal, from_manifold, to_manifold
from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.synthetic.caves import sweep
from aquanav_tools.synthetic.noise import noise
from aquanav_tools.types import Array, Mesh

SECTIONS = 48
"""Corners of a tube's polygon: its area is 0.3 % below the circle's, its inner radius 0.2 %."""
STEP = 0.25
"""Distance between the points of a curve, m."""
LID_TOLERANCE = 1e-6
"""Distance from its plane within which a vertex belongs to a lid, m; manifold3d keeps planes to about 1e-9."""


@dataclass(frozen=True, eq=False)
class Passage:
    """A round tube around a curve that is nowhere vertical."""

    axis: Array
    """(C, 3) curve, m."""
    radius: float
    """m."""
    is_open: tuple[bool, bool] = (False, False)
    """Whether the first and last end are cut flat and open; a closed one is rounded by a ball."""

    @property
    def length(self) -> float:
        """Metres along the axis."""
        return length_of(self.axis)


@dataclass(frozen=True, eq=False)
class Network:
    """A cave with what its centreline graph must say. A passage is a branch from junction to junction or end."""

    passages: tuple[Passage, ...]
    chambers: tuple[tuple[Array, float], ...] = ()
    """Centre (3,) and radius of the spheres, m."""
    num_junctions: int = 0
    num_loops: int = 0
    num_dead_ends: int = 0
    roughness: float = 0.0
    """Largest relief of the wall, m; none at the openings."""
    seed: int = 0
    """Picks the relief."""
    rotation: tuple[tuple[float, ...], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """world_from_network, a (3, 3) rotation of everything above."""

    @property
    def openings(self) -> list[tuple[Array, Array, float]]:
        """Centre, unit normal out of the water and radius of each opening, world, m."""
        turn = np.array(self.rotation)
        ends = [(p, e) for p in self.passages for e in (0, 1) if p.is_open[e]]
        return [(turn @ centre, turn @ normal, p.radius) for p, e in ends for centre, normal in [_end(p.axis, e)]]

    def turned(self, rotation: Array) -> Network:
        """Return the network after a further (3, 3) rotation about the origin."""
        matrix = np.asarray(rotation) @ np.array(self.rotation)
        return replace(self, rotation=tuple(tuple(float(c) for c in row) for row in matrix))

    def cavity(self) -> Cavity:
        """Return the water: a closed surface with a portal in each opening."""
        mesh = _union(self)
        labels = np.full(len(mesh.faces), WALL)
        portals = []
        for label, (centre, normal, radius) in enumerate(self.openings, start=1):
            offset = mesh.triangles - centre
            is_flat = np.all(np.abs(offset @ normal) < LID_TOLERANCE, axis=1)
            is_lid = is_flat & np.all(np.linalg.norm(offset, axis=2) < 1.01 * radius, axis=1)
            labels[is_lid] = label
            portals.append(Portal(label, centre, normal, float(mesh.areas[is_lid].sum())))
        return Cavity(mesh, labels, np.asarray(labels == WALL), tuple(portals))

    def scan(self) -> Mesh:
        """Return the wall alone, open at the openings."""
        cavity = self.cavity()
        kept, inverse = np.unique(cavity.mesh.faces[cavity.labels == WALL], return_inverse=True)
        return Mesh(cavity.mesh.vertices[kept], inverse.reshape(-1, 3).astype(np.int64))


def straight(radius: float = 1.0, length: float = 12.0) -> Network:
    """Return a straight tube along +x, open at both ends; volume pi * radius^2 * length."""
    return Network((Passage(_line([0, 0, 0], [length, 0, 0]), radius, (True, True)),))


def curved(radius: float = 1.0, bend_radius: float = 5.0) -> Network:
    """Return a quarter turn to the left, open at both ends; volume pi * radius^2 * bend_radius * pi / 2."""
    return Network((Passage(_arc([0, bend_radius, 0], bend_radius, -np.pi / 2, 0.0), radius, (True, True)),))


def fork(radius: float = 1.0, length: float = 8.0, angle: float = np.pi / 3) -> Network:
    """Return a passage that parts into two, `angle` between them: three branches of `length`, three openings."""
    first, second = (_heading(sign * angle / 2) for sign in (1, -1))
    return Network(
        (
            Passage(_line([-length, 0, 0], [0, 0, 0]), radius, (True, False)),
            Passage(_line([0, 0, 0], length * first), radius, (False, True)),
            Passage(_line([0, 0, 0], length * second), radius, (False, True)),
        ),
        num_junctions=1,
    )


def loop(radius: float = 1.0, ring_radius: float = 3.0, length: float = 4.0) -> Network:
    """Return a passage that parts and joins again around a pillar of radius `ring_radius` - `radius`: genus 1."""
    centre, east = [0.0, 0.0, 0.0], ring_radius + length
    return Network(
        (
            Passage(_line([-east, 0, 0], [-ring_radius, 0, 0]), radius, (True, False)),
            Passage(_arc(centre, ring_radius, np.pi, 0.0), radius),
            Passage(_arc(centre, ring_radius, np.pi, 2.0 * np.pi), radius),
            Passage(_line([ring_radius, 0, 0], [east, 0, 0]), radius, (False, True)),
        ),
        num_junctions=2,
        num_loops=1,
    )


def helix(radius: float = 0.8, turn_radius: float = 2.0, pitch: float = 3.0, turns: float = 3.0) -> Network:
    """Return a descending spiral, open at both ends; volume pi * radius^2 * length.

    Rock between two turns is `pitch` * cos(slope) - 2 * radius thick.
    """
    angle = np.linspace(0.0, 2.0 * np.pi * turns, round(2.0 * np.pi * turns * turn_radius / STEP) + 1)
    axis = np.stack([turn_radius * np.cos(angle), turn_radius * np.sin(angle), -pitch * angle / (2 * np.pi)], axis=1)
    return Network((Passage(axis, radius, (True, True)),))


def chamber(radius: float = 1.0, chamber_radius: float = 2.5, length: float = 5.0) -> Network:
    """Return a sphere with a passage out of it on two sides, each `length` beyond the sphere's surface.

    Its volume is the sphere's, and per passage a cylinder less the sphere's cap in it.
    """
    east = chamber_radius + length
    axis = _line([-east, 0, 0], [east, 0, 0])
    return Network((Passage(axis, radius, (True, True)),), ((np.zeros(3), chamber_radius),))


def combination(radius: float = 0.9, length: float = 7.0) -> Network:
    """Return a fork whose one arm leads to a loop and a chamber, and whose other arm is a dead end that descends."""
    ring_radius, chamber_radius, out = 3.0 * radius, 2.2 * radius, _heading(np.pi / 6)
    near = length * out
    middle, far = near + ring_radius * out, near + 2.0 * ring_radius * out
    goal = far + 1.5 * length * out
    down = np.array([np.cos(0.6), -np.sin(0.6), -0.35])
    here = np.pi * 7 / 6
    ring = [_arc(middle, ring_radius, here, here + half) for half in (-np.pi, np.pi)]
    return Network(
        (
            Passage(_line([-length, 0, 0], [0, 0, 0]), radius, (True, False)),
            Passage(_line([0, 0, 0], near), radius),
            Passage(ring[0], radius),
            Passage(ring[1], radius),
            Passage(_line(far, goal), radius, (False, True)),
            Passage(_line([0, 0, 0], length * down / np.linalg.norm(down)), radius),
        ),
        ((0.45 * far + 0.55 * goal, chamber_radius),),
        num_junctions=3,
        num_loops=1,
        num_dead_ends=1,
    )


def _line(start: Array | list[float], end: Array | list[float]) -> Array:
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    share = np.linspace(0.0, 1.0, round(float(np.linalg.norm(end - start)) / STEP) + 1)[:, None]
    return start + share * (end - start)


def _arc(centre: Array | list[float], radius: float, start: float, end: float) -> Array:
    """Return a level arc between two angles, rad."""
    angle = np.linspace(start, end, round(abs(end - start) * radius / STEP) + 1)
    return np.asarray(centre) + radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def _heading(yaw: float) -> Array:
    return np.array([np.cos(yaw), np.sin(yaw), 0.0])


def _end(axis: Array, end: int) -> tuple[Array, Array]:
    """Return the point at an end (0 or 1) of an axis and the unit vector out of it, as `sweep` cuts it."""
    tangents = np.gradient(axis, axis=0, edge_order=2)
    tangent = (tangents[-1] if end else -tangents[0]) / np.linalg.norm(tangents[-1 if end else 0])
    return axis[-1 if end else 0], tangent


def _union(network: Network) -> Mesh:
    from manifold3d import Manifold

    solids = [to_manifold(sweep(p.axis, p.radius, SECTIONS).truth) for p in network.passages]
    closed = [(p.axis[-e], p.radius) for p in network.passages for e in (0, 1) if not p.is_open[e]]
    balls = [*closed, *network.chambers]
    solids += [Manifold.sphere(radius, SECTIONS).translate(centre) for centre, radius in balls]
    union = solids[0]
    for solid in solids[1:]:
        union += solid
    if network.roughness > 0.0:
        union = _roughened(union, network)
    mesh = from_manifold(union)
    return Mesh(mesh.vertices @ np.array(network.rotation).T, mesh.faces)


def _roughened(solid, network: Network):  # type: ignore[no-untyped-def]  # manifold3d ships no types
    """Return the solid with its wall moved along its normals by up to the roughness, and not at all at the lids."""
    smallest = min(passage.radius for passage in network.passages)
    mesh = from_manifold(solid.refine_to_length(0.25 * smallest))
    normals = mesh.to_trimesh().vertex_normals
    frequency = 1.0 / smallest
    relief = np.array([noise(*(frequency * vertex), network.seed) for vertex in mesh.vertices])
    fade = np.ones(len(mesh.vertices))
    for passage in network.passages:
        for end in (e for e in (0, 1) if passage.is_open[e]):
            centre, normal = _end(passage.axis, end)
            offset = mesh.vertices - centre
            is_near = np.linalg.norm(offset, axis=1) < 2.0 * passage.radius
            fade[is_near] = np.clip(-offset[is_near] @ normal / passage.radius, 0.0, 1.0)
    moved = mesh.vertices + (network.roughness * fade * relief)[:, None] * normals
    return to_manifold(Mesh(moved, mesh.faces))
