"""A boat's proximity sensor: a fan of beams just below the water, which see rocks and shallow reefs alike.

A beam is a disc that moves straight ahead, as the original casts spheres, so that it meets a reef whose top is less
than its radius below still water. Beams are level, and turn with the boat's heading.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.sea.cast import cast_at_outline, cast_disc
from aquanav_tools.sea.outlines import outlines_of
from aquanav_tools.sea.sea_map import Outlines, SeaMap
from aquanav_tools.sim.hydrodynamics import rotation_rows
from aquanav_tools.sim.sensors import NOTHING, UNTAGGED, WALL, RayPattern
from aquanav_tools.types import Array


class SeaSensor:
    """Casts the beams of a pattern over one bay after another."""

    def __init__(self, pattern: RayPattern, *, sees_goal: bool = False) -> None:
        """Prepare the beams.

        Args:
            pattern: Level directions, lengths and radii.
            sees_goal: Whether a goal with an area stops beams, untagged, as the original's box does.
        """
        self.tags: npt.NDArray[np.int64] = np.full(len(pattern.lengths), NOTHING)
        """(R,) what the last beams met: NOTHING, WALL (rocks and edge) or UNTAGGED (the goal)."""
        self._directions, self._lengths, self._radii = pattern.directions, pattern.lengths, pattern.radii
        self._sees_goal = sees_goal
        self._outlines: Outlines | None = None
        self._goal: Array = np.zeros((0, 2))

    def look_at(self, sea: SeaMap) -> None:
        """Begin in another bay."""
        deepest = -float(self._radii.max())
        seen = [rock.outline for rock in sea.rocks if rock.top > deepest]
        self._outlines = sea.outlines if len(seen) == len(sea.rocks) else Outlines(*outlines_of(seen, sea.edge))
        has_area = self._sees_goal and len(sea.goal.corners) > 2
        self._goal = sea.goal.corners if has_area else np.zeros((0, 2))

    def sense(self, state: Array) -> npt.NDArray[np.float32]:
        """Return how far each beam's middle came from a (13,) state, (R,) m; at most the beams' lengths."""
        assert self._outlines is not None, "look_at comes first"
        distances = np.empty(len(self.tags), dtype=np.float32)
        beams = (self._directions, self._lengths, self._radii)
        cast_beams(state, *beams, *self._outlines, self._goal, distances, self.tags)
        return distances


@numba.njit(cache=True)
def cast_beams(state, directions, lengths, radii, corners, first, discs, edge, goal, distances, tags):  # type: ignore[no-untyped-def]
    """Write how far the middle of each beam comes from a state, m, and what it meets; arguments as of `SeaSensor`."""
    rotation = rotation_rows(state)
    size = np.hypot(rotation[0][0], rotation[1][0])
    cosine, sine = rotation[0][0] / size, rotation[1][0] / size
    for n in range(len(lengths)):
        ux = cosine * directions[n, 0] - sine * directions[n, 1]
        uy = sine * directions[n, 0] + cosine * directions[n, 1]
        way = cast_disc(corners, first, discs, edge, state[0], state[1], ux, uy, lengths[n], radii[n])
        tags[n] = WALL if way < lengths[n] else NOTHING
        if len(goal) > 0:
            to_goal = cast_at_outline(goal, 0, len(goal), state[0], state[1], ux, uy, radii[n])
            if to_goal < way:
                way, tags[n] = to_goal, UNTAGGED
        distances[n] = way
