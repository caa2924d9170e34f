"""From exact depth maps of the demo cave to its cavity: what fusion, sight and closing leave of the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.closing.free_space import FreeSpace, contradictions
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_scan
from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.photograph.lens import Lens
from aquanav_tools.photograph.options import CaptureOptions
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.photograph.trajectory import Shot, plan_capture
from aquanav_tools.reconstruct.depth_maps import DepthMaps
from aquanav_tools.reconstruct.fusion import FusedDepth, FusionOptions, fuse_maps
from aquanav_tools.reconstruct.views import View
from aquanav_tools.synthetic.caves import SyntheticCave, demo_cave
from aquanav_tools.types import Mesh
from eval.photos.score import TrueCameras, score_cloud, seen_wall

LENS = Lens(240, 180, 110.0)
VOXEL = 0.05
MIN_PORTAL = 0.7


def fuse_exact(cave: SyntheticCave, shots: list[Shot], folder: Path) -> FusedDepth:
    """Fuse the true depth maps of photos that show nothing but grey."""
    import cv2

    (folder / "images").mkdir()
    (folder / "depth").mkdir()
    scene, rays, views = SmoothScene(cave.mesh), LENS.rays(), []
    matrix = np.array([[LENS.focal_px, 0.0, LENS.width / 2], [0.0, LENS.focal_px, LENS.height / 2], [0.0, 0.0, 1.0]])
    for index, shot in enumerate(shots):
        turn, none = shot.cam_from_world, np.zeros((0, 3))
        distance, normals = scene.cast(shot.centre, rays @ turn)
        depth = np.nan_to_num(distance * rays[:, 2]).reshape(LENS.height, LENS.width)
        inward = (-normals / np.linalg.norm(normals, axis=1, keepdims=True)) @ turn.T
        name = f"p{index:03d}.png"
        kept = {"depth": depth.astype(np.float32), "normals": inward.reshape(*depth.shape, 3).astype(np.float16)}
        np.savez(folder / "depth" / f"{name}.npz", **kept, cost=np.zeros(depth.shape, np.float16))
        cv2.imwrite(str(folder / "images" / name), np.full((*depth.shape, 3), 128, np.uint8))
        shift = -turn @ shot.centre
        views.append(View(index, name, matrix, turn, shift, LENS.width, LENS.height, np.zeros(0, int), none))
    return fuse_maps(DepthMaps(folder, views, 0.5), FusionOptions(step=1))


@pytest.mark.slow
def test_exact_depth_gives_the_cave_back(tmp_path: Path) -> None:
    cave = demo_cave()
    shots = plan_capture(cave.centreline, CaptureOptions())
    fused = fuse_exact(cave, shots, tmp_path)
    surface = surface_from_cloud(fused.cloud, VOXEL)
    free_space = FreeSpace(fused.sight.centres, sight=fused.sight)
    cavity = close_scan(surface, ReconstructionOptions(VOXEL, MIN_PORTAL, keep_triangles=False), free_space).cavity
    assert sorted(round(float(portal.normal[0])) for portal in cavity.portals) == [-1, 1]  # the ends at x = 0 and 9
    assert cavity.mesh.to_trimesh().euler_number == cave.truth.to_trimesh().euler_number
    assert cavity.volume == pytest.approx(abs(cave.truth.volume), rel=0.03)
    assert contradictions(cavity.mesh, free_space, 1e-6).count == 0
    cameras = TrueCameras(
        tuple(str(index) for index in range(len(shots))),
        LENS,
        np.array([shot.centre for shot in shots]),
        np.array([shot.cam_from_world for shot in shots]),
    )
    observed = Mesh(cavity.mesh.vertices, cavity.mesh.faces[cavity.observed])
    samples = np.asarray(trimesh.sample.sample_surface(observed.to_trimesh(), 50_000, seed=0)[0])
    (score,) = score_cloud(samples, cave.mesh, seen_wall(cave.mesh, cameras), (0.05,))
    print(score, score.f_score, cavity.volume)
    assert score.f_score > 0.97
