"""Damage of passes through a cave: what nobody scanned, passes that drifted apart, a room that is there twice."""

from __future__ import annotations

import dataclasses

import numpy as np

from aquanav_tools.geometry.polyline import arc_lengths, resample
from aquanav_tools.synthetic.damage import DamagedScan
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh, PointCloud

PATH_STEP = 0.05
"""Spacing of a path's points where a strip of wall beside it is missing, m."""
MIN_ASIDE = 0.6
"""Wall within 53 degrees of a direction lies on that side of the path."""


def miss_strip(scan: DamagedScan, length: float, side: tuple[float, float, float]) -> DamagedScan:
    """Return the scan without `length` (m) of the wall beside its first path's middle; (0, 0, 1) is the roof's side."""
    from scipy.spatial import cKDTree

    path, mesh = resample(scan.truth.paths[0], PATH_STEP), scan.mesh
    middles = mesh.triangles.mean(axis=1)
    nearest = cKDTree(path).query(middles)[1]
    ways = middles - path[nearest]
    is_there = np.abs(nearest - 0.5 * len(path)) * PATH_STEP < 0.5 * length
    is_aside = ways @ np.array(side) > MIN_ASIDE * np.linalg.norm(ways, axis=1)
    return dataclasses.replace(scan, surface=Mesh(mesh.vertices, mesh.faces[~(is_there & is_aside)]))


def scan_from_stations(scan: DamagedScan, spacing: float, number: int, reach: float, seed: int) -> DamagedScan:
    """Return what scanners on tripods see: the first wall on each ray, and nothing behind rocks and corners.

    Args:
        scan: a mesh whose truth has a path.
        spacing: distance between stations along the first path, m.
        number: rays of each station, evenly over the sphere, turned by chance.
        reach: longest range, m.
        seed: of every draw.

    Returns:
        A cloud without normals.
    """
    solid, rng = scan.mesh.to_trimesh(), np.random.default_rng(seed)
    path = scan.truth.paths[0]
    along = arc_lengths(path)
    places = np.arange(0.5 * min(spacing, along[-1]), along[-1], spacing)
    points = []
    for station in np.stack([np.interp(places, along, path[:, axis]) for axis in range(3)], axis=1):
        rays = _sphere(number, rng)
        origins = np.broadcast_to(station, rays.shape)
        hits, _, _ = solid.ray.intersects_location(origins, rays, multiple_hits=False)
        points.append(hits[np.linalg.norm(hits - station, axis=1) <= reach])
    return dataclasses.replace(scan, surface=PointCloud(np.concatenate(points)))


def drift_passes(scan: DamagedScan, number: int, drift: float, share: float, seed: int) -> DamagedScan:
    """Return the scan as several passes that fit at the lowest end of its longest axis, and drift apart from there.

    Args:
        scan: a mesh.
        number: of passes; each saw all of the wall but what it left out.
        drift: by how far the far end of each pass lies off, m.
        share: of the wall that each pass saw, in patches.
        seed: of every draw.
    """
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    vertices: list[Array] = []
    faces: list[IntArray] = []
    for _ in range(number):
        direction = rng.normal(size=3)
        shift = drift * _place_along(mesh)[:, None] ** 1.5 * direction / np.linalg.norm(direction)
        faces.append(mesh.faces[_in_patches(mesh, share, rng)] + sum(map(len, vertices)))
        vertices.append(mesh.vertices + shift)
    return dataclasses.replace(scan, surface=Mesh(np.concatenate(vertices), np.concatenate(faces)))


def repeat_room(scan: DamagedScan, share: float, offset: float, angle: float, seed: int) -> DamagedScan:
    """Return the scan with a part of it a second time, moved and turned, as a lost and found tracker leaves it.

    Args:
        scan: a mesh.
        share: of the longest axis that is there twice, somewhere within it.
        offset: by how far the second one lies off sideways, m.
        angle: by how much it is turned about the vertical through its middle, rad.
        seed: of every draw.
    """
    mesh, rng = scan.mesh, np.random.default_rng(seed)
    begin = rng.uniform(0.1, 0.9 - share)
    place = _place_along(mesh)[mesh.faces].mean(axis=1)
    copied = mesh.faces[(place >= begin) & (place <= begin + share)]
    middle = mesh.vertices[np.unique(copied)].mean(axis=0)
    heading, (cos, sin) = rng.uniform(0.0, 2.0 * np.pi), (np.cos(angle), np.sin(angle))
    turned = (mesh.vertices - middle) @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) + middle
    moved = turned + offset * np.array([np.cos(heading), np.sin(heading), 0.0])
    both = np.concatenate([mesh.vertices, moved]), np.concatenate([mesh.faces, copied + len(mesh.vertices)])
    return dataclasses.replace(scan, surface=Mesh(*both))


def _place_along(mesh: Mesh) -> Array:
    """Return the (V,) place of each vertex along the longest axis, from 0 to 1."""
    extent = np.ptp(mesh.vertices, axis=0)
    axis = int(extent.argmax())
    place: Array = (mesh.vertices[:, axis] - mesh.vertices[:, axis].min()) / extent[axis]
    return place


def _in_patches(mesh: Mesh, share: float, rng: np.random.Generator, number: int = 60) -> BoolArray:
    """Return the (F,) flags of about a share of the faces: those nearest to some of a number of places on the wall."""
    from scipy.spatial import cKDTree

    middles = mesh.triangles.mean(axis=1)
    patch = cKDTree(middles[rng.choice(len(middles), number)]).query(middles)[1]
    is_seen: BoolArray = (rng.permutation(number) < share * number)[patch]
    return is_seen


def _sphere(number: int, rng: np.random.Generator) -> Array:
    """Return (number, 3) unit vectors spread evenly over the sphere, turned by chance."""
    from scipy.spatial.transform import Rotation

    index = np.arange(number) + 0.5
    z, angle = 1.0 - 2.0 * index / number, np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z * z)
    even = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    turned: Array = Rotation.random(random_state=rng).apply(even)
    return turned
