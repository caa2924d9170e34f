"""What a build from photos adds to their reconstruction: is it a cave, and how large."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.build.cloud_file import write_cloud
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions, PhotoScaleOptions
from aquanav_tools.build.photo_free_space import ways_ahead
from aquanav_tools.cave.closing.ambient_occlusion import (
    MIN_FACING,
    MIN_OCCLUSION,
    NUM_DIRECTIONS,
    ambient_occlusion,
    check_occlusion,
    facing,
    free_height,
    seen_height,
    sphere_directions,
)
from aquanav_tools.cave.closing.solid import refuse
from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.cave.scan.sight import OUTSIDE, UNSURE, Sight
from aquanav_tools.errors import InputError, ReconstructionError, UnseenWallsError
from aquanav_tools.reconstruct.georeference.gps import has_fix
from aquanav_tools.reconstruct.georeference.place import UNUSED
from aquanav_tools.reconstruct.images import list_photos
from aquanav_tools.reconstruct.intake.video import open_video
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.types import Array, BoolArray, Mesh, PointCloud, Sim3

HEIGHT_ERROR = 0.33
"""How far a typical height of the passage, guessed, puts the scale off, relative; chosen."""
SCALE_OPTIONS = (
    "--passage-height METRES for a rough scale by the passage's typical height, right to a third",
    "--marker-size METRES for printed markers in the photos",
    "--picks with --distance for measured distances, or with --stations for surveyed points",
    "--positions FILE.csv for where the photos were taken",
    "--depth-track FILE.csv for a depth sensor's record",
    "--rig for two cameras side by side",
)
SEEN_HEIGHT_ERROR = 0.5
"""The same where floor or ceiling were not seen; chosen."""
FAR_SEEN = 90.0
"""Percentile of the depths in photos within which of a place what they show around it counts for its height."""
PREVIEW_CELLS = 100
"""Cells along the longest side of the coarse surface that tells whether the photos show a cave."""

NARROW = (
    " All photos together look into only {share:.0%} of all directions; wall in the others shows only where the camera "
    "moved on past it."
)
TURN_ROUND = "If it is a cave, take photos that look the other ways too: back, to both sides, up and down."


@dataclass(frozen=True, eq=False)
class FilmedCave:
    """What tells that photos were taken inside of what they show."""

    preview: Mesh
    """A coarse surface."""
    is_inside: BoolArray
    """(N,) which cameras are known to be in the water, for some may have stood outside before the entrance."""
    occlusion: float
    """Median share of the view from the cameras that is wall."""
    facing: float
    """Median share of the lines through the water before a camera that meet walls which face each other."""

    @property
    def is_half_seen(self) -> bool:
        """Whether so much wall is missing that only walls which face each other tell that it is a cave."""
        return self.occlusion < MIN_OCCLUSION

    @property
    def caution(self) -> tuple[str, str]:
        """Code and sentence of the warning that a cave half seen comes with."""
        return "half-seen", (
            f"Much of the wall was not seen: from the cameras the surface that photos show fills only "
            f"{self.occlusion:.0%} of the view all around, and in a passage {MIN_OCCLUSION:.0%} and more. It is taken "
            f"for a cave because half-way to what the cameras look at {self.facing:.0%} of all lines meet walls that "
            f"face each other ({MIN_FACING:.0%} are asked for). The other walls are guesswork, marked as unobserved."
        )


def check_has_scale(options: BuildOptions) -> None:
    """Refuse photos of which nothing can ever tell the size, before they are worked on for an hour.

    Raises:
        InputError: no source of scale is given; or there are no photos, or no video, which is to be told first.
    """
    if options.scale.scaling:
        return
    ways = list(SCALE_OPTIONS)
    if options.input.is_dir():
        photos = list_photos(options.input)
        with_gps = sum(map(has_fix, photos))
        if with_gps:
            ways.append(f"--gps for the satellite positions in {with_gps} of {len(photos)} files (above ground only)")
    else:
        open_video(options.input)
    raise InputError(
        f"Nothing tells how large the place in {options.input} is: photos alone have no scale, and no source of it is "
        f"given. Nothing was done yet. Give one of these: {'; '.join(ways)}."
    )


def preview_surface(cloud: PointCloud, *, accept_thick: bool = False) -> Mesh:
    """Return a coarse surface of a cloud of any scale; arguments and errors as of `surface_from_cloud`."""
    extent = np.percentile(cloud.points, 99, axis=0) - np.percentile(cloud.points, 1, axis=0)
    return surface_from_cloud(cloud, float(extent.max()) / PREVIEW_CELLS, accept_thick=accept_thick).mesh


def check_is_cave(reconstruction: Reconstruction, preview: Mesh) -> float:
    """Return the share of the view that is wall where the cameras were; true to any scale.

    Raises:
        UnseenWallsError: the cameras were not inside of what they photographed: it is a facade or an object.
    """
    centres, names = reconstruction.camera_centres, reconstruction.camera_names
    return check_occlusion(preview, centres, "the cameras", names, before=_before(reconstruction))


def _before(reconstruction: Reconstruction) -> Array:
    """Return (M, 3) places half-way to what each camera looks at; without depth maps, where the cameras were."""
    sight = reconstruction.sight
    ways = np.zeros((0, 2, 3)) if sight is None else ways_ahead(sight)
    return ways[:, 1] if len(ways) else reconstruction.camera_centres


def look_for_cave(reconstruction: Reconstruction, accept: Callable[[UnseenWallsError], None]) -> FilmedCave:
    """Return what tells that the cameras of a reconstruction, in metres or not yet, were inside of a cave.

    Args:
        reconstruction: cloud and cameras.
        accept: raises the error it is given, or notes that the build goes on all the same.

    Raises:
        UnseenWallsError: it is no cave.
    """

    def accept_here(error: UnseenWallsError) -> None:
        unit = "" if reconstruction.is_metric else " (The scale comes later: lengths here are in the model's own unit.)"
        share = 1.0 if reconstruction.sight is None else filmed_directions(reconstruction.sight)
        cause, advice = "", error.advice
        if error.code == "open-walls" and share < MIN_OCCLUSION:
            cause, advice = NARROW.format(share=share), TURN_ROUND
        accept(UnseenWallsError(error.code, f"{error.facts}{cause}{unit}", advice, error.places))

    try:
        preview = preview_surface(reconstruction.cloud)
    except UnseenWallsError as error:
        accept_here(error)
        preview = preview_surface(reconstruction.cloud, accept_thick=True)
    try:
        check_is_cave(reconstruction, preview)
    except UnseenWallsError as error:
        accept_here(error)
    centres = reconstruction.camera_centres
    shares = ambient_occlusion(preview, centres)
    share, between = float(np.median(shares)), float(np.median(facing(preview, _before(reconstruction))))
    # Where walls are missing they do not tell who stood outside, and wherever a camera was there is room.
    is_inside = shares >= MIN_OCCLUSION if share >= MIN_OCCLUSION else np.ones(len(centres), dtype=bool)
    return FilmedCave(preview, is_inside, share, between)


def filmed_directions(sight: Sight) -> float:
    """Return the share of all directions, seen from wherever, that the frame of some photo holds."""
    directions = sphere_directions(NUM_DIRECTIONS)
    is_filmed = np.zeros(len(directions), dtype=bool)
    for pose, (fx, fy, cx, cy), depth in zip(sight.poses, sight.pinholes, sight.depth, strict=True):
        right, down, ahead = pose[:, :3] @ directions.T
        rows, columns = np.nonzero(depth != OUTSIDE)
        ahead = np.where(ahead > 0.0, ahead, np.nan)
        u, v = fx * right / ahead + cx, fy * down / ahead + cy
        is_filmed |= (u >= 0.0) & (u < columns.max(initial=-1) + 1) & (v >= 0.0) & (v < rows.max(initial=-1) + 1)
    return float(is_filmed.mean())


def in_metres(
    reconstruction: Reconstruction,
    preview: Mesh,
    scale: PhotoScaleOptions,
    journal: Journal,
    accept: Callable[[UnseenWallsError], None] = refuse,
) -> Reconstruction:
    """Return the reconstruction scaled by the passage's typical height, where nothing better gave the scale.

    Where something did, the height is held against it.

    Args:
        reconstruction: with a scale or without.
        preview: a coarse surface of it.
        scale: what was given.
        journal: is warned of a rough scale.
        accept: see `look_for_cave`.

    Raises:
        ReconstructionError: nothing that was given tells the scale.
        UnseenWallsError: floor and ceiling were not seen from any one place.
    """
    if scale.passage_height is None:
        if reconstruction.is_metric:
            return reconstruction
        reasons = " ".join(caution.message for caution in reconstruction.warnings if caution.code == UNUSED)
        raise ReconstructionError(
            f"The photos show a cave, but what was given does not tell its size. {reasons} What was found so far is "
            f"kept: run the same command with one of these mended or added: {'; '.join(SCALE_OPTIONS)}."
        )
    height, error, cause = _height(reconstruction, preview, accept)
    factor = scale.passage_height / height
    if reconstruction.is_metric:
        if abs(np.log(factor)) > np.log1p(2.0 * error):
            journal.warn(
                "passage-height-differs",
                f"The passage is {height:.1f} m high where the cameras were, {scale.passage_height:g} m were given. "
                "One of the sources of scale may be wrong. Check their units.",
            )
        return reconstruction
    journal.warn(
        "rough-scale",
        f"The scale comes from a passage height of {scale.passage_height:g} m alone{cause} and may be off by "
        f"{error:.0%}. Give printed markers, a measured distance or camera positions for a metric model.",
    )
    statistics = {**reconstruction.statistics, "scale_error_percent_95": 100.0 * error}
    scaled = dataclasses.replace(reconstruction, statistics=statistics, is_metric=True)
    return scaled.moved(Sim3(factor, np.eye(3), np.zeros(3)))


def _height(
    reconstruction: Reconstruction, preview: Mesh, accept: Callable[[UnseenWallsError], None]
) -> tuple[float, float, str]:
    """Return the passage's height where the cameras were, how far that may be off, relative, and why."""
    try:
        return free_height(preview, reconstruction.camera_centres), HEIGHT_ERROR, ""
    except UnseenWallsError as error:
        accept(error)
    sight = reconstruction.sight
    reach = np.inf if sight is None else float(np.percentile(sight.depth[sight.depth > UNSURE], FAR_SEEN))
    height, what = seen_height(preview, reconstruction.cloud.points, reconstruction.camera_centres, reach)
    return height, SEEN_HEIGHT_ERROR, f", taken for {what}, as floor or ceiling were not seen,"


def write_found(reconstruction: Reconstruction, folder: Path) -> None:
    """Write cloud.ply, which viewers read, and cameras.json: name, centre and `cam_from_world` rotation of each."""
    write_cloud(reconstruction.cloud, folder / "cloud.ply")
    placed = zip(
        reconstruction.camera_names, reconstruction.camera_centres, reconstruction.camera_rotations, strict=True
    )
    cameras = [{"name": name, "centre": c.tolist(), "cam_from_world": turn.tolist()} for name, c, turn in placed]
    table = {"is_metric": reconstruction.is_metric, "cameras": cameras}
    (folder / "cameras.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
