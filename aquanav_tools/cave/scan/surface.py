"""From a scanned mesh to a clean, open surface that faces the water: the input of closing."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.scan.light import dark_faces
from aquanav_tools.cave.scan.orientation import face_areas, is_gap, orient_outward
from aquanav_tools.errors import InputError
from aquanav_tools.geometry.mesh.patches import Patches, find_patches
from aquanav_tools.geometry.mesh.proximity import are_within, surface_tree
from aquanav_tools.geometry.mesh.welding import weld
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

MIN_PATCH_SHARE = 0.01
"""Patches with less than this share of the largest one's area are stray objects or scraps ..."""
MAX_STRAY_SHARE = 0.1
"""... unless they make up more than this share of all: then the scan is a soup of fragments and all of it is wall."""
SPIKE_RATIO = 4.0
"""A vertex whose shortest edge is this many times longer than the median edge around it is a spike."""
MAX_SPIKE_ANGLE = 2.5
"""... and the angles of the faces around it add up to less than this, rad. Where the wall is flat they make a whole
turn and at its border half a turn, however narrow the triangles are."""
MAX_SPIKES = 0.05
"""Where more vertices than this share look like spikes, that is what the surface is like."""
GAP_VOXELS = 4.0
"""Space between two layers of wall that is thinner than this is no passage, voxels."""
MIN_FAR_SHARE = 1e-3
"""Where less of the scan than this share lies off the closed surface, no fit and no share of it tells whether it is a
second layer."""
RAY_OFFSET = 0.1
"""Rays that look for the water start this far from a face, voxels: beyond its noise, before the other side."""


@dataclass(frozen=True, eq=False)
class Surface:
    """An open surface that faces the water."""

    mesh: Mesh
    """Normals out of the water."""
    points: Array
    """(N, 3) the scanned points it stands for: what the cavity's fit is measured against, m; of photos, each as often
    as photos confirm them."""
    dropped_share: float = 0.0
    """Share of the scanned area that was stray objects, spikes, or wall hidden behind other wall or out of view."""
    turned_share: float = 0.0
    """Share of the area that was wound the other way round than the most of it."""


NO_LAMPS = np.zeros((0, 3))


def surface_from_mesh(mesh: Mesh, voxel: float, lamps: Array = NO_LAMPS) -> Surface:
    """Return the walls in a triangle soup: welded, without strays and spikes, facing the water.

    Args:
        mesh: any triangles, wound any way.
        voxel: resolution of the scan, m.
        lamps: (N, 3) places that are known to be water, m.

    Raises:
        InputError: no triangle has an area.
    """
    clean = clean_mesh(mesh)
    if not len(clean.faces):
        raise InputError(f"None of the scan's {len(mesh.faces)} triangles has an area. Export the scan again.")
    area = float(face_areas(clean)[0].sum())
    smooth = Mesh(clean.vertices, clean.faces[~_spikes(clean)])
    smooth = Mesh(smooth.vertices, smooth.faces[~dark_faces(smooth, lamps, RAY_OFFSET * voxel)])
    facing = orient_outward(_main_patches(find_patches(smooth)), RAY_OFFSET * voxel)
    if facing.hidden_share > 0.0:
        # What was one patch with the outside of a shell is one of its own now, and votes as one.
        facing = orient_outward(_main_patches(find_patches(facing.mesh)), RAY_OFFSET * voxel)
    kept = _without_unused(facing.mesh)
    turned = min(facing.turned_share, 1.0 - facing.turned_share)
    return Surface(kept, kept.vertices, 1.0 - float(face_areas(kept)[0].sum()) / area, turned)


def surface_facing_water(mesh: Mesh) -> Surface:
    """Return the walls of triangles that are known to face the water, welded and without strays.

    Raises:
        InputError: no triangle has an area.
    """
    clean = clean_mesh(mesh)
    if not len(clean.faces):
        raise InputError(
            f"None of the {len(mesh.faces)} triangles fitted to the points has an area. Give a larger --voxel."
        )
    kept = _without_unused(_main_patches(Patches(clean, find_patches(clean).ids)).mesh)
    return Surface(kept, kept.vertices, 1.0 - float(kept.areas.sum()) / float(clean.areas.sum()))


def without_gaps(surface: Surface, closed: Mesh, voxel: float) -> Surface:
    """Return the surface without second layers of wall: what the closed surface passes by for good reason.

    Args:
        surface: the scan.
        closed: the closed surface made from it.
        voxel: resolution of the scan, m.
    """
    mesh = surface.mesh
    far = np.flatnonzero(~are_within(surface_tree(closed), mesh.triangles.mean(axis=1), voxel))
    areas = face_areas(mesh)[0]
    if areas[far].sum() <= MIN_FAR_SHARE * areas.sum():
        return surface
    gaps = far[is_gap(mesh, far, GAP_VOXELS * voxel, RAY_OFFSET * voxel)]
    is_kept = np.ones(len(mesh.faces), dtype=bool)
    is_kept[gaps] = False
    kept = _without_unused(Mesh(mesh.vertices, mesh.faces[is_kept]))
    share = surface.dropped_share + (1.0 - surface.dropped_share) * float(areas[gaps].sum() / areas.sum())
    points = kept.vertices if surface.points is mesh.vertices else surface.points
    return Surface(kept, points, share, surface.turned_share)


def clean_mesh(mesh: Mesh) -> Mesh:
    """Return the mesh with equal vertices merged and degenerate and repeated faces removed."""
    return weld(mesh)


def _spikes(mesh: Mesh) -> BoolArray:
    """Return the (F,) flags of faces at a vertex that juts far out of its surroundings, as an outlier does."""
    opposite, lengths = _edges_at_corners(mesh)
    corners = mesh.faces.ravel()
    shortest = np.full(len(mesh.vertices), np.inf)
    np.minimum.at(shortest, corners, lengths.min(axis=1))
    narrowest = np.full(len(mesh.vertices), np.inf)
    np.minimum.at(narrowest, corners, opposite)
    # Where the shortest edge at a vertex is no longer than that many times the shortest around it, it is no spike.
    may_be = shortest > SPIKE_RATIO * narrowest
    is_asked = may_be[corners]
    around = _median_by(corners[is_asked], opposite[is_asked], len(mesh.vertices))
    is_spike = may_be & (shortest > SPIKE_RATIO * around)
    is_spike[is_spike] = _angles_around(mesh, is_spike)[is_spike] < MAX_SPIKE_ANGLE
    if is_spike.mean() > MAX_SPIKES:
        return np.zeros(len(mesh.faces), dtype=bool)
    return np.asarray(is_spike[mesh.faces].any(axis=1))


def _angles_around(mesh: Mesh, asked: BoolArray) -> Array:
    """Return the (V,) sums of the faces' angles at each vertex, rad; right only at those that are asked."""
    faces = mesh.faces[asked[mesh.faces].any(axis=1)]
    corners = mesh.vertices[faces]
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    angles = np.arctan2(np.linalg.norm(np.cross(ahead, back), axis=2), (ahead * back).sum(axis=2))
    sums = np.bincount(faces.ravel(), angles.ravel(), minlength=len(mesh.vertices))
    return sums.astype(np.float64)


def _edges_at_corners(mesh: Mesh) -> tuple[Array, Array]:
    """Return for each of the 3 F face corners the length of the edge opposite and the (3 F, 2) lengths at it, m."""
    corners = mesh.triangles
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)  # ab, bc, ca
    opposite = np.roll(sides, -1, axis=1)
    at_corner = np.stack([sides, np.roll(sides, 1, axis=1)], axis=2)
    return opposite.ravel(), at_corner.reshape(-1, 2)


def _median_by(groups: IntArray, values: Array, count: int) -> Array:
    """Return the median of the values in each group, inf for empty groups."""
    order = np.lexsort((values, groups))
    sizes = np.bincount(groups, minlength=count)
    middle = np.concatenate([[0], np.cumsum(sizes)[:-1]]) + sizes // 2
    medians = np.full(count, np.inf)
    medians[sizes > 0] = values[order][middle[sizes > 0]]
    return medians


def _main_patches(patches: Patches) -> Patches:
    """Return the patches without stray objects."""
    areas = np.bincount(patches.ids, face_areas(patches.mesh)[0])
    is_small = areas < MIN_PATCH_SHARE * areas.max()
    if areas[is_small].sum() > MAX_STRAY_SHARE * areas.sum():
        return patches
    kept = ~is_small[patches.ids]
    logger.info("Left out %d of %d pieces of the scan as strays", is_small.sum(), len(areas))
    _, ids = np.unique(patches.ids[kept], return_inverse=True)
    return Patches(Mesh(patches.mesh.vertices, patches.mesh.faces[kept]), ids.astype(np.int64))


def _without_unused(mesh: Mesh) -> Mesh:
    used, faces = np.unique(mesh.faces, return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int64))
