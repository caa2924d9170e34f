"""The cave for viewers: glTF files with colours, in several levels of detail.

Each level is a file of its own. The glTF extension for levels (MSFT_lod) is read by hardly any viewer: the common ones
show the first level only, or all of them on top of each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.report.glb import Part, glb
from aquanav_tools.types import Array, IntArray, Mesh

WALL_COLOUR = (126, 150, 160)
UNSEEN_COLOUR = (214, 106, 140)
UNSEEN_SHARE = 0.6
"""Wall that the scan did not see takes this much of its own colour over what it would have had."""
PORTAL_COLOUR = (251, 86, 7)
LEVEL_SHARES = (1.0, 1 / 4, 1 / 16)
"""Triangles of each level, relative to the cavity's."""

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
        level_path.write_bytes(glb([_wall(cavity, mesh, origins, colours)]))
        written.append(Level(level_path, len(mesh.faces)))
    return tuple(written)


def cave_part(cavity: Cavity, simplified: Mesh, max_faces: int, colours: Colours | None = None) -> Part:
    """Return a cave with at most so many triangles as a part of a scene; arguments as of `write_glb`."""
    if len(cavity.mesh.faces) <= max_faces:
        return _wall(cavity, cavity.mesh, np.arange(len(cavity.mesh.faces)), colours)
    mesh, origins = simplified, _nearest_faces(simplified, cavity.mesh)
    if len(mesh.faces) > max_faces:
        mesh, chosen = _with_faces(mesh, max_faces)
        origins = origins[chosen]
    return _wall(cavity, mesh, origins, colours)


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


def _wall(cavity: Cavity, mesh: Mesh, origins: IntArray, colours: Colours | None) -> Part:
    """Return the wall and its portals; vertices between differently coloured faces are doubled."""
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
    return Part("cave", mesh.vertices[vertices], shown, faces.reshape(-1, 3), _corner_normals(mesh, kind, used))


def _corner_normals(mesh: Mesh, kind: IntArray, used: IntArray) -> Array:
    """Return unit normals for (vertex, kind) pairs, area-weighted; lids are shaded flat, wall smoothly."""
    is_lid, normals = kind == 2, mesh.vector_areas
    sums = np.zeros((2, len(mesh.vertices), 3))
    for corner in range(3):
        np.add.at(sums, (is_lid.astype(int), mesh.faces[:, corner]), normals)
    chosen = sums[(used[:, 1] == 2).astype(int), used[:, 0]]
    unit: Array = chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1e-30)
    return unit
