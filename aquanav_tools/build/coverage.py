"""Which wall the photos show, and how often."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.reconstruct.record import DenseView
from aquanav_tools.types import Array, IntArray, Sim3

NEAREST = 0.1
"""What is nearer to a lens is out of focus, m."""
HIDDEN_BY = 0.03
"""Wall is hidden when a ray to it meets other wall this much before it, m: above the chords of the surface."""
MOST_OBLIQUE = np.cos(np.radians(80.0))
"""Wall that is seen more obliquely is a line in the photo and cannot be measured."""


def count_photos(cavity: Cavity, views: Sequence[DenseView], world_from_sfm: Sim3) -> IntArray:
    """Return the (F,) photos that show the middle of each face: in the frame, turned to the camera, hidden by nothing.

    Args:
        cavity: its wall hides what lies behind; one looks through portals.
        views: undistorted photos.
        world_from_sfm: where their frame lies in that of the cavity.
    """
    scene, triangles = RayScene(cavity.walls), cavity.mesh.triangles
    middles, normals = triangles.mean(axis=1), cavity.mesh.normals
    counts = np.zeros(len(middles), np.int64)
    for view in views:
        centre = world_from_sfm.apply(view.centre[None])[0]
        faces = _in_frame(view, centre, view.rotation @ world_from_sfm.rotation.T, middles, normals)
        ways = middles[faces] - centre
        counts[faces] += (1.0 - scene.lengths(centre, ways)) * np.linalg.norm(ways, axis=1) < HIDDEN_BY
    return counts


def _in_frame(view: DenseView, centre: Array, cam_from_world: Array, middles: Array, normals: Array) -> IntArray:
    """Return the faces in a photo's frame that are turned to it."""
    ways = middles - centre
    distance = np.linalg.norm(ways, axis=1)
    facing = np.einsum("ij,ij->i", ways, normals)  # normals lead out of the water, away from the camera
    faces = np.flatnonzero((distance > NEAREST) & (facing > MOST_OBLIQUE * distance))
    pixels = ways[faces] @ (view.matrix @ cam_from_world).T
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = pixels[:, :2] / pixels[:, 2:]
    inside: IntArray = faces[(pixels[:, 2] > 0.0) & np.all((flat >= 0.0) & (flat < view.size), axis=1)]
    return inside
