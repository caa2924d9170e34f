"""The part of a model that hangs together firmly: where no camera could move or grow by itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.types import BoolArray


def rigid_part(model: Any, min_points: int) -> list[int]:
    """Return the ids of the largest part of a model in which every photo is tied to the others by enough points.

    Two photos tell all but their scale; a third one lies firm to them by points that both of them show. So a part
    begins with the pair that shares most, and grows by photos that show `min_points` of the points which two of its
    photos show already.

    Args:
        model: pycolmap.Reconstruction.
        min_points: That tie a photo.
    """
    ids = sorted(model.reg_image_ids())
    shows = _who_shows_what(model, ids)
    shared = shows.astype(np.float32) @ shows.T.astype(np.float32)
    np.fill_diagonal(shared, 0.0)
    best: list[int] = []
    while shared.max(initial=0.0) >= min_points:
        first, second = divmod(int(np.argmax(shared)), len(ids))
        part = _grown(shows, first, second, min_points)
        shared[part], shared[:, part] = 0.0, 0.0  # the next part begins with a pair that none has yet
        if len(part) > len(best):
            best = part
    return [ids[row] for row in sorted(best)]


def _grown(shows: BoolArray, first: int, second: int, min_points: int) -> list[int]:
    """Return the rows of a part that begins with two photos."""
    part = [first, second]
    count = shows[part].sum(axis=0)
    while True:
        tied = shows[:, count >= 2].sum(axis=1)
        tied[part] = 0
        strongest = int(np.argmax(tied))
        if tied[strongest] < min_points:
            return part
        part.append(strongest)
        count += shows[strongest]


def _who_shows_what(model: Any, ids: list[int]) -> BoolArray:
    """Return (N, P) whether a photo shows a point."""
    rows = {image_id: row for row, image_id in enumerate(ids)}
    shows = np.zeros((len(ids), len(model.points3D)), np.bool_)
    for column, point in enumerate(model.points3D.values()):
        for element in point.track.elements:
            shows[rows[element.image_id], column] = True
    return shows
