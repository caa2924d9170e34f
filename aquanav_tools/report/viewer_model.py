"""The cave for viewers: glTF files with colours, in several levels of detail.

Each level is a file of its own. The glTF extension for levels (MSFT_lod) is read by hardly any viewer: the common ones
show the first level only, or all of them on top of each other.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.types import Array, IntArray, Mesh

WALL_COLOUR = (126, 150, 160)
UNSEEN_COLOUR = (214, 106, 140)
UNSEEN_SHARE = 0.6
"""Wall that the scan did not see takes this much of its own colour over what it would have had."""
PORTAL_COLOUR = (251, 86, 7)
LEVEL_SHARES = (1.0, 1 / 4, 1 / 16)
"""Triangles of each level, relative to the cavity's."""

_FLOAT, _UNSIGNED_SHORT, _UNSIGNED_INT = 5126, 5123, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
"""Constants of glTF 2.0, section 5."""

Colours = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Level:
    """One level of detail, as written."""

    path: Path
    num_triangles: int


def write_glb(
    cavity: Cavity,
    simplified: Mesh,
    path: Path,
    colours: Colours | None = None,
    levels: tuple[float, ...] = LEVEL_SHARES,
) -> tuple[Level, ...]:
    """Write the cavity as GLB, y up as glTF has it: cave.glb, then cave-lod1.glb, cave-lod2.glb for `path` cave.glb.

    Wall that the scan did not see is tinted, portals are coloured apart. Faces look outward and are drawn on both
    sides, so that the cave can be seen from outside and flown through.

    Args:
        cavity: what to show.
        simplified: its surface with fewer triangles, say the collision mesh: the coarser levels are made from it, which
            is several times faster.
        path: of the first level.
        colours: (V, 3) sRGB per vertex of the cavity; None for one colour of rock.
        levels: largest share of the cavity's triangles per level, at most 1, falling; the first shows it as it is.
    """
    written = []
    mesh, origins = cavity.mesh, np.arange(len(cavity.mesh.faces))
    for index, share in enumerate(levels):
        level_path = path if index == 0 else path.with_name(f"{path.stem}-lod{index}{path.suffix}")
        if index == 1:
            mesh, origins = simplified, _nearest_faces(simplified, cavity.mesh)
        max_faces = round(share * len(cavity.mesh.faces))
        if len(mesh.faces) > max_faces:
            mesh, chosen = _with_faces(mesh, max_faces)
            origins = origins[chosen]
        level_path.write_bytes(_glb(*_coloured_corners(cavity, mesh, origins, colours)))
        written.append(Level(level_path, len(mesh.faces)))
    return tuple(written)


def transfer_colours(mesh: Mesh, points: Array, colours: Colours) -> Colours:
    """Return the (V, 3) colour of the scan's nearest point for each vertex of a mesh.

    Args:
        mesh: where colours are wanted.
        points: (N, 3) the scan's points or vertices, in the same frame, m.
        colours: (N, 3) sRGB.
    """
    _, nearest = cKDTree(points).query(mesh.vertices)
    found: Colours = colours[nearest]
    return found


def _nearest_faces(mesh: Mesh, target: Mesh) -> IntArray:
    """Return for each face of a mesh the one of another that is nearest to its middle."""
    import igl

    found = igl.point_mesh_squared_distance(mesh.triangles.mean(axis=1), target.vertices, target.faces)[1]
    return np.asarray(found, dtype=np.int64)


def _with_faces(mesh: Mesh, num_faces: int) -> tuple[Mesh, IntArray]:
    """Return the mesh with fewer faces, and for each of them the one it stems from (Garland and Heckbert 1997)."""
    import igl

    vertices, faces, origins, _ = igl.qslim(mesh.vertices, mesh.faces, num_faces)
    return Mesh(np.asarray(vertices), np.asarray(faces, dtype=np.int64)), np.asarray(origins, dtype=np.int64).ravel()


def _coloured_corners(
    cavity: Cavity, mesh: Mesh, origins: IntArray, colours: Colours | None
) -> tuple[Array, Array, Array, IntArray]:
    """Return positions, normals, linear colours and faces; vertices between differently coloured faces are doubled."""
    labels, observed = cavity.labels[origins], cavity.observed[origins]
    kind = np.where(labels != WALL, 2, np.where(observed, 0, 1))
    corners = np.stack([mesh.faces.ravel(), np.repeat(kind, 3)], axis=1)
    used, faces = np.unique(corners, axis=0, return_inverse=True)
    vertices, kinds = used[:, 0], used[:, 1]
    base = np.tile(WALL_COLOUR, (len(mesh.vertices), 1)).astype(np.uint8)
    if colours is not None:
        base = transfer_colours(mesh, cavity.mesh.vertices, colours)
    shown = base[vertices].astype(np.float64)
    shown[kinds == 1] += UNSEEN_SHARE * (np.array(UNSEEN_COLOUR) - shown[kinds == 1])
    shown[kinds == 2] = PORTAL_COLOUR
    return mesh.vertices[vertices], _corner_normals(mesh, kind, used), _linear(shown), faces.reshape(-1, 3)


def _corner_normals(mesh: Mesh, kind: IntArray, used: IntArray) -> Array:
    """Return unit normals for (vertex, kind) pairs, area-weighted; lids are shaded flat, wall smoothly."""
    is_lid, normals = kind == 2, mesh.vector_areas
    sums = np.zeros((2, len(mesh.vertices), 3))
    for corner in range(3):
        np.add.at(sums, (is_lid.astype(int), mesh.faces[:, corner]), normals)
    chosen = sums[(used[:, 1] == 2).astype(int), used[:, 0]]
    unit: Array = chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1e-30)
    return unit


def _linear(colours: Array) -> Array:
    """Return sRGB values of 0 to 255 as linear light in [0, 1], which glTF's vertex colours are (IEC 61966-2-1)."""
    share = colours / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _glb(positions: Array, normals: Array, colours: Array, faces: IntArray) -> bytes:
    """Return a binary glTF 2.0 file; (x, y, z) of the world becomes (x, z, -y)."""
    turned = [np.stack([rows[:, 0], rows[:, 2], -rows[:, 1]], axis=1).astype("<f4") for rows in (positions, normals)]
    opaque = np.column_stack([colours, np.ones(len(colours))])
    parts = (
        (turned[0], "VEC3", _FLOAT, _ARRAY_BUFFER),
        (turned[1], "VEC3", _FLOAT, _ARRAY_BUFFER),
        (np.round(65535 * opaque).astype("<u2"), "VEC4", _UNSIGNED_SHORT, _ARRAY_BUFFER),
        (faces.astype("<u4").ravel(), "SCALAR", _UNSIGNED_INT, _ELEMENT_ARRAY_BUFFER),
    )
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    offset = 0
    for index, (values, shape, component, target) in enumerate(parts):
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": values.nbytes, "target": target})
        accessors.append({"bufferView": index, "componentType": component, "count": len(values), "type": shape})
        offset += values.nbytes  # a multiple of four for every part
    accessors[0] |= {"min": turned[0].min(axis=0).tolist(), "max": turned[0].max(axis=0).tolist()}
    accessors[2]["normalized"] = True
    attributes = {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}
    document = {
        "asset": {"version": "2.0", "generator": "aquanav"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "cave"}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3, "material": 0}]}],
        "materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", offset, 0x004E4942)
    body = b"".join(values.tobytes() for values, *_ in parts)
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks) + offset) + chunks + body
