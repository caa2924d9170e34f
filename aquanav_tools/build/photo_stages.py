"""What a build from photos adds to their reconstruction: is it a cave, and how large."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np

from aquanav_tools.build.cloud_file import write_cloud
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import PhotoScaleOptions
from aquanav_tools.cave.closing.enclosure import MIN_ENCLOSURE, check_enclosure, enclosure, free_height
from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.errors import ReconstructionError
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.types import BoolArray, Mesh, PointCloud, Sim3

HEIGHT_ERROR = 0.33
"""How far a typical height of the passage, guessed, puts the scale off, relative; chosen."""
PREVIEW_CELLS = 100
"""Cells along the longest side of the coarse surface that tells whether the photos show a cave."""


def preview_surface(cloud: PointCloud) -> Mesh:
    """Return a coarse surface of a cloud of any scale."""
    extent = np.percentile(cloud.points, 99, axis=0) - np.percentile(cloud.points, 1, axis=0)
    return surface_from_cloud(cloud, float(extent.max()) / PREVIEW_CELLS).mesh


def check_is_cave(reconstruction: Reconstruction, preview: Mesh) -> float:
    """Return the share of the view that is wall where the cameras were; true to any scale.

    Raises:
        MeshError: the cameras were not inside of what they photographed: it is a facade or an object.
    """
    return check_enclosure(preview, reconstruction.camera_centres, "the cameras")


def cameras_inside(reconstruction: Reconstruction, preview: Mesh) -> BoolArray:
    """Return the (N,) flags of cameras with walls around them; others may have stood outside before the entrance."""
    inside: BoolArray = enclosure(preview, reconstruction.camera_centres) >= MIN_ENCLOSURE
    return inside


def in_metres(
    reconstruction: Reconstruction, preview: Mesh, scale: PhotoScaleOptions, journal: Journal
) -> Reconstruction:
    """Return the reconstruction scaled by the passage's typical height, where nothing better gave the scale.

    Where something did, the height is held against it.

    Raises:
        ReconstructionError: nothing tells the scale.
    """
    if scale.passage_height is None:
        if reconstruction.is_metric:
            return reconstruction
        raise ReconstructionError(
            "The photos show a cave, but nothing tells its size: photos alone have no scale. Give printed markers "
            "(--marker-size), a measured distance (--picks and --distance), survey stations (--picks and --stations), "
            "camera positions (--positions FILE.csv), a depth sensor's track (--depth-track), a camera pair (--rig), "
            "or a typical height with --passage-height. What was found so far is kept: run the same command with it."
        )
    height = free_height(preview, reconstruction.camera_centres)
    factor = scale.passage_height / height
    if reconstruction.is_metric:
        if abs(np.log(factor)) > np.log1p(2.0 * HEIGHT_ERROR):
            journal.warn(
                "passage-height-differs",
                f"The passage is {height:.1f} m high where the cameras were, {scale.passage_height:g} m were given. "
                "One of the sources of scale may be wrong. Check their units.",
            )
        return reconstruction
    journal.warn(
        "rough-scale",
        f"The scale comes from a passage height of {scale.passage_height:g} m alone and may be off by a third. "
        "Give printed markers, a measured distance or camera positions for a metric model.",
    )
    statistics = {**reconstruction.statistics, "scale_error_percent_95": 100.0 * HEIGHT_ERROR}
    scaled = dataclasses.replace(reconstruction, statistics=statistics, is_metric=True)
    return scaled.moved(Sim3(factor, np.eye(3), np.zeros(3)))


def write_found(reconstruction: Reconstruction, folder: Path) -> None:
    """Write cloud.ply, which viewers read, and cameras.json: name, centre and `cam_from_world` rotation of each."""
    write_cloud(reconstruction.cloud, folder / "cloud.ply")
    placed = zip(
        reconstruction.camera_names, reconstruction.camera_centres, reconstruction.camera_rotations, strict=True
    )
    cameras = [{"name": name, "centre": c.tolist(), "cam_from_world": turn.tolist()} for name, c, turn in placed]
    table = {"is_metric": reconstruction.is_metric, "cameras": cameras}
    (folder / "cameras.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
