"""A small photographed cave, and scores of a cloud against the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from aquanav_tools.cave.synthetic.caves import CaveOptions, SyntheticCave, demo_cave
from aquanav_tools.libraries import load_open3d
from aquanav_tools.reconstruct.capture import CaptureOptions
from aquanav_tools.reconstruct.render import RayScene, RenderOptions
from aquanav_tools.types import Array, Mesh

SMALL_CAVE = CaveOptions(length=5.0, radius=1.2, winding=0.3, voxel=0.06)
SMALL_RENDER = RenderOptions(
    width=480,
    height=360,
    capture=CaptureOptions(
        stations=3,
        start_margin=0.5,
        end_margin=3.5,
        shots=((16, 10), (-16, 10), (-16, -10), (16, -10)),
        unsteady_m=0.12,
    ),
)


def small_cave() -> SyntheticCave:
    """A passage of 5 m for a dozen photos."""
    return demo_cave(SMALL_CAVE)


def true_centres(folder: Path, names: tuple[str, ...]) -> Array:
    """Return the (N, 3) true camera centres of some rendered photos."""
    truth = {camera["name"]: camera["centre"] for camera in json.loads((folder / "truth.json").read_text())["cameras"]}
    return np.array([truth[name] for name in names])


def distances_to(mesh: Mesh, points: Array) -> Array:
    """Return the (N,) exact distances from points to a mesh."""
    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    vertices = o3d.core.Tensor(mesh.vertices.astype(np.float32))
    scene.add_triangles(vertices, o3d.core.Tensor(mesh.faces.astype(np.uint32)))
    return scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy().astype(np.float64)


def seen_surface(cave: SyntheticCave, folder: Path, min_photos: int = 2, num_samples: int = 20_000) -> Array:
    """Return (M, 3) samples, even by area, of the wall that at least `min_photos` photos show."""
    import trimesh

    truth = json.loads((folder / "truth.json").read_text())
    points, _ = trimesh.sample.sample_surface(cave.mesh.to_trimesh(), num_samples, seed=0)
    points = np.asarray(points)
    scene = RayScene(cave.mesh)
    count = np.zeros(len(points), int)
    for camera in truth["cameras"]:
        centre, turn = np.array(camera["centre"]), np.array(camera["cam_from_world"])
        in_camera = (points - centre) @ turn.T
        ahead = in_camera[:, 2] > 0.1
        depth = np.where(ahead, in_camera[:, 2], 1.0)
        offset = np.abs(in_camera[:, :2] / depth[:, None]) * truth["focal_px"]
        visible = ahead & (offset[:, 0] < truth["width"] / 2) & (offset[:, 1] < truth["height"] / 2)
        reach, _ = scene.cast(centre, points - centre)
        count += visible & (np.abs(reach - 1.0) * np.linalg.norm(points - centre, axis=1) < 0.02)
    return points[count >= min_photos]


def scores(cave: SyntheticCave, folder: Path, points: Array, tolerance: float = 0.05) -> dict[str, float]:
    """Return median distance to the wall (m), precision, recall over the seen wall and F-score at a tolerance."""
    from scipy.spatial import cKDTree

    distances = distances_to(cave.mesh, points)
    to_cloud, _ = cKDTree(points).query(seen_surface(cave, folder))
    precision, recall = float(np.mean(distances < tolerance)), float(np.mean(to_cloud < tolerance))
    f_score = 2.0 * precision * recall / (precision + recall)
    return {"median": float(np.median(distances)), "precision": precision, "recall": recall, "f": f_score}
