"""Printed markers of known size: AprilTags and ArUco markers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.reconstruct.georeference.clues import Lengths
from aquanav_tools.reconstruct.georeference.rays import Intersection, Rays, join, meet, rays_through
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array, Progress, ignore_progress

CORNER_ERROR_PX = 0.5
"""Standard deviation of a corner found by OpenCV in noise and blur."""
EDGE_BIAS_PX = 0.5
"""Standard deviation of a side's length that all photos share: blur and glare make black squares grow or shrink. On
rendered photos single tags of 15 to 20 cm were 0.9 to 1.3 % off, at sides of about 50 px."""
TOLERANCE_PX = 3.0
SQUARE_TO = 0.1
"""Sides and diagonals of a marker differ from a square's by less than this share, or it is none."""
PREFIX = "DICT_"


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers found in photos."""

    size: float
    """Side of the black square, m."""
    corners: Mapping[int, Mapping[str, Array]]
    """(4, 2) px, clockwise from the upper left one, by marker and photo."""

    def clue(self, sparse: SparseModel) -> Lengths:
        """Return the markers' sides in the model beside their size.

        Raises:
            InputError: no marker is seen well enough.
        """
        registered = set(sparse.names)
        sides, errors, labels, faults = [], [], [], []
        for marker, seen in sorted(self.corners.items()):
            photos = [name for name in seen if name in registered]
            side = _side(sparse, {name: seen[name] for name in photos})
            if isinstance(side, str):
                faults.append(f"marker {marker} {side}")
                continue
            sides.append(side[0])
            errors.append(side[1])
            labels.append(f"marker {marker}")
        if not sides:
            raise InputError(
                f"None of {len(self.corners)} printed markers gives a scale: {'; '.join(faults[:5])}. Each must be "
                "seen in two registered photos or more, taken from different places. Add photos of them, from near."
            )
        size = np.full(len(sides), self.size)
        return Lengths(
            "printed markers", tuple(labels), np.array(sides), size, np.array(errors), left_out=tuple(faults)
        )


def check_dictionary(name: str) -> str:
    """Return OpenCV's name of a marker dictionary such as apriltag-36h11.

    Raises:
        InputError: it has none of that name.
    """
    import cv2

    known = {key[len(PREFIX) :].lower().replace("_", "-"): key for key in dir(cv2.aruco) if key.startswith(PREFIX)}
    known |= {f"aruco-{key}": value for key, value in known.items() if key[0].isdigit()}
    key = name.lower().replace("_", "-")
    if key not in known:
        raise InputError(f"No marker dictionary is called '{name}'.{did_you_mean(key, known)}")
    return known[key]


def find_markers(photos: PhotoSet, size: float, dictionary: str, progress: Progress = ignore_progress) -> Markers:
    """Return the markers in prepared photos.

    Raises:
        InputError: no two of the photos show the same one.
    """
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    table = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, check_dictionary(dictionary)))
    detector = cv2.aruco.ArucoDetector(table, parameters)
    corners: dict[int, dict[str, Array]] = {}
    for index, name in enumerate(photos.names):
        for marker, found in _detect(detector, cv2.imread(str(photos.path(name)), cv2.IMREAD_GRAYSCALE)).items():
            corners.setdefault(marker, {})[name] = found
        progress(index + 1, len(photos.names))
    if not corners:
        raise InputError(
            f"No {dictionary} marker of {size:g} m was found in {len(photos.names)} photos. They may be of another "
            "family, too small (40 px are needed), blurred or in glare. Check --marker-dictionary, or give a distance."
        )
    if all(len(seen) < 2 for seen in corners.values()):
        marker, seen = next(iter(corners.items()))
        raise InputError(
            f"{len(corners)} {dictionary} markers were found in {len(photos.names)} photos, but none of them in two: "
            f"marker {marker} is in {next(iter(seen))} alone. A scale needs the same marker in two photos or more, "
            "taken from different places. Add photos of it, or give a distance."
        )
    return Markers(size, corners)


def _detect(detector: Any, grey: Any) -> dict[int, Array]:
    """Return the corners of markers in a photo; one that is there twice is left out."""
    quads, numbers, _ = detector.detectMarkers(grey)
    if numbers is None:
        return {}
    flat = [int(number) for number in np.ravel(numbers)]
    # OpenCV counts from the centre of the first pixel, COLMAP from its corner.
    return {
        number: np.asarray(quad, dtype=np.float64).reshape(4, 2) + 0.5
        for number, quad in zip(flat, quads, strict=True)
        if flat.count(number) == 1
    }


def _side(sparse: SparseModel, seen: Mapping[str, Array]) -> tuple[float, float] | str:
    """Return a marker's side in the model and its relative error, or what is wrong with it."""
    if len(seen) < 2:
        return f"is seen in {len(seen)} registered photo{'s' if len(seen) != 1 else ''}"
    views: list[Rays] = [rays_through(sparse, name, corners) for name, corners in seen.items()]
    corners = []
    for corner in range(4):
        rays = join([view.only(np.arange(4) == corner) for view in views])
        meeting = meet(rays, TOLERANCE_PX)
        if meeting is None:
            return "is not at one place in its photos, or they were taken from almost the same place"
        corners.append(meeting)
    points = np.array([corner.point for corner in corners])
    sides = np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1)
    diagonals = np.linalg.norm(points[2:] - points[:2], axis=1) / np.sqrt(2.0)
    side = float(sides.mean())
    if np.abs(np.concatenate([sides, diagonals]) / side - 1.0).max() > SQUARE_TO:
        return "is not square in the model; it may be bent, or hang in two places"
    return side, float(np.hypot(_noise(corners, points) / side, EDGE_BIAS_PX / _usual_side_px(seen)))


def _noise(corners: Sequence[Intersection], points: Array) -> float:
    """Return the standard deviation of the mean side by noise of the corners alone."""
    ahead = np.roll(points, -1, axis=0) - points
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    pulls = (np.roll(ahead, 1, axis=0) - ahead) / 4.0
    variance = sum(pull @ corner.covariance @ pull for pull, corner in zip(pulls, corners, strict=True))
    return float(CORNER_ERROR_PX * np.sqrt(variance))


def _usual_side_px(seen: Mapping[str, Array]) -> float:
    sides = [np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).mean() for corners in seen.values()]
    return float(np.median(sides))
