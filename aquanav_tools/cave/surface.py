"""From a scan to one clean, open, consistently wound surface: the input of closing."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools.errors import InputError, MeshError
from aquanav_tools.libraries import load_open3d
from aquanav_tools.types import Array, IntArray, Mesh, PointCloud

logger = logging.getLogger(__name__)

MIN_COMPONENT_SHARE = 0.01
"""Pieces of the scan with less than this share of the largest one's area are stray objects."""
NUM_NORMAL_NEIGHBOURS = 16
MAX_POISSON_DEPTH = 11
MAX_VOXELS = 15_000_000
"""Bound on the grid's samples when a voxel is chosen: about 1 GB while closing."""
TRIM_VOXELS = 2.5
"""Poisson surface farther than this from any point was invented and is cut off, voxels."""


def choose_voxel(surface: Mesh | PointCloud, vehicle_radius: float) -> float:
    """Return the size of the cells that a scan is resampled with, m.

    Never finer than a quarter of the vehicle's radius, which resolves any place it can pass. A mesh takes its median
    edge, but at most half that radius, since large triangles do not mean low detail; a cloud takes twice its median
    point spacing. Enlarged where the bounding box would hold more than MAX_VOXELS.
    """
    finest = 0.25 * vehicle_radius
    if isinstance(surface, Mesh):
        points = surface.vertices
        size = min(float(np.median(edge_lengths(surface))), 2.0 * finest)
    else:
        points = surface.points
        spacing, _ = cKDTree(points).query(points[:: max(1, len(points) // 20_000)], k=2)
        size = 2.0 * float(np.median(spacing[:, 1]))
    extent = np.percentile(points, 99.5, axis=0) - np.percentile(points, 0.5, axis=0)
    if not extent.max() > 0:
        raise InputError(
            f"All {len(points)} points of the scan lie in one place. The export went wrong, or the unit is wrong; "
            "check the file and --unit."
        )
    smallest = float(np.cbrt(np.prod(np.maximum(extent, extent.max() / 100)) / MAX_VOXELS))
    return max(size, smallest, finest)


def surface_from_mesh(mesh: Mesh) -> Mesh:
    """Return the main pieces of a triangle soup, welded and wound consistently."""
    solid = clean_mesh(mesh).to_trimesh()
    if not len(solid.faces):
        raise InputError(f"None of the scan's {len(mesh.faces)} triangles has an area. Export the scan again.")
    pieces = solid.split(only_watertight=False, repair=False)
    areas = np.array([piece.area for piece in pieces])
    kept = [piece for piece, area in zip(pieces, areas, strict=True) if area >= MIN_COMPONENT_SHARE * areas.max()]
    logger.info("Kept %d of %d pieces of the scan", len(kept), len(pieces))
    import trimesh

    merged = trimesh.util.concatenate(kept)
    if not merged.is_winding_consistent:
        trimesh.repair.fix_winding(merged)
    return Mesh(np.array(merged.vertices), np.array(merged.faces, dtype=np.int64))


def clean_mesh(mesh: Mesh) -> Mesh:
    """Return the mesh with equal vertices merged and degenerate and repeated faces removed."""
    solid = mesh.to_trimesh()
    solid.merge_vertices()
    solid.update_faces(solid.nondegenerate_faces() & solid.unique_faces())
    solid.remove_unreferenced_vertices()
    return Mesh(np.array(solid.vertices), np.array(solid.faces, dtype=np.int64))


def surface_from_cloud(cloud: PointCloud, voxel: float) -> Mesh:
    """Return the screened Poisson surface of a cloud, cut back to where there are points.

    Points without normals get them from their neighbours, oriented consistently along the surface; which side is
    water is decided later, when the surface is closed.
    """
    open3d = load_open3d()
    cleaned = _clean_cloud(open3d, cloud, voxel)
    points = np.asarray(cleaned.points)
    if len(points) < 100:
        raise InputError(
            f"Only {len(points)} of {len(cloud.points)} points remain after removing outliers at {voxel:.3g} m. "
            "The cloud is too sparse for a surface, or the unit is wrong; check --unit or give a larger --voxel."
        )
    extent = float(np.ptp(points, axis=0).max()) * 1.1
    depth = int(np.clip(np.ceil(np.log2(extent / voxel)), 5, MAX_POISSON_DEPTH))
    poisson, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cleaned, depth=depth, n_threads=1)
    vertices, faces = np.asarray(poisson.vertices), np.asarray(poisson.triangles).astype(np.int64)
    distance, _ = cKDTree(points).query(vertices, distance_upper_bound=TRIM_VOXELS * voxel)
    kept = np.isfinite(distance)[faces].all(axis=1)
    return surface_from_mesh(Mesh(vertices, faces[kept]))


def _clean_cloud(open3d: Any, cloud: PointCloud, voxel: float) -> Any:
    """Return the open3d cloud thinned to half a voxel, without outliers, with normals."""
    result = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.points))
    if cloud.normals is not None:
        result.normals = open3d.utility.Vector3dVector(cloud.normals)
    result = result.voxel_down_sample(0.5 * voxel)
    result, _ = result.remove_statistical_outlier(16, 2.5)
    result, _ = result.remove_radius_outlier(4, 2.0 * voxel)
    if cloud.normals is None and len(result.points) > NUM_NORMAL_NEIGHBOURS:
        result.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NUM_NORMAL_NEIGHBOURS))
        result.orient_normals_consistent_tangent_plane(NUM_NORMAL_NEIGHBOURS)
    result.normalize_normals()
    return result


def edge_lengths(mesh: Mesh) -> Array:
    """Return the (3 F,) lengths of all face edges, m; inner edges appear twice."""
    corners = mesh.triangles
    lengths: Array = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).ravel()
    return lengths


def boundary_loops(mesh: Mesh) -> list[IntArray]:
    """Return the vertex indices around every hole, in the winding of the lid that would close it.

    Raises:
        MeshError: a boundary touches itself, so that the loops are not unique.
    """
    directed = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    keys = {(int(a), int(b)) for a, b in directed}
    successor: dict[int, int] = {}
    for a, b in directed:
        if (int(b), int(a)) not in keys:
            if int(b) in successor:
                raise MeshError(f"The boundary touches itself at {mesh.vertices[b].round(3)} m.")
            successor[int(b)] = int(a)
    loops = []
    while successor:
        loop = [next(iter(successor))]
        while (following := successor.pop(loop[-1])) != loop[0]:
            loop.append(following)
        loops.append(np.array(loop, dtype=np.int64))
    return loops
