"""What can tell how large a photographed passage is and which way is up. Light to import."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ScaleSources:
    """Where the metres come from when the input is photos. Several may be given: they are weighed and held together."""

    positions: Path | None = None
    """CSV with the columns name,x,y,z: known camera positions in metres, z up. Gives scale and up axis."""
    marker_size: float | None = None
    """Side of the printed markers' black square, m: AprilTags or ArUco markers in the photos then give the scale."""
    marker_dictionary: str = "apriltag-36h11"
    """Which markers: apriltag-36h11, apriltag-25h9, aruco-4x4-50, aruco-6x6-250 and so on, as OpenCV names them."""
    picks: Path | None = None
    """CSV with the columns point,photo,x,y: where named points are seen, in pixels from the photo's upper left corner,
    each in two photos or more. For --distance and --stations."""
    distance: tuple[tuple[str, str, float], ...] = ()
    """Measured distances between points of --picks: two names and metres, such as A B 2.35."""
    stations: Path | None = None
    """Coordinates of points of --picks: CSV with the columns point,x,y,z in metres, or a survey (.svx, .3d, .th)."""
    rig: tuple[str, str, float] | None = None
    """Two cameras side by side: names of the one's photos and of the other's with a * for what a pair shares, and their
    distance in metres, such as "left_*.jpg" "right_*.jpg" 0.30."""
    depth_track: Path | None = None
    """CSV with the columns time,depth of a depth sensor: the camera's local time as 2026-11-21T10:02:03, or seconds
    since a video began, and metres below the surface. Matched to the photos' times (EXIF, or as 20261121_100203 in
    their names). Gives scale and up axis."""
    clock_ahead: float = 0.0
    """How far the camera's clock was ahead of the depth sensor's, s."""
    gps: bool = False
    """Use the positions in the photos' EXIF records: above ground, and only where the passage is long."""
    level_floor: bool = False
    """The floor is level, as in a mine or a flooded gallery: up is across it."""

    def __post_init__(self) -> None:
        if self.marker_size is not None and not 0.0 < self.marker_size < 5.0:
            raise ValueError(f"marker_size = {self.marker_size} m is not between 0 and 5 m.")
        lengths = [metres for _, _, metres in self.distance] + ([] if self.rig is None else [self.rig[2]])
        if any(not 0.0 < length < 10_000.0 for length in lengths):
            raise ValueError(f"Known distances must be above 0 and below 10000 m, got {lengths}.")
        if (bool(self.distance) or self.stations is not None) != (self.picks is not None):
            raise ValueError("picks and (distance or stations) belong together: give both or neither.")

    @property
    def scaling(self) -> tuple[str, ...]:
        """The options given that can tell the size of what the photos show; the others tell which way is up."""
        given = {
            "positions": self.positions is not None,
            "marker_size": self.marker_size is not None,
            "picks": self.picks is not None,
            "rig": self.rig is not None,
            "depth_track": self.depth_track is not None,
            "gps": self.gps,
        }
        return tuple(name for name, is_given in given.items() if is_given)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that are read."""
        return tuple(path for path in (self.positions, self.picks, self.stations, self.depth_track) if path is not None)
