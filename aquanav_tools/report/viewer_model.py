"""The cave for viewers: glTF files with colours, in several levels of detail.

Each level is a file of its own. The glTF extension for levels (MSFT_lod) is read by hardly any viewer: the common ones
show the first level only, or all of them on top of each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.report.glb import Part, glb
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

WALL_COLOUR = (126, 150, 160)
UNSEEN_COLOUR = (214, 106, 140)
UNSEEN_SHARE = 0.6
"""Wall that the scan did not see takes this much of its own colour over what it would have had."""
PORTAL_COLOUR = (251, 86, 7)
NUM_KINDS = 3
"""Of faces: wall that was seen, other wall, portals."""
LEVEL_SHARES = (1.0, 1 / 4, 1 / 16)
"""Triangles of each level, relative to the cavity's."""

Colours = npt.NDArray[np.uint8]

_known: WeakKeyDictionary[Cavity, list[tuple[Mesh, IntArray]]] = WeakKeyDictionary()
"""Surfaces of a cavity with fewer faces, first what all others are made of; for each face that of the cavity."""


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
    for index, share in enumerate(levels):
        level_path = path if index == 0 else path.with_name(f"{path.stem}-lod{index}{path.suffix}")
        mesh, origins = _with_faces(cavity, simplified, round(share * len(cavity.mesh.faces)))
        level_path.write_bytes(glb([_wall(cavity, mesh, origins, colours)]))
        written.append(Level(level_path, len(mesh.faces)))
    return tuple(written)


def cave_part(cavity: Cavity, simplified: Mesh, max_faces: int, colours: Colours | None = None) -> Part:
    """Return a cave with at most so many triangles as a part of a scene; arguments as of `write_glb`."""
    return _wall(cavity, *_with_faces(cavity, simplified, max_faces), colours)


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


def _with_faces(cavity: Cavity, simplified: Mesh, max_faces: int) -> tuple[Mesh, IntArray]:
    """Return a cavity with at most so many faces, and for each of them the one it stems from.

    It is made from what was made before with the fewest faces that suffice (Garland and Heckbert 1997).
    """
    import igl

    if len(cavity.mesh.faces) <= max_faces:
        return cavity.mesh, np.arange(len(cavity.mesh.faces))
    known = _known.get(cavity, [])
    if not known or known[0][0] is not simplified:
        known = [(simplified, cavity.surface.nearest_faces(simplified.triangles.mean(axis=1)))]
        _known[cavity] = known
    mesh, origins = min((one for one in known if len(one[0].faces) >= max_faces), key=_num_faces, default=known[0])
    if len(mesh.faces) > max_faces:
        vertices, faces, chosen, _ = igl.qslim(mesh.vertices, mesh.faces, max_faces)
        mesh, origins = Mesh(np.asarray(vertices), np.asarray(faces, dtype=np.int64)), origins[np.ravel(chosen)]
        known.append((mesh, origins))
    return mesh, origins


def _num_faces(level: tuple[Mesh, IntArray]) -> int:
    return len(level[0].faces)


def _wall(cavity: Cavity, mesh: Mesh, origins: IntArray, colours: Colours | None) -> Part:
    """Return the wall and its portals; vertices between differently coloured faces are doubled."""
    labels, observed = cavity.labels[origins], cavity.observed[origins]
    kind = np.where(labels != WALL, 2, np.where(observed, 0, 1))
    corners = NUM_KINDS * mesh.faces + kind[:, None]
    is_used = np.zeros(NUM_KINDS * len(mesh.vertices), dtype=np.bool_)
    is_used[corners] = True
    used, faces = np.flatnonzero(is_used), (np.cumsum(is_used) - 1)[corners]
    vertices, kinds = np.divmod(used, NUM_KINDS)
    base = np.tile(WALL_COLOUR, (len(mesh.vertices), 1)).astype(np.uint8)
    if colours is not None:
        base = transfer_colours(mesh, cavity.mesh.vertices, colours)
    shown = base[vertices].astype(np.float64)
    shown[kinds == 1] += UNSEEN_SHARE * (np.array(UNSEEN_COLOUR) - shown[kinds == 1])
    shown[kinds == 2] = PORTAL_COLOUR
    return Part("cave", mesh.vertices[vertices], shown, faces, _corner_normals(mesh, kind == 2, vertices, kinds == 2))


def _corner_normals(mesh: Mesh, is_lid: BoolArray, vertices: IntArray, is_of_lid: BoolArray) -> Array:
    """Return unit normals for vertices, some of them as of lids, area-weighted; lids are shaded flat, wall smoothly."""
    places = (mesh.faces + len(mesh.vertices) * is_lid[:, None]).T.ravel()
    sums = [np.bincount(places, np.tile(axis, 3), 2 * len(mesh.vertices)) for axis in mesh.vector_areas.T]
    chosen = np.stack(sums, axis=1)[vertices + len(mesh.vertices) * is_of_lid]
    unit: Array = chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1e-30)
    return unit
