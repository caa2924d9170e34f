"""A reconstruction as it grew: photo by photo cameras and sparse points, then the dense cloud, then the cavity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.report.recording.cave import CaveModel, eye, log_surface
from aquanav_tools.report.recording.stream import recording
from aquanav_tools.types import Array, IntArray, PointCloud

Colours = npt.NDArray[np.uint8]

MAX_THUMBNAILS = 150
"""Of more photos every second, third, ... has a picture: 10 kB each."""
THUMBNAIL_PX = 160
"""Larger side."""
JPEG_QUALITY = 80
MAX_SPARSE = 60_000
"""Points of the sparse model beyond this are thinned out: 16 bytes each."""
MAX_CLOUD = 150_000
"""So are those of the dense cloud. The file stays below 8 MB, plus 4 kB per photo, with the noisiest of photos."""
FRUSTUM = 0.25
"""Length of a camera's pyramid, m."""
TIMELINE = "photos placed"
LAST_STAGES = 0.1
"""Cloud and cavity appear this share of the photos after the last one, and again."""


@dataclass(frozen=True, eq=False)
class PlacedPhoto:
    """One step of the growth; world frame."""

    name: str
    centre: Array
    """(3,) m."""
    cam_from_world: Array
    """(3, 3) rotation; camera x right, y down, z ahead."""
    matrix: Array
    """(3, 3) of a pinhole camera."""
    size: tuple[int, int]
    """Width and height that the matrix is for, px."""
    picture: Path
    """An undistorted copy of the photo."""


@dataclass(frozen=True, eq=False)
class Growth:
    """What a reconstruction consists of; world frame, m."""

    photos: tuple[PlacedPhoto, ...]
    """In the order they were placed in."""
    points: Array
    """(P, 3) sparse points."""
    colours: Colours
    """(P, 3)."""
    observations: IntArray
    """(O, 2) rows of point and photo: who sees what."""
    cloud: PointCloud

    @property
    def steps(self) -> IntArray:
        """(P,) the photo with which each point can be placed: the second that sees it."""
        point, photo = self.observations[np.lexsort(self.observations.T[::-1])].T
        first = np.flatnonzero(np.append(True, point[1:] != point[:-1]))
        steps = np.full(len(self.points), len(self.photos) - 1)
        seen_twice = first[np.append(np.diff(first), len(point) - first[-1]) > 1]
        steps[point[seen_twice]] = photo[seen_twice + 1]
        return steps


def record_growth(growth: Growth, cave: CaveModel, path: Path) -> None:
    """Write the recording.

    Args:
        growth: the reconstruction.
        cave: the cavity that was made of it.
        path: the .rrd file; replaced when it exists.
    """
    import rerun as rr

    scenario = cave.scenario
    with recording(path, f"growth {scenario.name} {scenario.content_hash}", _blueprint(cave)) as stream:
        stream.send_recording_name(f"{scenario.name}: from {len(growth.photos)} photos")
        stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _log_photos(stream, growth.photos)
        _log_points(stream, growth)
        after = max(1, round(LAST_STAGES * len(growth.photos)))
        stream.set_time(TIMELINE, sequence=len(growth.photos) + after)
        _log_cloud(stream, growth.cloud)
        stream.set_time(TIMELINE, sequence=len(growth.photos) + 2 * after)
        log_surface(stream, cave, static=False)
        stream.log("log", rr.TextLog("the cavity: closed around the water"))


def _log_photos(stream: Any, photos: Sequence[PlacedPhoto]) -> None:
    """Log each photo as a camera with its picture, and the newest one once more by itself."""
    import rerun as rr

    every = -(-len(photos) // MAX_THUMBNAILS)
    for row, photo in enumerate(photos):
        stream.set_time(TIMELINE, sequence=row + 1)
        entity = f"cameras/{row:04d}"
        pose = rr.Transform3D(translation=photo.centre, mat3x3=photo.cam_from_world.T)
        jpeg, shrink = thumbnail(photo) if row % every == 0 else (None, THUMBNAIL_PX / max(photo.size))
        scaled = np.diag([shrink, shrink, 1.0]) @ photo.matrix
        size = [round(shrink * side) for side in photo.size]
        stream.log(entity, pose, rr.Pinhole(image_from_camera=scaled, resolution=size, image_plane_distance=FRUSTUM))
        if jpeg is not None:
            stream.log(entity, rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))
            stream.log("newest", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))


def thumbnail(photo: PlacedPhoto) -> tuple[bytes, float]:
    """Return a small JPEG of a photo, and its size relative to the photo's."""
    import cv2

    picture: Any = cv2.imread(str(photo.picture), cv2.IMREAD_COLOR)
    shrink = min(1.0, THUMBNAIL_PX / max(picture.shape[:2]))
    size = [round(shrink * side) for side in photo.size]
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes(), shrink


def _log_points(stream: Any, growth: Growth) -> None:
    """Log the points of each photo in an entity of their own, so that they stay, and how many there are by then."""
    import rerun as rr

    steps, chosen = growth.steps, _some(len(growth.points), MAX_SPARSE)
    totals = np.cumsum(np.bincount(steps, minlength=len(growth.photos)))
    for row, photo in enumerate(growth.photos):
        stream.set_time(TIMELINE, sequence=row + 1)
        rows = chosen[steps[chosen] == row]
        if len(rows):
            points = rr.Points3D(growth.points[rows].astype(np.float32), colors=growth.colours[rows], radii=0.012)
            stream.log(f"sparse/{row:04d}", points)
        stream.log("log", rr.TextLog(f"{photo.name}: {totals[row]} points so far"))
        stream.log("plots/points", rr.Scalars(float(totals[row])))


def _log_cloud(stream: Any, cloud: PointCloud) -> None:
    import rerun as rr

    rows = _some(len(cloud.points), MAX_CLOUD)
    colours = None if cloud.colours is None else cloud.colours[rows]
    stream.log("dense", rr.Points3D(cloud.points[rows].astype(np.float32), colors=colours, radii=0.012))
    stream.log("log", rr.TextLog(f"the dense cloud: {len(cloud.points)} points, {len(rows)} of them shown"))


def _some(count: int, most: int) -> IntArray:
    """Return rows spread evenly over `count`, at most `most`."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def _blueprint(cave: CaveModel) -> Any:
    """Return the layout: the cave large, beside it the newest photo, the number of points and the log."""
    import rerun.blueprint as rrb

    scene = rrb.Spatial3DView(
        contents=["+ /**", "- /plots/**", "- /newest", "- /log"], name=cave.scenario.name, eye_controls=eye(cave),
        line_grid=False,
    )  # fmt: skip
    side = rrb.Vertical(
        rrb.Spatial2DView(origin="newest", name="newest photo"),
        rrb.TimeSeriesView(origin="plots/points", name="sparse points"),
        rrb.TextLogView(origin="log", name="log"),
        row_shares=[3, 2, 2],
    )
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(scene, side, column_shares=[3, 1]), panel, collapse_panels=True)
