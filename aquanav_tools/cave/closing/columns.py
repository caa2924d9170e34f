"""Columns: the water between the surface invented across an open end and the plane where it is cut.

A cut takes away what lies outside of its plane. Invented surface that lies inside of it would stay, as a wall that
nobody saw in the middle of the end, and might shut out cameras. One column along the normal makes water of what lies
between: its sides follow the outline of the end, its bottom lies in the water that is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

MAX_DEPTH = 2.0
"""Surface reaches in no deeper than this many radii of the end: more is another part of the passage."""
MIN_ENTRY_COSINE = 0.35
"""Cosine to the normal of surface through which water is met: floor and walls along the passage are beside the end."""
SINK_VOXELS = 1.0
"""The column begins this far inside the water, voxels."""
BEYOND_VOXELS = 3.0
"""It ends this far beyond the plane, voxels: the cut meets straight sides."""
EVEN_VOXELS = 3.0
"""It has no teeth and slots narrower than twice this: the rim of a scan ends in steps."""
ROCK_VOXELS = 1.0
"""Observed rock before it stays, but for teeth of its rim narrower than twice this."""
GROWN_VOXELS = 1.0
"""It is wider than the end by this on all sides, voxels: so near to the wall, invented surface counts as scanned."""
SMOOTHING = 1.5
"""Standard deviation of the filter that rounds the steps of its outline, pixels."""
MAX_PIXELS = 200
"""Along each side of the grid on which an end is looked into; one pixel per voxel where that is less."""
MARGIN = 6
"""Pixels around what is looked into: the outline is known on both of its sides."""


@dataclass(frozen=True, eq=False)
class Column:
    """Water over a height field."""

    base: Array
    """(3,) origin on the plane, m."""
    frame: Array
    """(3, 3) rows: two axes in the plane, and the normal out of the water."""
    first: Array
    """(2,) of the middle of the first pixel, in the plane, m."""
    pixel: float
    """Spacing of pixels, m."""
    outline: Array
    """(W, H) distance from the outline, positive within, m."""
    bottom: Array
    """(W, H) heights above the plane at which it begins, m."""
    top: float
    """Height at which it ends, m."""

    @property
    def box(self) -> Array:
        """(2, 3) the corners of the axis-parallel box around it, m."""
        last = self.first + self.pixel * (np.array(self.outline.shape) - 1)
        low, high = [*self.first, self.bottom.min()], [*last, self.top]
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
        places = corners @ self.frame + self.base
        return np.stack([places.min(axis=0), places.max(axis=0)])

    def depth(self, points: Array) -> Array:
        """Return the (N,) distances of (N, 3) points from its sides, bottom or top, positive within it, m."""
        from scipy.ndimage import map_coordinates

        local = (points - self.base) @ self.frame.T
        pixels = ((local[:, :2] - self.first) / self.pixel).T
        sides = map_coordinates(self.outline, pixels, order=1, mode="nearest")
        bottom = map_coordinates(self.bottom, pixels, order=1, mode="nearest")
        inside: Array = np.minimum(np.minimum(sides, local[:, 2] - bottom), self.top - local[:, 2])
        return inside


def column_to_plane(
    mesh: Mesh, end: IntArray, patch: IntArray, point: Array, normal: Array, voxel: float
) -> Column | None:
    """Return the water from the surface invented across an end out to a plane; None where none is missing.

    Seen from the plane, nothing but invented surface is in its way: observed rock and other passages stay.

    Args:
        mesh: closed, normals out of the water.
        end: (N,) its faces across the end.
        patch: (K,) all that was invented around it, in one piece with it.
        point: (3,) on the plane, m.
        normal: (3,) unit vector out of the water.
        voxel: resolution of the scan, m.
    """
    frame = np.stack([*plane_axes(normal), normal])
    corners = (mesh.triangles[end] - point) @ frame.T
    pixels = _Pixels(corners[..., :2].reshape(-1, 2), voxel)
    top = BEYOND_VOXELS * voxel
    depth, is_blocked = _look_in(mesh, patch, pixels.centres @ frame[:2] + point + top * normal, normal)
    bottom, is_blocked = (depth + top).reshape(pixels.counts), is_blocked.reshape(pixels.counts)
    deepest = MAX_DEPTH * float(np.linalg.norm(corners[..., :2], axis=-1).max())
    is_met = np.isfinite(bottom) & (bottom > -deepest) & pixels.are_before(corners)
    is_column = _closed(is_met, EVEN_VOXELS * voxel / pixels.size) & ~_opened(
        is_blocked, ROCK_VOXELS * voxel / pixels.size
    )
    is_column = _opened(is_column, EVEN_VOXELS * voxel / pixels.size)
    if not (is_column & is_met & (bottom < 0.0)).any():
        return None
    return Column(
        point,
        frame,
        pixels.first,
        pixels.size,
        pixels.outline(is_column) + GROWN_VOXELS * voxel,
        pixels.lowest(bottom, is_met) - SINK_VOXELS * voxel,
        top,
    )


class _Pixels:
    """A grid in a plane, through which an end is looked into along the normal."""

    def __init__(self, places: Array, voxel: float) -> None:
        low, high = places.min(axis=0), places.max(axis=0)
        self.size = max(voxel, float((high - low).max()) / MAX_PIXELS)
        self.first = low - MARGIN * self.size
        self.counts = np.ceil((high - low) / self.size).astype(np.int64) + 2 * MARGIN + 1
        self.centres = self.first + self.size * np.indices(self.counts).reshape(2, -1).T

    def are_before(self, corners: Array) -> BoolArray:
        """Return the (W, H) flags of pixels inside the convex outline of (N, 3, 3) corners."""
        from scipy.spatial import ConvexHull

        sides = ConvexHull(corners[..., :2].reshape(-1, 2)).equations
        within: BoolArray = (self.centres @ sides[:, :2].T + sides[:, 2] <= 0.0).all(axis=1)
        return within.reshape(self.counts)

    def outline(self, chosen: BoolArray) -> Array:
        """Return the (W, H) distances from the rounded border of flags, positive within, m."""
        from scipy.ndimage import distance_transform_edt, gaussian_filter

        steps = np.where(chosen, distance_transform_edt(chosen) - 0.5, 0.5 - distance_transform_edt(~chosen))
        return np.asarray(self.size * gaussian_filter(steps, SMOOTHING))

    def lowest(self, heights: Array, is_known: BoolArray) -> Array:
        """Return the (W, H) least heights around each pixel; where none is known, those of the nearest one."""
        from scipy.ndimage import distance_transform_edt, minimum_filter

        nearest = distance_transform_edt(~is_known, return_distances=False, return_indices=True)
        return np.asarray(minimum_filter(heights[tuple(nearest)], size=3))


def _opened(chosen: BoolArray, radius: float) -> BoolArray:
    """Return (W, H) flags without teeth, and parts, narrower than a disc of some pixels."""
    from scipy.ndimage import distance_transform_edt

    # A border of pixels is never chosen: the distance to one that is not is known everywhere.
    kept = distance_transform_edt(chosen) > radius
    opened: BoolArray = distance_transform_edt(~kept) <= radius if kept.any() else kept
    return opened


def _closed(chosen: BoolArray, radius: float) -> BoolArray:
    """Return (W, H) flags without slots narrower than a disc of some pixels, and without holes."""
    from scipy.ndimage import binary_fill_holes, distance_transform_edt

    if not chosen.any():
        return chosen
    closed: BoolArray = binary_fill_holes(distance_transform_edt(distance_transform_edt(~chosen) <= radius) > radius)
    return closed


def _look_in(mesh: Mesh, patch: IntArray, starts: Array, normal: Array) -> tuple[Array, BoolArray]:
    """Look from (N, 3) starts against the normal: return the (N,) heights of the lowest water, and what is blocked.

    Heights are not positive, and inf where no water is met. Nothing but the patch is met before that water, however the
    patch is folded; a look is blocked where other surface is met first.
    """
    caster = mesh.to_trimesh().ray
    directions = np.tile(-normal, (len(starts), 1))
    faces, rays, places = caster.intersects_id(starts, directions, multiple_hits=True, return_locations=True)
    heights = np.einsum("ni,i->n", places - starts[rays], normal)
    order = np.lexsort((-heights, rays))
    faces, rays, heights = faces[order], rays[order], heights[order]
    is_first = np.diff(rays, prepend=-1) != 0
    is_other = ~np.isin(faces, patch)
    count = np.cumsum(is_other)
    is_free: BoolArray = count - (count - is_other)[np.searchsorted(rays, rays)] == 0
    facing = mesh.normals[faces] @ normal
    lowest = np.full(len(starts), np.inf)
    in_water = is_first & (facing < 0.0)  # the start: what is met first is met from within
    lowest[rays[in_water]] = 0.0
    enters = is_free & (facing > MIN_ENTRY_COSINE)
    np.minimum.at(lowest, rays[enters], heights[enters])
    is_blocked = np.zeros(len(starts), dtype=bool)
    is_blocked[rays[is_first & is_other & (facing > 0.0)]] = True
    return lowest, is_blocked
