"""Ends: where the open ends of a passage are cut, and what water has to be added before.

An end is cut flat just inside its rim. In a scan from photos, a ragged one at the middle of the rim, for the sake of
the wall beyond its innermost part; and outside of the cameras, which were in the water. What water the surface invented
across the end lacks up to there is added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.cave.closing.columns import Column, column_to_plane
from aquanav_tools.cave.closing.openings import MIN_AGREEMENT, Opening, rim
from aquanav_tools.types import Array, BoolArray, Mesh

FLAT_LID = 1e-3
"""An end whose surface is flat to this share of a voxel needs no cut: it is the portal."""
MIN_RAGGED = 0.15
"""The innermost part of a ragged rim lies this many diameters before its middle: of the demo's rims not a tenth."""
CAMERA_VOXELS = 2.0
"""A cut passes a camera at least this far outside, voxels: more than it may move inwards later."""
MAX_DIP_VOXELS = 0.5
"""Surface that reaches in by no more than this beyond the plane moves it; for more, water is added."""
WAY_RADII = 2.0
"""Cameras this many radii around an end tell the way the passage goes there ..."""
MIN_WAY_AGREEMENT = 0.5
"""... unless it is more than 60 degrees off the way that the end faces ..."""
MAX_REST = 0.3
"""An end is in pieces when others of the same patch face its way, with this share of its area."""
MIN_WAY_LENGTH = 2.0
"""... or they went to and fro: along the way they are spread this many times as far as across."""
PASSED_RADII = 2.0
"""Photos that go on through the plane of an opening no farther than this from its middle, radii, and then farther away,
were taken along the passage that a flat cut there would end. Chosen: an end is drawn out to cameras that its surface
shut out nearer than that; across the corner of a corridor a cut 0.75 m wide, 1.5 radii from the walk, divided it."""
MAX_STEP = 3.0
"""A step from photo to photo longer than this many typical ones was not walked."""
NO_CAMERAS = np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class End:
    """A flat cut across an open end."""

    point: Array
    """(3,) on the plane, m."""
    normal: Array
    """(3,) unit vector out of the water."""
    radius: float
    """Around the point lies all of the end, m."""
    diameter: float
    """Of the circle as large as the end, m."""
    places: Array
    """(N, 3) on the surface that was invented across it, m."""
    is_flat: bool
    """Whether that surface is the lid already."""
    column: Column | None = None
    """Water that is missing before the plane."""


def find_ends(openings: tuple[Opening, ...], mesh: Mesh, voxel: float, cameras: Array = NO_CAMERAS) -> tuple[End, ...]:
    """Return where the open ends among the openings of a closed mesh are cut.

    Args:
        openings: from `find_openings`.
        mesh: closed, normals out of the water.
        voxel: resolution of the scan, m.
        cameras: (N, 3) places that were in the water, m.
    """
    return tuple(_end(opening, mesh, voxel, cameras) for opening in openings if opening.is_portal)


def without_passed(openings: tuple[Opening, ...], cameras: Array) -> tuple[Opening, ...]:
    """Return openings of which those are no ends of the passage that photos were taken through, one after the other.

    Args:
        openings: from `find_openings`.
        cameras: (N, 3) where photos were taken, in their order, m.
    """
    return tuple(
        replace(one, is_portal=one.is_portal and not (_is_passed(one, cameras) or _is_passed(one, cameras[::-1])))
        for one in openings
    )


def _is_passed(opening: Opening, cameras: Array) -> bool:
    """Return whether some way from photo to photo leads out through or beside an opening and far away from it."""
    if len(cameras) < 2:
        return False
    steps = np.linalg.norm(np.diff(cameras, axis=0), axis=1)
    heights = (cameras - opening.centre) @ opening.normal
    for first in np.flatnonzero((heights[:-1] <= 0.0) & (heights[1:] > 0.0) & (steps <= MAX_STEP * np.median(steps))):
        share = heights[first] / (heights[first] - heights[first + 1])
        crossing = cameras[first] + share * (cameras[first + 1] - cameras[first])
        if np.linalg.norm(crossing - opening.centre) > PASSED_RADII * opening.radius:
            continue
        is_left = (heights[first + 1 :] <= 0.0) | (steps[first:] > MAX_STEP * np.median(steps))
        end = first + 1 + int(np.argmax(is_left)) if is_left.any() else len(cameras)
        away = np.linalg.norm(cameras[first + 1 : end] - opening.centre, axis=1)
        if away.max(initial=0.0) > PASSED_RADII * opening.radius:
            return True
    return False


def _end(opening: Opening, mesh: Mesh, voxel: float, cameras: Array) -> End:
    corners = mesh.triangles[opening.faces]
    end = End(opening.centre, opening.normal, opening.radius, opening.diameter, corners.mean(axis=1), True)
    if np.abs((corners - end.point) @ end.normal).max() < FLAT_LID * voxel:
        return end
    if len(cameras):
        opening = _inside_of_rim(_along_the_way(opening, mesh, cameras), mesh)
        opening = _beyond_cameras(opening, mesh, cameras, voxel)
    normal, point = opening.normal, opening.centre + opening.innermost * opening.normal
    dip = float(-((corners - point) @ normal).min())
    column = None
    if dip > MAX_DIP_VOXELS * voxel:
        column = column_to_plane(mesh, opening.faces, opening.patch, point, normal, voxel)
    else:
        point = point - max(dip, 0.0) * normal
    # What was invented in one piece with the end belongs to it where it lies beyond the plane.
    rest = mesh.triangles[np.setdiff1d(opening.patch, opening.faces)].mean(axis=1)
    is_beyond = ((rest - point) @ normal > 0.0) & (np.linalg.norm(rest - point, axis=1) < opening.radius)
    places = np.concatenate([end.places, rest[is_beyond]])
    return replace(end, point=point, normal=normal, places=places, is_flat=False, column=column)


def _inside_of_rim(opening: Opening, mesh: Mesh) -> Opening:
    """Return an opening whose cut passes just inside of its rim, and through the middle of a ragged one."""
    heights = (mesh.vertices[rim(mesh.faces[opening.faces])] - opening.centre) @ opening.normal
    innermost, middle = float(heights.min()), float(np.median(heights))
    return replace(opening, innermost=middle if middle - innermost > MIN_RAGGED * opening.diameter else innermost)


def _beyond_cameras(opening: Opening, mesh: Mesh, cameras: Array, voxel: float) -> Opening:
    """Return an opening whose cut passes outside of the cameras before it: they were in the water that is kept."""
    import igl

    offsets = cameras - opening.centre
    is_ahead = offsets @ opening.normal > opening.innermost - CAMERA_VOXELS * voxel
    near = cameras[is_ahead & (np.linalg.norm(offsets, axis=1) < opening.radius)]
    if not len(near):
        return opening
    is_inside = np.asarray(igl.fast_winding_number(mesh.vertices, mesh.faces, near)) > 0.5
    is_shut_out = ~is_inside & _are_before(opening, mesh, near)
    if is_shut_out.any():
        farthest = float(((near[is_inside | is_shut_out] - opening.centre) @ opening.normal).max())
        return replace(opening, innermost=max(opening.innermost, farthest + CAMERA_VOXELS * voxel))
    farthest = float(((near[is_inside] - opening.centre) @ opening.normal).max(initial=-np.inf))
    # Half-way to the top of the surface at most: beyond it there is no water to cut through.
    moved = min(farthest + CAMERA_VOXELS * voxel, 0.5 * (farthest + opening.outermost))
    return replace(opening, innermost=max(opening.innermost, moved))


def _are_before(opening: Opening, mesh: Mesh, places: Array) -> BoolArray:
    """Return the (N,) flags of places from which the way into the cave, against the normal, first meets the patch."""
    directions = np.broadcast_to(-opening.normal, places.shape)
    return np.isin(mesh.to_trimesh().ray.intersects_first(places, directions), opening.patch)


def _along_the_way(opening: Opening, mesh: Mesh, cameras: Array) -> Opening:
    """Return an opening that faces the way the cameras went there.

    Only one whose surface shuts cameras out, or that is in pieces: it lies as walls happen to be unseen.
    """
    around = cameras[np.linalg.norm(cameras - opening.centre, axis=1) < WAY_RADII * opening.radius]
    if len(around) < 2 or not (_is_in_pieces(opening, mesh) or _are_before(opening, mesh, around).any()):
        return opening
    _, spread, ways = np.linalg.svd(around - around.mean(axis=0))
    way = ways[0] if ways[0] @ opening.normal > 0.0 else -ways[0]
    if way @ opening.normal < MIN_WAY_AGREEMENT or spread[0] < MIN_WAY_LENGTH * spread[1]:
        return opening
    heights = (mesh.triangles[opening.faces] - opening.centre) @ way
    return replace(opening, normal=way, outermost=float(heights.max()))


def _is_in_pieces(opening: Opening, mesh: Mesh) -> bool:
    rest = np.setdiff1d(opening.patch, opening.faces)
    ahead = rest[mesh.normals[rest] @ opening.normal > MIN_AGREEMENT]
    return float((mesh.vector_areas[ahead] @ opening.normal).sum()) > MAX_REST * opening.area
