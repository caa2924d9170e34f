"""Binary glTF 2.0: scenes of coloured triangles and lines in one file, written by trimesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.types import Array, IntArray

_COLOURS = "_COLOR_0"
"""trimesh's own colours have 8 bits, of which linear light needs more: of the darkest fifth of sRGB nine levels would
be left. So 16 bits go in as an attribute of one's own, and get the standard's name in the end."""
_TRIANGLES = 4
_ROUGH = {"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}}
"""Without a material viewers draw one side, as metal."""


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles, or a line from point to point."""

    name: str
    """No other part of the scene has it."""
    points: Array
    """(N, 3) world, m."""
    colours: Array
    """(N, 3) sRGB, 0 to 255; a line has one colour, (3,)."""
    faces: IntArray | None = None
    """(F, 3) of triangles, counter-clockwise from outside; None for a line."""
    normals: Array | None = None
    """(N, 3) of triangles, unit vectors."""


def line(name: str, points: Array, colour: tuple[int, int, int]) -> Part:
    """Return a line of one colour, sRGB from 0 to 255, along (N, 3) points."""
    return Part(name, points, np.array(colour))


def glb(parts: Sequence[Part]) -> bytes:
    """Return a scene as a file; (x, y, z) of the world becomes (x, z, -y), as glTF has y up."""
    import trimesh
    from trimesh.exchange.gltf import export_glb

    scene = trimesh.Scene()
    for part in parts:
        scene.add_geometry(_line(part) if part.faces is None else _solid(part), part.name, part.name)
    written: bytes = export_glb(scene, unitize_normals=False, tree_postprocessor=_finish)
    return written


def _solid(part: Part) -> Any:
    import trimesh

    opaque = np.column_stack([_linear(part.colours), np.ones(len(part.points))])
    return trimesh.Trimesh(
        _turned(part.points),
        part.faces,
        vertex_normals=None if part.normals is None else _turned(part.normals),
        vertex_attributes={_COLOURS: np.round(65535 * opaque).astype(np.uint16)},
        process=False,
    )


def _line(part: Part) -> Any:
    from trimesh.path import Path3D
    from trimesh.path.entities import Line

    opaque = np.round(255 * np.append(_linear(part.colours), 1.0)).astype(np.uint8)
    return Path3D([Line(np.arange(len(part.points)), color=opaque)], _turned(part.points), process=False)


def _finish(tree: dict[str, Any]) -> None:
    """Name the colours of triangles by the standard, and give all parts one material."""
    tree["materials"] = [_ROUGH]
    for mesh in tree["meshes"]:
        primitive = mesh["primitives"][0]
        primitive["material"] = 0
        if primitive["mode"] == _TRIANGLES:
            accessor = primitive["attributes"].pop(_COLOURS)
            primitive["attributes"]["COLOR_0"] = accessor
            tree["accessors"][accessor]["normalized"] = True


def _turned(rows: Array) -> Array:
    return np.stack([rows[:, 0], rows[:, 2], -rows[:, 1]], axis=1)


def _linear(colours: Array) -> Array:
    """Return sRGB values of 0 to 255 as linear light in [0, 1], which glTF's vertex colours are (IEC 61966-2-1)."""
    share = np.asarray(colours) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
