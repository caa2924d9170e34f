"""Whether the passage goes by behind an opening: water that spreads from it parts, and flows off to two sides.

Behind the end of a passage it spreads in one front, whatever way the passage winds. Behind a strip of roof, floor or
wall that nobody scanned it meets the opposite wall, and goes on along the passage to both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aquanav_tools.geometry.mesh.rasterise import band_distances
from aquanav_tools.types import Array, BoolArray

CELLS = 14
"""Cells across an opening."""
MAX_CELLS = 500_000
"""Cells around an opening in all: where it is long they are larger."""
MIN_PART = 0.25
"""Parts of the front with less than this share of the opening's area are corners."""
MAX_AHEAD = 0.75
"""Water flows off sideways where the cosine between its way from the opening and straight inwards is below this. For
both: measured on 36 drawn caves of 9 styles with a strip of 1.5 to 5 m missing. As far off as an opening is long,
fronts behind 69 ends are in one part, ahead by 0.66 and more; those behind six strips that had passed for ends in two,
each of half the area and more, ahead by up to 0.56."""


@dataclass(frozen=True)
class Front:
    """How water goes on behind an opening."""

    ahead: tuple[float, ...]
    """Of each part, the cosine between straight inwards and the way from the opening's middle to the part's."""

    @property
    def is_sideways(self) -> bool:
        """Whether no part lies ahead."""
        return all(ahead < MAX_AHEAD for ahead in self.ahead)

    @property
    def passes(self) -> bool:
        """Whether a passage goes by: to two sides, and not straight on."""
        return len(self.ahead) > 1 and self.is_sideways


def front_behind(
    triangles: Array,
    centre: Array,
    normal: Array,
    area: float,
    distance: float,
    are_in_water: Callable[[Array], BoolArray],
) -> Front:
    """Return how water that spreads from an opening goes on behind it.

    Args:
        triangles: (T, 3, 3) of the opening, m.
        centre: (3,) its middle, m.
        normal: (3,) unit vector out of the water.
        area: across the normal, m^2.
        distance: how far off the front is looked at, by way of the water, m.
        are_in_water: tells (N, 3) places in the water, as (N,) flags.
    """
    from skimage.graph import MCP_Geometric
    from skimage.measure import label, regionprops

    diameter = float(np.sqrt(4.0 * area / np.pi))
    corners, margin = triangles.reshape(-1, 3), distance + 2.0 / CELLS * diameter
    low, extent = corners.min(axis=0) - margin, np.ptp(corners, axis=0) + 2.0 * margin
    cell = max(diameter / CELLS, float(np.cbrt(extent.prod() / MAX_CELLS)))
    rows, columns, layers = (int(n) for n in np.ceil(extent / cell) + 1)
    shape = rows, columns, layers
    places = low + cell * np.indices(shape).reshape(3, -1).T
    is_water = are_in_water(places).reshape(shape)
    begins = np.argwhere(is_water & (band_distances(triangles, low, cell, shape, 1.5 * cell)[0] <= cell))
    if not len(begins):
        return Front(())
    lengths = cell * MCP_Geometric(np.where(is_water, 1.0, np.inf)).find_costs(begins)[0]
    parts = label(np.abs(lengths - distance) < 0.75 * cell, connectivity=3)
    # The layer is 1.5 cells thick.
    large = [part for part in regionprops(parts) if part.area * cell**2 / 1.5 > MIN_PART * area]
    ways = [low + cell * np.array(part.centroid) - centre for part in large]
    return Front(tuple(float(-(way @ normal) / np.linalg.norm(way)) for way in ways))
