"""Solids that drawn vehicles are put together from: triangles with colours, edges sharp and curves smooth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquanav_tools.types import Array, IntArray, Mesh

Colour = tuple[int, int, int]
SIDES = 16
"""Of round things."""


def box(size: Sequence[float], centre: Sequence[float], colour: Colour) -> Mesh:
    """Return a box with sides along the axes, m."""
    x, y, z = 0.5 * np.asarray(size)
    outline = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) + np.asarray(centre)[:2]
    return prism(outline, centre[2] - z, centre[2] + z, colour)


def prism(outline: Array, low: float, high: float, colour: Colour, taper: float = 1.0) -> Mesh:
    """Return an upright prism of a (C, 2) convex outline, counter-clockwise.

    Args:
        outline: At the top, m.
        low: Height of its bottom, m.
        high: Height of its top, m.
        colour: sRGB.
        taper: Size of the outline at the bottom, of that at the top, about its middle.
    """
    middle = outline.mean(axis=0)
    bottom = np.column_stack([middle + taper * (outline - middle), np.full(len(outline), low)])
    top = np.column_stack([outline, np.full(len(outline), high)])
    sides = [_flat(np.array([bottom[i - 1], bottom[i], top[i], top[i - 1]]), colour) for i in range(len(outline))]
    return joined([*sides, _flat(top, colour), _flat(bottom[::-1], colour)])


def tube(
    start: Sequence[float],
    end: Sequence[float],
    radii: tuple[float, float],
    colour: Colour,
    caps: tuple[bool, bool] = (True, True),
) -> Mesh:
    """Return a round tube from a place to another, m, of a radius at either end; open where it has no cap."""
    (near, far), axis = np.array([start, end], dtype=np.float64), np.subtract(end, start)
    ring = _ring(axis)
    rings = np.concatenate([near + radii[0] * ring, far + radii[1] * ring])
    here, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    faces = np.concatenate([
        np.stack([here, after, after + SIDES], axis=1), np.stack([here, after + SIDES, here + SIDES], axis=1)
    ])  # fmt: skip
    parts = [_coloured(rings, faces, colour)]
    if caps[0] and radii[0] > 0.0:
        parts.append(_flat(rings[:SIDES][::-1], colour))
    if caps[1] and radii[1] > 0.0:
        parts.append(_flat(rings[SIDES:], colour))
    return joined(parts)


def dome(centre: Sequence[float], radius: float, ahead: Sequence[float], colour: Colour) -> Mesh:
    """Return half a ball whose top points ahead, m."""
    axis = np.asarray(ahead, dtype=np.float64) / np.linalg.norm(ahead)
    angles = np.linspace(0.0, 0.5 * np.pi, 6)[:-1]
    ring, middle = _ring(axis), np.asarray(centre, dtype=np.float64)
    rings = [middle + radius * (np.cos(angle) * ring + np.sin(angle) * axis) for angle in angles]
    here, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    bands = [np.stack([here + SIDES * 4, after + SIDES * 4, np.full(SIDES, SIDES * 5)], axis=1)]
    for low in SIDES * np.arange(4):
        high = low + SIDES
        bands += [np.stack([here + low, after + low, after + high], axis=1)]
        bands += [np.stack([here + low, after + high, here + high], axis=1)]
    top = (middle + radius * axis)[None]
    return _coloured(np.concatenate([*rings, top]), np.concatenate(bands), colour)


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Return coloured meshes as one; corners stay apart."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, first, strict=False)]
    colours = [part.colours for part in parts if part.colours is not None]
    assert len(colours) == len(parts), "every part has colours"
    return Mesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces), np.concatenate(colours))


def inside_out(mesh: Mesh) -> Mesh:
    """Return a mesh that is seen from its other side."""
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], mesh.colours)


def _flat(corners: Array, colour: Colour) -> Mesh:
    """Return a convex polygon, counter-clockwise from its front."""
    fan = np.arange(1, len(corners) - 1)
    return _coloured(corners, np.stack([np.zeros_like(fan), fan, fan + 1], axis=1), colour)


def _coloured(vertices: Array, faces: IntArray, colour: Colour) -> Mesh:
    return Mesh(
        np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64),
        np.tile(np.array(colour, dtype=np.uint8), (len(vertices), 1)),
    )  # fmt: skip


def _ring(axis: Array) -> Array:
    """Return (SIDES, 3) unit vectors across an axis, counter-clockwise seen from its tip."""
    ahead = axis / np.linalg.norm(axis)
    helper = np.eye(3)[int(np.abs(ahead).argmin())]
    one = np.cross(ahead, helper)
    one /= np.linalg.norm(one)
    other = np.cross(ahead, one)
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring: Array = np.cos(angles)[:, None] * one + np.sin(angles)[:, None] * other
    return ring
