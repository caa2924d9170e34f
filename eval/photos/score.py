"""How good a reconstruction from photos is, where the truth is known: cloud, surface and camera poses.

Only wall that the photos show counts for completeness: rays from the true cameras tell which that is.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.libraries import load_open3d
from aquanav_tools.photograph.lens import Lens
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.types import Array, BoolArray, Mesh, Sim3

TOLERANCES = (0.02, 0.05, 0.1)
"""At which clouds and surfaces are scored, m."""
MIN_DISTANCE = 0.1
"""What is nearer to a lens is out of focus, m."""
HIDDEN_BY = 0.02
"""A point is hidden when the ray to it meets wall this much before it, m: above the chords of a grid of 5 cm."""


@dataclass(frozen=True, eq=False)
class TrueCameras:
    """What truth.json says."""

    names: tuple[str, ...]
    lens: Lens
    centres: Array
    """(N, 3) world, m."""
    cam_from_world: Array
    """(N, 3, 3) rotations."""


@dataclass(frozen=True)
class CloudScore:
    """A cloud against the true wall at one tolerance."""

    tolerance: float
    """m."""
    precision: float
    """Share of the cloud that lies on the wall."""
    recall: float
    """Share of the seen wall that has a point of the cloud near it."""

    @property
    def f_score(self) -> float:
        """Harmonic mean of the two; 0 when either is."""
        total = self.precision + self.recall
        return 2.0 * self.precision * self.recall / total if total > 0 else 0.0


@dataclass(frozen=True, eq=False)
class PoseScore:
    """Estimated cameras against the true ones, after the similarity transform that fits the centres best."""

    registered: int
    world_from_estimate: Sim3
    centre_errors: Array
    """(M,) m."""
    rotation_errors_deg: Array
    """(M,)."""


def read_true_cameras(folder: Path) -> TrueCameras:
    """Return the cameras of a photographed dive."""
    truth = json.loads((folder / "truth.json").read_text())
    lens = Lens(truth["width"], truth["height"], truth["focal_px"], tuple(truth["parameters"][4:]))
    cameras = truth["cameras"]
    return TrueCameras(
        tuple(camera["name"] for camera in cameras),
        lens,
        np.array([camera["centre"] for camera in cameras]),
        np.array([camera["cam_from_world"] for camera in cameras]),
    )


def read_wall(folder: Path) -> Mesh:
    """Return the wall that could be seen on a photographed dive."""
    import trimesh

    wall = trimesh.load_mesh(folder / "truth_wall.ply", process=False)
    return Mesh(np.asarray(wall.vertices, float), np.asarray(wall.faces, np.int64))


def seen_wall(wall: Mesh, cameras: TrueCameras, min_photos: int = 2, num_samples: int = 20_000, seed: int = 0) -> Array:
    """Return (M, 3) samples, even by area, of the wall that at least `min_photos` photos show."""
    import trimesh

    points = np.asarray(trimesh.sample.sample_surface(wall.to_trimesh(), num_samples, seed=seed)[0])
    scene = SmoothScene(wall)
    count = np.zeros(len(points), int)
    for centre, turn in zip(cameras.centres, cameras.cam_from_world, strict=True):
        count += is_seen(scene, cameras.lens, centre, turn, points)
    return points[count >= min_photos]


def is_seen(scene: SmoothScene, lens: Lens, centre: Array, cam_from_world: Array, points: Array) -> BoolArray:
    """Return (N,) which (N, 3) points of the wall a camera shows: within its frame, and hidden by nothing."""
    pixels = lens.project((points - centre) @ cam_from_world.T)
    inside = np.all((pixels >= 0.0) & (pixels < (lens.width, lens.height)), axis=1)
    distance = np.linalg.norm(points - centre, axis=1)
    inside &= distance > MIN_DISTANCE
    reach, _ = scene.cast(centre, points[inside] - centre)
    seen = np.zeros(len(points), bool)
    seen[inside] = ~(reach * distance[inside] < distance[inside] - HIDDEN_BY)  # NaN: the ray just missed the wall's rim
    return seen


def distances_to(wall: Mesh, points: Array) -> Array:
    """Return the (N,) exact distances from points to a mesh."""
    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor(wall.vertices.astype(np.float32)), o3d.core.Tensor(wall.faces.astype(np.uint32))
    )
    return scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy().astype(np.float64)


def score_cloud(points: Array, wall: Mesh, seen: Array, tolerances: tuple[float, ...] = TOLERANCES) -> list[CloudScore]:
    """Return how (N, 3) points fit the true wall and cover (M, 3) samples of what was seen of it.

    For a surface pass samples of it, even by area (of the faces that were observed, to leave out invented ones).
    """
    from scipy.spatial import cKDTree

    to_wall, (to_cloud, _) = distances_to(wall, points), cKDTree(points).query(seen)
    return [
        CloudScore(tolerance, float(np.mean(to_wall <= tolerance)), float(np.mean(to_cloud <= tolerance)))
        for tolerance in tolerances
    ]


def score_poses(names: tuple[str, ...], centres: Array, cam_from_world: Array, truth: TrueCameras) -> PoseScore:
    """Return how registered photos fit the truth.

    Args:
        names: Of the M registered photos, 3 or more.
        centres: (M, 3) their camera centres in any frame.
        cam_from_world: (M, 3, 3) rotations from that frame.
        truth: all cameras.

    Raises:
        KeyError: a name is not in the truth.
    """
    index = {name: row for row, name in enumerate(truth.names)}
    rows = [index[name] for name in names]
    fit = similarity(centres, truth.centres[rows])
    errors = np.linalg.norm(fit.apply(centres) - truth.centres[rows], axis=1)
    # cam_from_world = cam_from_estimate @ estimate_from_world
    turns = np.einsum("nij,kj,nlk->nil", cam_from_world, fit.rotation, truth.cam_from_world[rows])
    cosines = np.clip(0.5 * (np.trace(turns, axis1=1, axis2=2) - 1.0), -1.0, 1.0)
    return PoseScore(len(names), fit, errors, np.degrees(np.arccos(cosines)))


def similarity(source: Array, target: Array) -> Sim3:
    """Return the Sim3 from (N, 3) points to (N, 3) others with the least squares (Umeyama, 1991)."""
    from_mean, to_mean = source.mean(axis=0), target.mean(axis=0)
    u, sizes, vt = np.linalg.svd((target - to_mean).T @ (source - from_mean))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ np.diag(signs) @ vt
    scale = float(np.sum(signs * sizes) / np.sum((source - from_mean) ** 2))
    return Sim3(scale, rotation, to_mean - scale * rotation @ from_mean)


def loop_gap(way: Array) -> float:
    """Return how near (N, 3) places come back to where they began, as share of the way between.

    Nobody stops where he began to the centimetre: the nearest of the first and the last tenth count.
    """
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    num_ends = max(1, len(way) // 10)
    gaps = np.linalg.norm(way[:num_ends, None] - way[None, -num_ends:], axis=2)
    return float(gaps.min() / steps.sum())
