"""Closing: from an open, holed surface to a solid that encloses the water.

A clean surface is closed exactly, by a lid over each boundary loop. Anything else is resampled: the generalised winding
number of the surface tells water from rock even where the surface has holes (Jacobson et al. 2013, Barill et al. 2018),
and marching cubes on a grid that ends in rock gives a closed surface whatever the input.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import prove_watertight, to_manifold
from aquanav_tools.cave.surface import boundary_loops
from aquanav_tools.errors import MeshError, ResourceError
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

WATER_LEVEL = 0.5
COARSE_STEP = 4
BAND_VOXELS = 4
SCAN_VOXELS = 0.75
"""A resampled face follows the scan when its middle is within this distance of it, voxels."""
SIMPLIFY_VOXELS = 0.1
"""Triangles of the resampled surface are merged where that moves it by no more than this, voxels."""
MAX_GRID_SAMPLES = 200_000_000
"""Closing takes about 60 bytes per sample of its grid."""
MIN_ROCK_SHARE = 1e-4
"""Pieces of rock floating in the water that are smaller than this share of it are noise."""


@dataclass(frozen=True, eq=False)
class ClosedSurface:
    """A proven solid around the water."""

    mesh: Mesh
    is_scan: BoolArray
    """(F,) whether the face follows the scan; the others were invented to close it."""
    method: str
    """"lids" (the scan's own triangles) or "winding" (resampled)."""


def close_surface(surface: Mesh, voxel: float, *, keep_triangles: bool) -> ClosedSurface:
    """Return the solid enclosed by an open surface, normals out of the water.

    Args:
        surface: wound consistently, either way round.
        voxel: size of the grid's cells where the surface is resampled, m.
        keep_triangles: try lids first. For scans that come as meshes; a surface fitted to points is better resampled,
            which smooths the false handles that noise makes.

    Raises:
        MeshError: no space is enclosed.
    """
    if keep_triangles:
        try:
            closed = _close_with_lids(surface)
            return ClosedSurface(closed, np.arange(len(closed.faces)) < len(surface.faces), "lids")
        except MeshError as reason:
            logger.info("Lids do not close the surface (%s); resampling it at %.3g m", reason, voxel)
    closed = _close_by_winding(surface, voxel)
    return ClosedSurface(closed, faces_near(closed, surface, SCAN_VOXELS * voxel), "winding")


def faces_near(closed: Mesh, surface: Mesh, distance: float) -> BoolArray:
    """Return the (F,) flags of faces whose middle lies within `distance` of the scanned surface."""
    import igl

    centroids = closed.triangles.mean(axis=1)
    squared = igl.point_mesh_squared_distance(centroids, surface.vertices, surface.faces)[0]
    near: BoolArray = np.asarray(squared) <= distance**2
    return near


def _close_with_lids(surface: Mesh) -> Mesh:
    """Return the surface with a lid over each boundary loop; its own faces come first, unchanged.

    Raises:
        MeshError: the boundary is not simple, or the result is not a proven solid.
    """
    vertices, lids = surface.vertices, [surface.faces]
    for loop in boundary_loops(surface):
        lid = _flat_lid(vertices, loop)
        if lid is None:  # a loop that folds over itself gets a cone to its middle
            lid = np.stack([loop, np.roll(loop, -1), np.full(len(loop), len(vertices))], axis=1)
            vertices = np.vstack([vertices, vertices[loop].mean(axis=0)])
        lids.append(lid)
    closed = _outward(Mesh(vertices, np.concatenate(lids)))
    prove_watertight(closed)
    return closed


def _flat_lid(vertices: Array, loop: IntArray) -> IntArray | None:
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
    # earcut winds its triangles one way whatever the outline's; the lid must follow the loop.
    corners = flat[triangles]
    winding = np.linalg.det(np.dstack([corners, np.ones(corners.shape[:2])])).sum()
    if (winding > 0) != outline.exterior.is_ccw:
        triangles = triangles[:, ::-1]
    lid: IntArray = loop[triangles]
    return lid


def _close_by_winding(surface: Mesh, voxel: float) -> Mesh:
    origin, shape = _grid_around(surface.vertices, voxel)
    water = _main_water(_signed_field(surface, origin, shape, voxel), voxel, surface)
    from scipy.ndimage import gaussian_filter
    from skimage.measure import marching_cubes

    smooth = gaussian_filter(water, 0.6)
    # Marching cubes makes degenerate faces where a sample lies exactly on the level.
    smooth[np.abs(smooth) < 1e-4 * voxel] = 1e-4 * voxel
    vertices, faces, _, _ = marching_cubes(smooth, 0.0, spacing=(voxel,) * 3)
    solid = to_manifold(_outward(Mesh(vertices.astype(np.float64) + origin, faces.astype(np.int64))))
    largest = max(solid.decompose(), key=lambda piece: piece.volume())
    return from_manifold(largest.simplify(SIMPLIFY_VOXELS * voxel))


def from_manifold(solid) -> Mesh:  # type: ignore[no-untyped-def]  # manifold3d ships no types
    """Return the triangles of a manifold3d solid."""
    mesh = solid.to_mesh64()
    return Mesh(np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, dtype=np.int64))


def _outward(mesh: Mesh) -> Mesh:
    corners = mesh.triangles
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return mesh if volume > 0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def _grid_around(points: Array, voxel: float) -> tuple[Array, tuple[int, int, int]]:
    margin = (BAND_VOXELS + 2) * voxel
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    nx, ny, nz = np.ceil((high - low) / voxel).astype(int) + 1
    if int(nx) * int(ny) * int(nz) > MAX_GRID_SAMPLES:
        coarser = voxel * float(np.cbrt(float(nx) * ny * nz / MAX_GRID_SAMPLES))
        size = " x ".join(f"{count * voxel:.0f}" for count in (nx, ny, nz))
        raise ResourceError(
            f"Closing {size} m at {voxel:.3g} m takes {nx} x {ny} x {nz} samples, more than {MAX_GRID_SAMPLES:.0e} "
            f"(12 GB). Give --voxel {coarser:.2g} or more, or build the cave in parts; if it is not that large, check "
            "--unit."
        )
    return low, (int(nx), int(ny), int(nz))


def _signed_field(surface: Mesh, origin: Array, shape: tuple[int, int, int], voxel: float) -> Array:
    """Return the grid of distances to the surface, negative in water, clipped to BAND_VOXELS.

    Over a hole, where the surface is far, the distance is replaced by how far the winding number is from its level,
    so that the sign changes smoothly through the middle of the hole.
    """
    import igl

    is_near = _near_surface(surface, origin, shape, voxel)
    winding = _winding_grid(surface, origin, voxel, is_near)
    band = BAND_VOXELS * voxel
    field = np.where(winding > WATER_LEVEL, -band, band)
    near = np.argwhere(is_near | (np.abs(winding - WATER_LEVEL) < 0.25))
    squared = igl.point_mesh_squared_distance(origin + voxel * near, surface.vertices, surface.faces)[0]
    at_near = winding[tuple(near.T)] - WATER_LEVEL
    magnitude = np.minimum(np.sqrt(squared), np.abs(at_near) * 20.0 * voxel)
    field[tuple(near.T)] = -np.sign(at_near) * np.minimum(magnitude, band)
    return field


def _winding_grid(surface: Mesh, origin: Array, voxel: float, is_near: BoolArray) -> Array:
    """Return the winding number on the grid: exact near the surface and its holes, from coarse samples elsewhere."""
    import igl

    shape = is_near.shape
    axes = [np.arange(0, n + COARSE_STEP, COARSE_STEP) for n in shape]
    samples = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    coarse = igl.fast_winding_number(surface.vertices, surface.faces, origin + voxel * samples.reshape(-1, 3))
    coarse = np.asarray(coarse).reshape(samples.shape[:3])
    sign = 1.0 if np.percentile(coarse, 99.5) > -np.percentile(coarse, 0.5) else -1.0
    nearest = [
        np.minimum((np.arange(n) + COARSE_STEP // 2) // COARSE_STEP, len(a) - 1)
        for n, a in zip(shape, axes, strict=True)
    ]
    winding = coarse[np.ix_(*nearest)]
    unsure = np.abs(np.abs(winding) - WATER_LEVEL) < 0.35
    fine = np.argwhere(is_near | unsure)
    exact = igl.fast_winding_number(surface.vertices, surface.faces, origin + voxel * fine)
    winding[tuple(fine.T)] = exact
    oriented: Array = sign * winding
    return oriented


def _near_surface(surface: Mesh, origin: Array, shape: tuple[int, int, int], voxel: float) -> BoolArray:
    """Return the grid's samples within about BAND_VOXELS of the surface."""
    from scipy.ndimage import distance_transform_edt

    empty = np.ones(shape, dtype=bool)
    points = np.concatenate([surface.vertices, sample_faces(surface, voxel)])
    empty[tuple(np.rint((points - origin) / voxel).astype(int).T)] = False
    near: BoolArray = distance_transform_edt(empty) <= BAND_VOXELS + 1
    return near


def sample_faces(surface: Mesh, spacing: float) -> Array:
    """Return points that cover every face at about the given spacing."""
    corners = surface.triangles
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.ceil(longest / spacing).astype(int)
    samples = []
    for count in np.unique(steps):
        i, j = np.nonzero(np.add.outer(np.arange(count + 1), np.arange(count + 1)) <= count)
        weights = np.stack([i, j, count - i - j], axis=1) / max(count, 1)
        samples.append(np.einsum("kc,fcx->fkx", weights, corners[steps == count]).reshape(-1, 3))
    return np.concatenate(samples)


def _main_water(field: Array, voxel: float, surface: Mesh) -> Array:
    """Return the field with only its largest body of water, and without crumbs of rock floating in it."""
    from scipy.ndimage import label

    bodies, num_bodies = label(field < 0)
    if num_bodies == 0:
        raise MeshError(
            f"The scan of {len(surface.faces)} triangles encloses no space at {voxel:.3g} m. It is a single wall "
            "or floor and no passage. Scan the surroundings too, or give a smaller --voxel if the passage is narrower."
        )
    sizes = np.bincount(bodies.ravel())
    sizes[0] = 0
    largest = int(sizes.argmax())
    field = np.where((field < 0) & (bodies != largest), voxel, field)
    rocks, _ = label(field >= 0)
    rock_sizes = np.bincount(rocks.ravel())
    is_crumb = rock_sizes < max(MIN_ROCK_SHARE * sizes[largest], 8)
    is_crumb[0] = False
    return np.where(is_crumb[rocks], -voxel, field)
