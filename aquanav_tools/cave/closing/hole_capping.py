"""Closing a sound surface exactly: its own triangles stay, and every hole gets a cap.

Small holes are filled so that the wall's curvature goes on across them; wide ones, which may be open ends, get a flat
cap. Faces that cross each other or crowd around an edge are taken out first, and the holes they leave filled.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.cave.scan.orientation import face_areas
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.hole_filling import fill_hole
from aquanav_tools.geometry.mesh.intersections import crossing_share, self_intersections
from aquanav_tools.geometry.mesh.patches import boundary_loops, crowded_faces, find_patches, split_touching
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

MAX_ROUNDS = 5
MAX_REPAIRED_SHARE = 0.02
"""A surface of which more than this share of the area is broken is better resampled."""
TOO_BROKEN = "More than 2 % of the surface crosses itself or is in separate pieces."
MAX_UNSAMPLED, NUM_SAMPLES, SAMPLE_MARGIN = 100_000, 20_000, 1.5
"""Of a surface with more faces some are looked at first; of 20,000 a share of 2 % is known to a tenth of that."""
MAX_CAP_SHARE = 0.4
"""With more of the closed surface made of caps the scan was a sheet, not a passage."""
MAX_FAN = 0.5
"""A hole with a folded rim is closed with a fan to its middle when it is narrower than this share of the narrowest
portal: a crack that runs around a passage that a vehicle fits through is wider, and would get a wall across it ..."""
MIN_ROUNDNESS = 0.4
"""... or when it is as open as a ragged end: a crack encloses no area to speak of."""
STRAY_SHARE = 0.01
"""Pieces of a sound surface with less than this share of its area are scraps."""


@dataclass(frozen=True, eq=False)
class Capped:
    """A closed surface made of a scan's own triangles and caps."""

    mesh: Mesh
    is_scan: BoolArray
    """(F,) whether a face comes from the scan."""


def cap_holes(surface: Mesh, min_portal: float) -> Capped:
    """Return the surface with a cap over each hole.

    Args:
        surface: normals out of the water.
        min_portal: holes of at least this diameter get a flat cap, m.

    Raises:
        MeshError: the surface is in several pieces or too broken, or the result is not a proven solid.
    """
    areas = face_areas(surface)[0]
    whole = float(areas.sum())
    # Most surfaces that are too broken are so before any cap is made, and where many faces are, a sample tells.
    is_large = len(surface.faces) > MAX_UNSAMPLED
    if is_large and crossing_share(surface, NUM_SAMPLES) > SAMPLE_MARGIN * MAX_REPAIRED_SHARE:
        raise MeshError(TOO_BROKEN)
    is_broken = crowded_faces(surface.faces)
    is_broken[np.unique(self_intersections(surface))] = True
    if areas[is_broken].sum() > MAX_REPAIRED_SHARE * whole:
        raise MeshError(TOO_BROKEN)
    kept = _largest_patch(Mesh(surface.vertices, surface.faces[~is_broken]))
    flat_loops: set[tuple[float, ...]] = set()
    for _ in range(MAX_ROUNDS):
        if face_areas(kept)[0].sum() < (1.0 - MAX_REPAIRED_SHARE) * whole:
            raise MeshError(TOO_BROKEN)
        capped, owners = _with_caps(kept, min_portal, flat_loops)
        crossing = np.unique(self_intersections(capped.mesh))
        if not len(crossing):
            areas = face_areas(capped.mesh)[0]
            if areas[~capped.is_scan].sum() > MAX_CAP_SHARE * areas.sum():
                raise MeshError("Caps would make up more than 40 % of the closed surface.")
            prove_watertight(capped.mesh)
            return capped
        broken = crossing[crossing < len(kept.faces)]
        # A curved cap that runs into the wall is made flat; a flat one costs the wall it crosses.
        flat_loops |= {owners[face - len(kept.faces)] for face in crossing if face >= len(kept.faces)}
        kept = _largest_patch(Mesh(kept.vertices, np.delete(kept.faces, broken, axis=0)))
    raise MeshError(f"{len(crossing)} faces still cross each other after {MAX_ROUNDS} rounds of repair.")


def _largest_patch(mesh: Mesh) -> Mesh:
    """Return the main patch of a surface, with its touching parts split."""
    patches = find_patches(mesh)
    areas = np.bincount(patches.ids, face_areas(mesh)[0], minlength=1)
    large = np.flatnonzero(areas > STRAY_SHARE * areas.max(initial=0.0))
    if len(large) != 1:
        raise MeshError(f"The surface is in {len(large)} pieces.")
    kept = split_touching(Mesh(mesh.vertices, mesh.faces[patches.ids == large[0]]))
    if find_patches(kept).count != 1 or not np.array_equal(find_patches(kept).mesh.faces, kept.faces):
        raise MeshError("The surface is not wound consistently.")
    return kept


def _with_caps(
    surface: Mesh, min_portal: float, flat_loops: set[tuple[float, ...]]
) -> tuple[Capped, list[tuple[float, ...]]]:
    """Return the closed surface, its scanned faces first, and the middle of the loop that each cap face closes."""
    vertices, caps, owners = surface.vertices, [surface.faces], []
    for loop in boundary_loops(surface):
        middle = vertices[loop].mean(axis=0)
        owner = tuple(middle.round(6).tolist())
        diameter = _diameter(vertices[loop])
        added, cap = _cap(vertices, surface.faces, loop, diameter < min_portal and owner not in flat_loops)
        if cap is None and (diameter < MAX_FAN * min_portal or _roundness(vertices[loop]) > MIN_ROUNDNESS):
            added, cap = _fan(vertices, loop)
        if cap is None:
            raise MeshError(f"The rim of the hole at {np.round(owner, 2)} m folds over itself.")
        vertices = np.vstack([vertices, added])
        caps.append(cap)
        owners += [owner] * len(cap)
    # What is proven is what a scenario keeps: float32.
    mesh = Mesh(vertices.astype(np.float32).astype(np.float64), np.concatenate(caps))
    return Capped(mesh, np.arange(len(mesh.faces)) < len(surface.faces)), owners


def _diameter(points: Array) -> float:
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).max() * 2.0)


def _cap(vertices: Array, faces: IntArray, loop: IntArray, is_curved: bool) -> tuple[Array, IntArray | None]:
    """Return the new vertices and faces of a cap, curved like the wall around or flat; no faces where neither goes."""
    if is_curved:
        try:
            return fill_hole(vertices, faces[_faces_around(faces, loop, len(vertices))], loop)
        except MeshError:
            logger.info("The hole at %s m has an uneven rim", vertices[loop].mean(axis=0).round(2))
    return np.zeros((0, 3)), _flat_cap(vertices, loop)


def _roundness(points: Array) -> float:
    """Return the area that a loop encloses, seen from where it looks largest, as a share of its circle's."""
    offsets = points - points.mean(axis=0)
    area = 0.5 * np.linalg.norm(np.cross(offsets, np.roll(offsets, -1, axis=0)).sum(axis=0))
    return float(area / (np.pi / 4.0 * _diameter(points) ** 2))


def _fan(vertices: Array, loop: IntArray) -> tuple[Array, IntArray]:
    """Return the middle of a loop as a new vertex, and the faces around it."""
    tip = np.full(len(loop), len(vertices))
    return vertices[loop].mean(axis=0)[None], np.stack([loop, np.roll(loop, -1), tip], axis=1)


def _faces_around(faces: IntArray, loop: IntArray, num_vertices: int) -> BoolArray:
    """Return the (F,) flags of faces within two rings of a loop: all that tells how the wall curves there."""
    is_near = np.zeros(num_vertices, dtype=bool)
    is_near[loop] = True
    for _ in range(2):
        touching = is_near[faces].any(axis=1)
        is_near[faces[touching]] = True
    return np.asarray(touching)


def _flat_cap(vertices: Array, loop: IntArray) -> IntArray | None:
    """Return the (K - 2, 3) triangles over a loop, cut in the plane that fits it best; None when it folds there."""
    import mapbox_earcut
    import shapely

    points = vertices[loop]
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    flat = (points - points.mean(axis=0)) @ axes[:2].T
    outline = shapely.Polygon(flat)
    triangles = mapbox_earcut.triangulate_float64(flat, np.array([len(loop)], dtype=np.uint32)).reshape(-1, 3)
    if not outline.is_valid or len(triangles) != len(loop) - 2:
        return None
    # earcut winds its triangles one way whatever the outline's; the cap must follow the loop.
    corners = flat[triangles]
    winding = np.linalg.det(np.dstack([corners, np.ones(corners.shape[:2])])).sum()
    if (winding > 0) != outline.exterior.is_ccw:
        triangles = triangles[:, ::-1]
    cap: IntArray = loop[triangles]
    return cap
