"""What a build from photos is worth: its cameras, cloud and cavity held against the truth of a rendered dive."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools.cave.cavity import WALL
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.types import Array, BoolArray, Mesh, Sim3
from eval.photos.depth_truth import (
    FREE_SPACING,
    DepthReference,
    is_free,
    is_judged,
    lattice,
    refined,
    score_against,
)
from eval.photos.score import (
    CloudScore,
    distances_to,
    loop_gap,
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


def judge_real(build: Path, centres: dict[str, Array], reference: DepthReference | None, *, is_loop: bool) -> Any:
    """Return figures of a build from real photos, as far as it came and as far as there is truth.

    Args:
        build: the output folder of aquanav-build-cave.
        centres: (3,) where photos were taken, by name; none where that is not known.
        reference: what a depth camera saw; None without one.
        is_loop: the last photo shows the place of the first.
    """
    cameras = read_cameras(build)
    found = judge_cameras(cameras, centres)
    if is_loop and len(cameras) > 2:
        way = np.array([camera["centre"] for camera in sorted(cameras, key=lambda camera: str(camera["name"]))])
        found["loop_gap"] = loop_gap(way)
    truth_from_build = Sim3()
    if reference is not None and len(cameras) > 2 and (build / "cloud.ply").exists():
        cloud = _points(build / "cloud.ply")
        known = [camera for camera in cameras if camera["name"] in reference.centres]
        centres_found = np.array([camera["centre"] for camera in known])
        centres_true = np.array([reference.centres[camera["name"]] for camera in known])
        truth_from_build = refined(cloud, reference.points, similarity(centres_found, centres_true))
        found["scale"] = truth_from_build.scale
        found["cloud"] = _figures(score_against(reference, truth_from_build.apply(cloud)))
    if (build / "scenario.toml").exists():
        found |= _judge_room(build, truth_from_build, reference)
    return found


def _judge_room(build: Path, truth_from_build: Sim3, reference: DepthReference | None) -> dict[str, Any]:
    """Return size and soundness of a cavity, and how much of the free space that a depth camera saw it holds."""
    import igl

    cavity = read_scenario(build).cavity
    mesh = Mesh(truth_from_build.apply(cavity.mesh.vertices), cavity.mesh.faces)
    solid, is_wall = mesh.to_trimesh(), cavity.labels == WALL
    found = {
        "volume": float(mesh.volume),
        "extent_m": np.sort(np.ptp(mesh.vertices, axis=0)).tolist(),
        "invented_share": float(mesh.areas[is_wall & ~cavity.observed].sum() / mesh.areas[is_wall].sum()),
        "is_volume": bool(solid.is_volume and solid.body_count == 1),
        "genus": int(1 - solid.euler_number // 2),
        "portals": len(cavity.portals),
    }
    if reference is not None:
        found |= _judge_walls(mesh, is_wall & cavity.observed, reference)
        ends = np.concatenate([mesh.vertices, reference.points])
        places = lattice(ends.min(axis=0), ends.max(axis=0))
        free = is_free(reference, places)
        held = igl.fast_winding_number(mesh.vertices, mesh.faces, places) > 0.5
        found["free_volume"] = float(free.sum() * FREE_SPACING**3)
        found["free_held"], found["held_free"] = float(held[free].mean()), float(free[held].mean())
    return found


def _judge_walls(mesh: Mesh, is_seen: BoolArray, reference: DepthReference) -> dict[str, float]:
    """Return how far wall that photos saw lies from what a depth camera shows, where that can judge it, m."""
    import trimesh

    seen = mesh.to_trimesh().submesh([is_seen], append=True)
    samples = np.asarray(trimesh.sample.sample_surface(seen, SURFACE_SAMPLES, seed=0)[0])
    off, _ = cKDTree(reference.points).query(samples[is_judged(reference, samples)])
    return {"wall_median": float(np.median(off)), "wall_95": float(np.percentile(off, 95.0))}


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
        "extent_m": np.sort(np.ptp(cavity.mesh.vertices, axis=0)).tolist(),
        "volume_error": cavity.volume / trimmed.volume - 1.0,
        "whole_volume_error": cavity.volume / truth.volume - 1.0,
        "is_volume": bool(solid.is_volume and solid.body_count == 1),
        "genus": int(1 - solid.euler_number // 2),
        "true_genus": int(1 - water.euler_number // 2),
        "portals": len(cavity.portals),
        "cameras_outside": int((depth_below(cavity.mesh, centres) <= 0.0).sum()),
    }


def _score(points: Array, wall: Mesh, seen: Array) -> dict[str, float]:
    return _figures(score_cloud(points, wall, seen))


def _figures(scores: list[CloudScore]) -> dict[str, float]:
    found: dict[str, float] = {}
    for score in scores:
        cm = f"{100 * score.tolerance:.0f}"
        found |= {f"precision_{cm}": score.precision, f"recall_{cm}": score.recall, f"f_{cm}": score.f_score}
    return found


def _spread(errors: Array) -> dict[str, float]:
    return {"centre_mean": float(errors.mean()), "centre_max": float(errors.max())}


def _points(path: Path) -> Array:
    import trimesh

    return np.asarray(trimesh.load(path).vertices, float)
