"""The track of a depth sensor, matched to photos by their times."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.camera_positions import CameraPositions
from aquanav_tools.reconstruct.georeference.rows import Row, read_rows
from aquanav_tools.reconstruct.images import Photo, PhotoSet
from aquanav_tools.types import Array

NAME_TIME = re.compile(r"(20\d\d)[-_]?(\d\d)[-_]?(\d\d)[-_T ]?(\d\d)[-_.]?(\d\d)[-_.]?(\d\d)(?:[.](\d+)(?=[.]))?")
FRAME_TIME = re.compile(r"-(\d+)m(\d\d\.\d+)s\.")
"""How frames of a video are named: minutes and seconds since its beginning."""
MAX_GAP = 30.0
"""Between two samples farther apart than this nothing is interpolated, s."""


def read_depth_track(path: Path, photos: PhotoSet, clock_ahead: float) -> CameraPositions:
    """Return the heights (-depth, m) of photos taken while a depth sensor ran.

    Args:
        path: CSV file with columns time (ISO 8601, the camera's time zone; for frames of a video seconds since it
            began) and depth (m below the surface).
        photos: The photos.
        clock_ahead: How far the camera's clock was ahead of the sensor's, s.

    Raises:
        InputError: the file cannot be read, photos have no times, or no photo was taken while the sensor ran.
    """
    track = _read_track(path)
    times = {one.name: when - clock_ahead for one in photos.photos if (when := photo_time(one)) is not None}
    if not times:
        raise InputError(
            f"None of the {len(photos.photos)} photos says when it was taken, in its EXIF record or as 20261121_100203 "
            f"in its name, so {path} cannot be matched to them. Use the camera's own files."
        )
    heights = {name: -depth for name, when in times.items() if (depth := _depth_at(track, when)) is not None}
    if not heights:
        raise InputError(
            f"No photo was taken while the depth sensor ran: photos from {_clock(min(times.values()))} to "
            f"{_clock(max(times.values()))}, depths from {_clock(track[0, 0])} to {_clock(track[-1, 0])}. The camera's "
            "clock may be wrong or in another time zone. Say by how many seconds it was ahead with --clock-ahead."
        )
    positions = {name: np.array([0.0, 0.0, height]) for name, height in heights.items()}
    return CameraPositions("depths", positions, (np.inf, np.inf, 1.0))


def photo_time(photo: Photo) -> float | None:
    """Return when a photo was taken by its camera's clock, s, from its EXIF record or its name; None without both."""
    return _time_in_name(photo.name) if photo.taken is None else photo.taken.replace(tzinfo=timezone.utc).timestamp()


def _time_in_name(name: str) -> float | None:
    frame = FRAME_TIME.search(name)
    if frame is not None:
        return 60.0 * float(frame[1]) + float(frame[2])
    found = NAME_TIME.search(name)
    if found is None:
        return None
    try:
        whole = datetime(*(int(part) for part in found.groups()[:6]), tzinfo=timezone.utc)  # type: ignore[misc,arg-type]
    except ValueError:  # digits that are no date
        return None
    return whole.timestamp() + float(f"0.{found[7] or 0}")


def _read_track(path: Path) -> Array:
    """Return (M, 2) times (s, as if in UTC) and depths (m), in order."""
    rows = [(_time(row), float(row.numbers("depth")[0])) for row in read_rows(path, ("time", "depth"), "depth track")]
    track = np.array(sorted(rows)).reshape(-1, 2)
    if len(track) < 2:
        raise InputError(f"{path} holds {len(track)} depths; a track needs many. Export the whole dive.")
    if np.median(track[:, 1]) < 0.0:
        raise InputError(f"The depths in {path} are mostly negative. Depth counts down from the surface: turn signs.")
    return track


def _time(row: Row) -> float:
    stamp = (row.cells["time"] or "").strip()
    if stamp.replace(".", "", 1).isdecimal():
        return float(stamp)
    try:
        when = datetime.fromisoformat(stamp)
    except ValueError as error:
        raise InputError(
            f"{row.place}: '{stamp}' is no date and time such as 2026-11-21T10:02:03, nor a number of seconds since a "
            "video began. Correct the line."
        ) from error
    return when.replace(tzinfo=timezone.utc).timestamp()


def _depth_at(track: Array, when: float) -> float | None:
    after = int(np.searchsorted(track[:, 0], when))
    if after == 0 or after == len(track) or track[after, 0] - track[after - 1, 0] > MAX_GAP:
        return None
    return float(np.interp(when, track[:, 0], track[:, 1]))


def _clock(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, tz=timezone.utc).strftime("%Y-%m-%d %H:%M:%S")
