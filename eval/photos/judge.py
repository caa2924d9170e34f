"""What a build from photos is worth: its cameras, cloud and cavity held against the truth of a rendered dive."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import WALL
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.types import Array, Mesh
from eval.photos.score import (
    distances_to,
    read_true_cameras,
    read_wall,
    score_cloud,
    score_poses,
    seen_wall,
    similarity,
)

SURFACE_SAMPLES = 100_000
SAME_WALL = 0.01
"""Samples of the wall belong to the water between the portals when they lie this close to its surface, m."""


def judge_cameras(cameras: list[dict[str, Any]], truth: dict[str, Array]) -> dict[str, Any]:
    """Return how well registered cameras fit (3,) reference centres in any frame, in the reference's unit."""
    known = [camera for camera in cameras if camera["name"] in truth]
    if len(known) < 3:
        return {"registered": len(cameras)}
    centres = np.array([camera["centre"] for camera in known])
    expected = np.array([truth[camera["name"]] for camera in known])
    errors = np.linalg.norm(similarity(centres, expected).apply(centres) - expected, axis=1)
    extent = float(np.linalg.norm(np.ptp(expected, axis=0)))
    return {"registered": len(cameras), **_spread(errors), "extent": extent}


def judge_rendered(build: Path, dive: Path) -> dict[str, Any]:
    """Return figures of a build, as far as it came: cameras, then cloud, then cavity.

    Args:
        build: the output folder of aquanav-build-cave.
        dive: the folder of the rendered photos and their truth.
    """
    truth = read_true_cameras(dive)
    cameras = read_cameras(build)
    if len(cameras) < 3:
        return {"registered": len(cameras)}
    names = tuple(camera["name"] for camera in cameras)
    centres = np.array([camera["centre"] for camera in cameras])
    poses = score_poses(names, centres, np.array([camera["cam_from_world"] for camera in cameras]), truth)
    found: dict[str, Any] = {"registered": len(cameras), **_spread(poses.centre_errors)}
    found["rotation_deg"] = float(poses.rotation_errors_deg.mean())
    wall = read_wall(dive)
    seen = seen_wall(wall, truth)
    if (build / "cloud.ply").exists():
        # In the frame that fits the cameras best: the error of scale and up is that of the positions handed in.
        found["cloud"] = _score(poses.world_from_estimate.apply(_points(build / "cloud.ply")), wall, seen)
    if (build / "scenario.toml").exists():
        found |= _judge_cavity(build, dive, wall, seen, centres)
    return found


def read_cameras(build: Path) -> list[dict[str, Any]]:
    """Return the registered cameras of a build; none when it did not come so far."""
    path = build / "cameras.json"
    return json.loads(path.read_text(encoding="utf-8"))["cameras"] if path.exists() else []


def _judge_cavity(build: Path, dive: Path, wall: Mesh, seen: Array, centres: Array) -> dict[str, Any]:
    """Return how the closed water compares: surface that was seen, volume between the portals, openings, handles."""
    import trimesh

    from eval.corpus.judge import between_portals, depth_below

    cavity = read_scenario(build).cavity
    solid = cavity.mesh.to_trimesh()
    observed = np.asarray(cavity.observed) & (cavity.labels == WALL)
    samples = trimesh.sample.sample_surface(solid.submesh([observed], append=True), SURFACE_SAMPLES, seed=0)[0]
    invented = ~observed & (cavity.labels == WALL)
    water = trimesh.load_mesh(dive / "truth_water.ply", process=False)
    truth = Mesh(np.asarray(water.vertices, float), np.asarray(water.faces, np.int64))
    trimmed = between_portals(truth, cavity)
    within = seen[distances_to(trimmed, seen) < SAME_WALL]
    return {
        "surface": _score(np.asarray(samples), wall, seen),
        "surface_between": _score(np.asarray(samples), wall, within),
        "invented_share": float(solid.area_faces[invented].sum() / solid.area_faces[cavity.labels == WALL].sum()),
        "volume": cavity.volume,
        "volume_error": cavity.volume / trimmed.volume - 1.0,
        "whole_volume_error": cavity.volume / truth.volume - 1.0,
        "is_volume": bool(solid.is_volume and solid.body_count == 1),
        "genus": int(1 - solid.euler_number // 2),
        "true_genus": int(1 - water.euler_number // 2),
        "portals": len(cavity.portals),
        "cameras_outside": int((depth_below(cavity.mesh, centres) <= 0.0).sum()),
    }


def _score(points: Array, wall: Mesh, seen: Array) -> dict[str, float]:
    found = {}
    for score in score_cloud(points, wall, seen):
        cm = f"{100 * score.tolerance:.0f}"
        found |= {f"precision_{cm}": score.precision, f"recall_{cm}": score.recall, f"f_{cm}": score.f_score}
    return found


def _spread(errors: Array) -> dict[str, float]:
    return {"centre_mean": float(errors.mean()), "centre_max": float(errors.max())}


def _points(path: Path) -> Array:
    import trimesh

    return np.asarray(trimesh.load(path).vertices, float)
