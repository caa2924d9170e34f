"""Hold a finished build against the truth: volume between the portals, passages, handles, open ends."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import Cavity, Portal, from_manifold, to_manifold
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.geometry.polyline import resample
from aquanav_tools.libraries import load_open3d
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.synthetic.damage import Truth
from aquanav_tools.types import Array, Mesh

SLAB = 0.002
"""Thickness of the wall that is put into the truth where the build has a portal, m."""
PATH_STEP = 0.05
"""The path is tested at this spacing, m."""


def judge(folder: Path, truth: Truth, offset: Array) -> dict[str, Any]:
    """Return what a scenario folder tells about its cave, and how that compares with the truth.

    Args:
        folder: a finished build.
        truth: of the scan it was built from.
        offset: (3,) by which that scan had been moved away from the truth, m.
    """
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    cavity = read_scenario(folder).cavity
    solid = cavity.mesh.to_trimesh()
    found = {
        "volume": cavity.volume,
        "is_volume": bool(solid.is_volume and solid.body_count == 1),
        "crossings": len(self_intersections(cavity.mesh)),
        "genus": int(1 - solid.euler_number // 2),
        "portals": len(cavity.portals),
        "fit_median": report["fit"]["median"],
        "fit_95": report["fit"]["percentile_95"],
        "voxel": report["voxel"],
        "method": report["closed_by"],
        "warnings": [warning["code"] for warning in report["warnings"]],
    }
    if truth.solid is None:
        return found
    return found | compare(cavity, truth, offset - np.array(report["offset"]), found["voxel"])


def compare(cavity: Cavity, truth: Truth, shift: Array, margin: float) -> dict[str, Any]:
    """Return how a cavity differs from the truth moved by `shift`.

    Args:
        cavity: the build.
        truth: what was there.
        shift: (3,) where the truth lies in the cavity's frame, m.
        margin: the path counts where it is at least this deep in the truth, m.
    """
    assert truth.solid is not None
    solid = Mesh(truth.solid.vertices + shift, truth.solid.faces)
    trimmed = between_portals(solid, cavity)
    outside, blocked, covered = 0, 0, []
    for path in truth.paths:
        points = resample(path + shift, PATH_STEP)
        expected = depth_below(trimmed, points) > margin
        is_inside = depth_below(cavity.mesh, points) > 0.0
        outside += int((expected & ~is_inside).sum())
        both = expected[:-1] & expected[1:]
        blocked += num_blocked(cavity.mesh, points[:-1][both], points[1:][both])
        covered.append(float(is_inside.mean()))
    return {
        "truth_volume": trimmed.volume,
        "volume_error": cavity.volume / trimmed.volume - 1.0,
        "path_points_in_rock": outside,
        "path_segments_blocked": blocked,
        "covered": min(covered, default=None),
    }


def between_portals(solid: Mesh, cavity: Cavity) -> Mesh:
    """Return the part of a closed mesh that lies between the portals of a cavity.

    A thin wall is put up at each portal, and the piece that shares most water with the cavity is kept. Half-spaces
    would cut a winding passage where it comes back across a portal's plane.
    """
    whole = to_manifold(solid)
    for portal in cavity.portals:
        whole = whole - _wall(portal)
    built = to_manifold(cavity.mesh)
    return from_manifold(max(whole.decompose(), key=lambda piece: (piece ^ built).volume()))


def depth_below(mesh: Mesh, points: Array) -> Array:
    """Return the (N,) depths in the water of a closed mesh, negative in rock, by open3d's ray casting."""
    open3d = load_open3d()
    depth: Array = -scene_of(mesh).compute_signed_distance(open3d.core.Tensor(points.astype(np.float32))).numpy()
    return depth


def num_blocked(mesh: Mesh, starts: Array, ends: Array) -> int:
    """Return how many of the (N, 3) straight segments meet a wall."""
    if not len(starts):
        return 0
    open3d = load_open3d()
    rays = np.concatenate([starts, ends - starts], axis=1).astype(np.float32)
    hit = scene_of(mesh).cast_rays(open3d.core.Tensor(rays))["t_hit"].numpy()
    return int((hit <= 1.0).sum())


def scene_of(mesh: Mesh) -> Any:
    """Return open3d's ray casting scene of a mesh."""
    scene = load_open3d().t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    return scene


def _wall(portal: Portal) -> Any:
    """Return a thin box over a portal, two of its diameters wide."""
    import manifold3d

    horizontal, upright = plane_axes(portal.normal)
    half = 2.0 * float(np.sqrt(4.0 * portal.area / np.pi))
    box = manifold3d.Manifold.cube((half, half, SLAB)).translate((-0.5 * half, -0.5 * half, -0.5 * SLAB))
    return box.transform(np.column_stack([horizontal, upright, portal.normal, portal.centre]))
