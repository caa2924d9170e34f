"""The shortest way through the water to the goal, as a map: one look-up per position, continuous, without any state.

The lengths of the ways (within 1 % of closed forms, see `water.geodesic`) are known at samples of the water; the map is
trilinear between them, like the distance field. Samples too near to a wall for the vehicle take the value of the
nearest that is not, so that the map goes on up to the wall.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.field import BAND, DistanceField, field_from_dense
from aquanav_tools.geometry.volume.geodesic import WaterGraph
from aquanav_tools.types import Array

MAX_SAMPLES = 30_000
"""Samples of the water at most: a second of work, and a few per metre of passage width."""
BEYOND = 4.0
"""The map reaches so many spacings beyond the places that a vehicle's middle keeps from the wall, so that every cell of
the water has eight corners."""

_maps: WeakKeyDictionary[DistanceField, dict[tuple[float, ...], ShortestPaths]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class ShortestPaths:
    """How far it is to the goal from everywhere."""

    lengths: DistanceField
    """m to go; the field of distances serves as the container."""
    places: Array
    """(N, 3) samples of the water from which the vehicle can reach the goal, m."""
    place_lengths: Array
    """(N,) m."""

    def remaining(self, position: Array) -> float:
        """Return the length of the shortest way to the goal from a (3,) position, m."""
        return self.lengths.clearance_at(position)


def shortest_paths(field: DistanceField, goal: Array, radius: float) -> ShortestPaths:
    """Return the ways to a (3,) goal for a vehicle of some radius, m; worked out once per field, goal and radius.

    Raises:
        MeshError: there is no water wide enough.
    """
    key = (*(float(axis) for axis in goal), radius)
    known = _maps.setdefault(field, {})
    if key not in known:
        known[key] = _find(field, np.asarray(goal, dtype=np.float64), radius)
    return known[key]


def _find(field: DistanceField, goal: Array, radius: float) -> ShortestPaths:
    from scipy.ndimage import distance_transform_edt

    graph = WaterGraph(field, radius, MAX_SAMPLES)
    lengths = graph.ways_from(goal).lengths
    lengths = lengths + float(np.linalg.norm(graph.points[graph.nearest_open(goal)] - goal))
    is_reached = np.isfinite(lengths)
    if is_reached.sum() < 2:
        raise MeshError(
            "The goal lies in no water that the vehicle can swim in. Choose a smaller vehicle, or build again."
        )
    points, lengths = graph.points[is_reached], lengths[is_reached]
    index = np.rint((points - field.origin) / graph.spacing).astype(np.int64)
    reach = BEYOND + radius / graph.spacing
    margin = int(reach) + 1
    low = index.min(axis=0) - margin
    dense = np.full(index.max(axis=0) - low + margin + 1, np.nan, dtype=np.float32)
    dense[tuple((index - low).T)] = lengths
    apart, nearest = distance_transform_edt(np.isnan(dense), return_indices=True)
    filled = dense[tuple(nearest)]
    far = np.argwhere(apart > reach)
    is_rock = field.clearance(field.origin + graph.spacing * (far + low)) <= 0.0
    filled[tuple(far[is_rock].T)] = -BAND * graph.spacing  # nobody asks there, and no memory is spent on it
    return ShortestPaths(field_from_dense(field.origin + graph.spacing * low, graph.spacing, filled), points, lengths)
