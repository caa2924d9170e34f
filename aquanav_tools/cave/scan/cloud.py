"""From a point cloud to an open surface that faces the water: screened Poisson, cut back to where there are points."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.cave.scan.confirmed import is_supported, thickness, thin_confirmed
from aquanav_tools.cave.scan.light import dark_faces
from aquanav_tools.cave.scan.orientation import orient_outward
from aquanav_tools.cave.scan.surface import NO_LAMPS, Surface, surface_facing_water, surface_from_mesh
from aquanav_tools.errors import InputError, UnseenWallsError
from aquanav_tools.geometry.mesh.patches import Patches
from aquanav_tools.libraries import load_open3d
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh, PointCloud

PURPOSE = "A surface from a point cloud"
THINNING = 0.5
"""Points are thinned to one per cell of this size, voxels."""
NUM_NEIGHBOURS = 16
OUTLIER_RATIO = 3.0
"""A point is an outlier when its neighbours are this many times farther away than theirs are from them ..."""
LONELY_RATIO = 8.0
"""... or farther than most of the cloud's by this factor: stray points in the open have only each other around."""
SUPPORT_VOXELS = 1.5
"""Points from photos support each other up to this distance, voxels."""
MAX_DEPTH = 11
"""Of Poisson's octree; 2^11 cells along the longest side."""
TRIM_VOXELS = 2.5
TRIM_SPACINGS = 2.0
"""Surface farther from any point than TRIM_VOXELS and TRIM_SPACINGS times the points' spacing there was invented."""
MAX_THICKNESS = 0.76
"""Median thickness over width of the points' surroundings. Measured: walls 0.05 to 0.3, with 5 cm of noise 0.57, real
rooms from photos 0.57 to 0.64; points that fill a volume 0.84 to 0.88, however photos confirm them."""
NUM_SURROUNDING = 48
NUM_THICKNESS_SAMPLES = 5_000
NUM_THICK_PLACES = 8
"""Places that a picture shows."""
ADVICE_ON_PHOTOS = (
    "The photos do not agree on how far the wall is: it may be smooth or dark, or photos blurred or taken from nearly "
    "one place. Take them from farther apart, with more light on the wall."
)
ADVICE_ON_SCANS = "They are noise, or fill the inside of something. Give a cloud of the cave's walls alone."
PATCH_SPACINGS = 1.2
"""Half width of the square that stands for a point when rays look for the water, in spacings of the points there."""
SQUARE_OFFSET = 2.0
"""Rays start this far from a square, in spacings."""


def surface_from_cloud(
    cloud: PointCloud, voxel: float, lamps: Array = NO_LAMPS, *, accept_thick: bool = False
) -> Surface:
    """Return the surface through the points of a cloud.

    Which side is water is known where the cloud comes from photos, or the file tells where its scanner stood: the side
    that was looked from. Elsewhere normals that come with it are used as directions only, and which side is water is
    found out by looking around.

    Args:
        cloud: scanned points.
        voxel: resolution of the surface, m.
        lamps: (N, 3) places that are known to be water, m.
        accept_thick: fit a surface to points that lie on none, too.

    Raises:
        UnseenWallsError: the points lie on no surface.
        InputError: too few points are left without outliers.
    """
    points, normals, spacing, votes, num_outliers = _clean(cloud, voxel)
    knows_side = cloud.faces_water
    if len(points) < 100:
        raise InputError(
            f"Only {len(points)} of {len(cloud.points)} points remain after removing outliers at {voxel:.3g} m. "
            "The cloud is too sparse for a surface, or the unit is wrong; check --unit or give a larger --voxel."
        )
    if not accept_thick:
        _check_lies_on_surface(points, votes, THINNING * voxel, is_from_photos=cloud.faces_water)
    num_thinned = len(spacing) + num_outliers
    if cloud.faces_water:
        outward = -normals
    else:
        is_kept = ~_dark_points(points, normals, np.maximum(spacing, THINNING * voxel), lamps)
        points, normals, spacing = points[is_kept], normals[is_kept], spacing[is_kept]
        signs = _signs_from_scanners(points, normals, cloud)
        knows_side = bool((signs != 0.0).all())
        if not knows_side:
            looked = _outward_signs(points, normals, np.maximum(spacing, THINNING * voxel))
            signs = np.where(signs == 0.0, looked, signs)
        outward = normals * signs[:, None]
    fitted = _poisson(points, outward, voxel)
    trimmed = Mesh(fitted.vertices, fitted.faces[_supported(fitted, points, spacing, voxel)])
    surface = surface_facing_water(trimmed) if knows_side else surface_from_mesh(trimmed, voxel, lamps)
    judging = points[_drawn(votes, len(points))] if cloud.faces_water else points
    return Surface(surface.mesh, judging, 1.0 - len(points) / num_thinned, surface.turned_share)


def _check_lies_on_surface(points: Array, votes: Array, cell: float, *, is_from_photos: bool) -> None:
    """Refuse points that fill a volume.

    Each point is asked as often as photos confirm it. Thinning leaves one point per cell both of a wall that thirty
    photos agree on and of the strays before it, which fill more cells: of a kitchen's thinned points 77 % lie within
    5 cm of its walls, of what its photos confirm 97 %.

    Raises:
        UnseenWallsError: with how thick the surroundings of a typical point are, and where it is.
    """
    from scipy.spatial import cKDTree

    asked, times = np.unique(_drawn(votes, min(NUM_THICKNESS_SAMPLES, len(points))), return_counts=True)
    _, neighbours = cKDTree(points).query(points[asked], k=NUM_SURROUNDING)
    ratios = thickness(points, neighbours)
    typical = float(np.median(np.repeat(ratios, times)))
    if typical <= MAX_THICKNESS:
        return
    order = np.argsort(ratios)
    order = order[ratios[order] >= typical]  # the median first, then what is worse
    shown = order[:: max(1, len(order) // NUM_THICK_PLACES)]
    places = points[asked[shown]]
    place = ", ".join(f"{value:.2f}" for value in places[0])
    weighed = ", each as often as photos confirm it" if is_from_photos else ""
    raise UnseenWallsError(
        "scattered-points",
        f"The points lie on no surface: around a typical one the nearest {NUM_SURROUNDING} are {typical:.2f} times as "
        f"thick as wide. That is the median of {len(asked)} points asked{weighed}, of {len(points)} left after "
        f"thinning to one per {cell:.2g} m; one such place is ({place}) m. On walls it is 0.05 to 0.3, with 5 cm of "
        f"noise 0.57, and in points that fill a volume 0.84 to 0.88 (measured), so that at most {MAX_THICKNESS} is "
        "taken for wall.",
        ADVICE_ON_PHOTOS if is_from_photos else ADVICE_ON_SCANS,
        [
            (tuple(at.tolist()), f"{ratio:.2f} times as thick as wide")
            for at, ratio in zip(places, ratios[shown], strict=True)
        ],
    )


def _drawn(votes: Array, count: int) -> IntArray:
    """Return the (count,) indices of points, each drawn as often as its share of the (N,) votes asks for."""
    every = np.cumsum(votes, dtype=np.float64)
    drawn: IntArray = np.searchsorted(every, every[-1] * (np.arange(count) + 0.5) / count)
    return drawn


def _thinned(cloud: PointCloud, voxel: float) -> tuple[Array, Array]:
    """Return the mean point of each cell and the mean of its normals, 0 where they are unknown."""
    open3d = load_open3d(PURPOSE)
    result = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.points))
    if cloud.normals is not None:
        result.normals = open3d.utility.Vector3dVector(cloud.normals)
    result = result.voxel_down_sample(THINNING * voxel)
    points = np.asarray(result.points)
    return points, np.zeros_like(points) if cloud.normals is None else np.asarray(result.normals)


def _clean(cloud: PointCloud, voxel: float) -> tuple[Array, Array, Array, Array, int]:
    """Return the thinned points without outliers, and how many were outliers.

    Returns:
        (N, 3) points, m; their (N, 3) unit normals, of either sign but where they come from photos; (N,) spacing, m;
        (N,) photos that confirm each, of a scan 1; the number of outliers.
    """
    from scipy.spatial import cKDTree

    if cloud.faces_water:
        points, normals, votes = thin_confirmed(cloud, THINNING * voxel)
    else:
        points, normals = _thinned(cloud, voxel)
        votes = np.ones(len(points))
    if len(points) <= NUM_NEIGHBOURS:
        return points[:0], points[:0], np.zeros(0), np.zeros(0), len(points)
    distances, neighbours = cKDTree(points).query(points, k=NUM_NEIGHBOURS + 1)
    spread = distances[:, 1:].mean(axis=1)
    kept = spread < OUTLIER_RATIO * np.median(spread[neighbours[:, 1:]], axis=1)
    kept &= spread < LONELY_RATIO * np.median(spread)
    if cloud.faces_water:
        kept &= is_supported(points, votes, distances, neighbours, SUPPORT_VOXELS * voxel) & normals.any(axis=1)
    points, spacing, num_outliers = points[kept], distances[kept, 1:5].mean(axis=1), int((~kept).sum())
    if not cloud.faces_water and not (np.linalg.norm(normals, axis=1) > 0.5).all():
        normals = _plane_normals(points)
    else:
        normals = normals[kept] / np.linalg.norm(normals[kept], axis=1, keepdims=True)
    return points, normals, spacing, votes[kept], num_outliers


def _plane_normals(points: Array) -> Array:
    """Return the (N, 3) unit normals of the planes through each point's neighbours, either sign."""
    open3d = load_open3d(PURPOSE)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NUM_NEIGHBOURS))
    return np.asarray(cloud.normals)


def _outward_signs(points: Array, normals: Array, spacing: Array) -> Array:
    """Return the (N,) signs that turn the normals out of the water.

    Small squares stand for the points; each is asked which side of it is water, and neighbours outvote the odd one.
    """
    from scipy.spatial import cKDTree

    squares = _squares(points, normals, spacing)
    facing = orient_outward(squares, SQUARE_OFFSET * float(np.median(spacing)), drop_hidden=False)
    is_turned = (facing.mesh.faces != squares.mesh.faces).any(axis=1)[: len(points)]
    outward = np.where(is_turned, -1.0, 1.0)[:, None] * normals
    _, neighbours = cKDTree(points).query(points, k=min(NUM_NEIGHBOURS, len(points)))
    voted = _outvoted(outward, neighbours)
    signs: Array = np.sign(np.einsum("nk,nk->n", voted, normals))
    return np.where(signs == 0.0, 1.0, signs)


def _signs_from_scanners(points: Array, normals: Array, cloud: PointCloud) -> Array:
    """Return the (N,) signs that turn the normals away from the scanners, 0 where none is known.

    Each point is asked for the scanner of the nearest scanned one; neighbours that the same scanners saw outvote the
    odd one, whose plane is nearly along its ray.
    """
    from scipy.spatial import cKDTree

    if cloud.seen_from is None:
        return np.zeros(len(points))
    _, nearest = cKDTree(cloud.points).query(points)
    rays = points - cloud.seen_from[nearest]
    is_known = np.isfinite(rays).all(axis=1)
    outward = np.zeros_like(normals)
    outward[is_known] = normals[is_known] * np.where((normals * rays)[is_known].sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    _, neighbours = cKDTree(points).query(points, k=min(NUM_NEIGHBOURS, len(points)))
    return np.where(is_known, np.sign(np.einsum("nk,nk->n", _outvoted(outward, neighbours), normals)), 0.0)


def _outvoted(outward: Array, neighbours: IntArray) -> Array:
    """Return the (N, 3) directions, turned over where their (N, K) neighbours' mean points the other way."""
    agreement = np.einsum("nk,nk->n", outward, outward[neighbours].mean(axis=1))
    voted: Array = np.where(agreement >= 0.0, 1.0, -1.0)[:, None] * outward
    return voted


def _dark_points(points: Array, normals: Array, spacing: Array, lamps: Array) -> BoolArray:
    """Return the (N,) flags of points on walls that no light from the lamps reaches, where those are many."""
    squares = _squares(points, normals, spacing).mesh
    is_dark = dark_faces(squares, lamps, SQUARE_OFFSET * float(np.median(spacing)))
    return is_dark[: len(points)] & is_dark[len(points) :]


def _squares(points: Array, normals: Array, spacing: Array) -> Patches:
    """Return a small square for each point: its first triangle, then, after those of all points, its second."""
    half = (PATCH_SPACINGS * spacing)[:, None]
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    side = np.cross(normals, helper)
    side *= half / np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(normals, side)
    corners = np.stack([points - side - up, points + side - up, points + side + up, points - side + up], axis=1)
    first = 4 * np.arange(len(points))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return Patches(Mesh(corners.reshape(-1, 3), faces), np.tile(np.arange(len(points)), 2))


def _poisson(points: Array, normals: Array, voxel: float) -> Mesh:
    open3d = load_open3d(PURPOSE)
    cloud: Any = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.normals = open3d.utility.Vector3dVector(normals)
    extent = float(np.ptp(points, axis=0).max()) * 1.1
    depth = int(np.clip(np.ceil(np.log2(extent / voxel)), 5, MAX_DEPTH))
    fitted, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    return Mesh(np.asarray(fitted.vertices), np.asarray(fitted.triangles).astype(np.int64))


def _supported(fitted: Mesh, points: Array, spacing: Array, voxel: float) -> BoolArray:
    """Return the (F,) flags of faces with a point near all their corners."""
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(points).query(fitted.vertices)
    near = distance <= np.maximum(TRIM_VOXELS * voxel, TRIM_SPACINGS * spacing[nearest])
    supported: BoolArray = near[fitted.faces].all(axis=1)
    return supported
