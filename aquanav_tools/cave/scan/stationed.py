"""Tables of points with colours and stations: what readers of terrestrial scans stream, thinned while it comes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from aquanav_tools.cave.scan.stations import believable_stations
from aquanav_tools.cave.scan.surface_file import SurfaceFile
from aquanav_tools.cave.scan.thinning import EvenThinner, thinned_caution
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, PointCloud

CHUNK_POINTS = 500_000


def stationed_table(points: Array, colours: Array | None, station: Array | None) -> Array:
    """Return an (N, 9) table x y z r g b sx sy sz; NaN stands for what is not known.

    Args:
        points: (N, 3).
        colours: (N, 3) 0 to 255.
        station: (3,) where the scanner stood.
    """
    table = np.full((len(points), 9), np.nan)
    table[:, :3] = points
    if colours is not None:
        table[:, 3:6] = colours
    if station is not None:
        table[:, 6:] = station
    return table


def cloud_of_tables(path: Path, tables: Iterable[Array], metres_per_unit: float | None = 1.0) -> SurfaceFile:
    """Return the cloud in `stationed_table`s, of a large one an even choice; z is up.

    Raises:
        InputError: there is no point in it.
    """
    thinner = EvenThinner()
    for table in tables:
        thinner.add(table)
    if not thinner.num_seen:
        raise InputError(
            f"{path} has 0 points; a surface needs at least 4. The file is empty or cut off. Copy or export it again."
        )
    table = thinner.result()
    seen_from = believable_stations(table[:, :3], table[:, 6:])
    colours = None if np.isnan(table[:, 3:6]).any() else np.clip(np.rint(table[:, 3:6]), 0, 255).astype(np.uint8)
    cloud = PointCloud(table[:, :3], colours=colours, seen_from=seen_from if np.isfinite(seen_from).any() else None)
    return SurfaceFile(cloud, thinned_caution(path.name, thinner, len(table)), metres_per_unit, "z")
