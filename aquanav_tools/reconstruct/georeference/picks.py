"""Points that the user sees in photos: survey stations, and ends of measured distances."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.reconstruct.georeference.clues import Anchors, Lengths
from aquanav_tools.reconstruct.georeference.rays import Intersection, join, meet, rays_through
from aquanav_tools.reconstruct.georeference.rows import read_rows
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array

PICK_ERROR_PX = 2.0
"""Standard deviation of a point picked by hand; chosen: rock has no sharp marks, and a station is a smudge of paint."""
PICK_TOLERANCE_PX = 10.0
"""Picks farther from where the others put their point are mistakes."""
TAPE_ERROR = 0.01
"""Standard deviation of a distance measured under ground, m; chosen: a tape sags, its ends are held by hand."""
SURVEY_SUFFIXES = (".svx", ".3d", ".th")


@dataclass(frozen=True, eq=False)
class Picks:
    """Where named points are seen."""

    pixels: Mapping[str, Mapping[str, Array]]
    """(2,) px from the upper left corner, by point and photo."""

    def points(self, sparse: SparseModel, names: Iterable[str]) -> dict[str, Intersection]:
        """Return where points are in the model.

        Raises:
            InputError: one is seen in fewer than two registered photos, or its picks do not meet.
        """
        registered = set(sparse.names)
        found = {}
        for name in dict.fromkeys(names):
            seen = {photo: pixel for photo, pixel in self.pixels[name].items() if photo in registered}
            if len(seen) < 2:
                raise InputError(
                    f"Point '{name}' is picked in {len(seen)} registered photos of {len(self.pixels[name])}; two from "
                    "different places are needed, better four. Pick it in more photos."
                )
            rays = join([rays_through(sparse, photo, pixel[None]) for photo, pixel in seen.items()])
            meeting = meet(rays, PICK_TOLERANCE_PX)
            if meeting is None:
                raise InputError(
                    f"The picks of point '{name}' in {', '.join(seen)} do not meet within {PICK_TOLERANCE_PX:g} px, or "
                    "the photos were taken from almost the same place. Check that it is the same spot of rock in each."
                )
            found[name] = meeting
        return found


@dataclass(frozen=True, eq=False)
class KnownDistances:
    """Measured distances between picked points."""

    picks: Picks
    distances: tuple[tuple[str, str, float], ...]

    def clue(self, sparse: SparseModel) -> Lengths:
        """Return the distances beside those in the model.

        Raises:
            InputError: a point cannot be placed.
        """
        points = self.picks.points(sparse, [name for a, b, _ in self.distances for name in (a, b)])
        lengths, errors = [], []
        for a, b, metres in self.distances:
            line = points[b].point - points[a].point
            length = float(np.linalg.norm(line))
            along = line / length
            variance = PICK_ERROR_PX**2 * along @ (points[a].covariance + points[b].covariance) @ along
            lengths.append(length)
            errors.append(np.hypot(np.sqrt(variance) / length, TAPE_ERROR / metres))
        labels = tuple(f"{a} to {b}" for a, b, _ in self.distances)
        known = np.array([metres for _, _, metres in self.distances])
        return Lengths("measured distances", labels, np.array(lengths), known, np.array(errors))


@dataclass(frozen=True, eq=False)
class Stations:
    """Surveyed points that are seen in photos."""

    picks: Picks
    positions: Mapping[str, Array]
    """(3,) m by point."""

    def clue(self, sparse: SparseModel) -> Anchors:
        """Return the stations beside their places in the model.

        Raises:
            InputError: a station cannot be placed.
        """
        points = self.picks.points(sparse, self.positions)
        sfm = np.array([points[name].point for name in self.positions])
        return Anchors(
            "survey stations", tuple(self.positions), sfm, np.array(list(self.positions.values())), np.ones(3)
        )


def read_picks(path: Path, photos: Sequence[str]) -> Picks:
    """Return the picks in a CSV file with columns point, photo, x, y (px as image viewers count, from 0).

    Raises:
        InputError: the file cannot be read, or names a photo that is not there.
    """
    pixels: dict[str, dict[str, Array]] = {}
    for row in read_rows(path, ("point", "photo", "x", "y"), "picks file"):
        point, photo = row.cells["point"], row.cells["photo"]
        if photo not in photos:
            raise InputError(f"{row.place}: no photo is called '{photo}'.{did_you_mean(str(photo), photos)}")
        # COLMAP counts from the corner of the first pixel, viewers from its centre.
        pixels.setdefault(point, {})[photo] = row.numbers("x y") + 0.5
    return Picks(pixels)


def read_distances(picks: Picks, distances: tuple[tuple[str, str, float], ...]) -> KnownDistances:
    """Return measured distances between picked points.

    Raises:
        InputError: a point was not picked.
    """
    for a, b, metres in distances:
        for name in (a, b):
            if name not in picks.pixels:
                raise InputError(
                    f"The distance of {metres:g} m is from '{a}' to '{b}', but the picks have no point '{name}'."
                    f"{did_you_mean(name, picks.pixels)}"
                )
    return KnownDistances(picks, distances)


def read_stations(picks: Picks, path: Path) -> Stations:
    """Return the coordinates of picked points, from a CSV file with columns point, x, y, z (m) or a survey.

    Raises:
        InputError: the file cannot be read, or holds fewer than three of the points.
    """
    known = _survey_stations(path) if path.suffix.lower() in SURVEY_SUFFIXES else _listed_stations(path)
    positions = {name: known[name] for name in picks.pixels if name in known}
    if len(positions) < 3:
        lost = next((name for name in picks.pixels if name not in known), "")
        raise InputError(
            f"{path} holds {len(positions)} of the {len(picks.pixels)} picked points; three that are not on a line are "
            f"needed.{did_you_mean(lost, known) if lost else ' Pick more stations.'}"
        )
    return Stations(picks, positions)


def _listed_stations(path: Path) -> dict[str, Array]:
    return {
        row.cells["point"]: row.numbers("x y z") for row in read_rows(path, ("point", "x", "y", "z"), "station file")
    }


def _survey_stations(path: Path) -> dict[str, Array]:
    from aquanav_tools.survey.read import read_survey

    return {station.name: station.position for station in read_survey(path).stations if station.name}
