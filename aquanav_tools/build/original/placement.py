"""Where a cave of the original stands in its scene.

The scenes are lost; they scaled and moved the caves. What is left are the panels, which stood on the cave's middle
line. So the cave is turned by quarter turns, scaled (along the passage, and across it) and moved until its middle line
passes through the panels as closely as it can.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.build.original.rewarder import Rewarder
from aquanav_tools.build.original.tube import Tube
from aquanav_tools.types import Array, Mesh

MAX_MISFIT = 0.4
"""A rewarder belongs to a cave when its panels miss the middle line by at most this share of the cave's radius (rms).
Measured on all caves and panels of the project: the pairs that belong together reach 0.06 to 0.30, the others that
span the cave 0.46 and more."""
MAX_SQUEEZE = 4.0
"""Scaling along and across the passage differs by at most this factor."""


@dataclass(frozen=True, eq=False)
class Placement:
    """world_from_cave: quarter turns about z, then scaling along world x, y and z, then a move."""

    num_quarters: int
    scale: Array
    """(3,)."""
    move: Array
    """(3,) m."""
    misses: Array
    """(P,) distance of each panel's centre from the middle line, m; none when there were no panels."""
    radius: float
    """Mean distance of the wall from the middle line, m."""
    extent: float
    """Of the middle line along the scaled axis, m."""

    @property
    def misfit(self) -> float:
        """Root mean square of the misses, m."""
        return float(np.sqrt((self.misses**2).mean()))

    def fits(self, rewarder: Rewarder) -> bool:
        """Return whether the panels can have stood in this cave: they span it, and its middle line goes through."""
        reach = np.linalg.norm(rewarder.sides, axis=2).min()
        return self.misfit <= MAX_MISFIT * self.radius and reach >= self.radius

    def apply(self, points: Array) -> Array:
        """Return (N, 3) points of the cave's file in the world, m."""
        placed: Array = turned(points, self.num_quarters) * self.scale + self.move
        return placed

    def runs_backwards(self, line: Array, centres: Array) -> bool:
        """Return whether a (C, 3) line in the world passes (P, 3) panels' centres from the last to the first."""
        nearest = [np.argmin(((line - centre) ** 2).sum(axis=1)) for centre in (centres[0], centres[-1])]
        return bool(nearest[0] > nearest[1])

    def place(self, mesh: Mesh) -> Mesh:
        """Return the cave in the world."""
        return Mesh(self.apply(mesh.vertices), mesh.faces)


def turned(points: Array, num_quarters: int) -> Array:
    """Return (N, 3) points turned about z by quarter turns."""
    x, y, z = points.T
    for _ in range(num_quarters % 4):
        x, y = -y, x
    return np.stack([x, y, z], axis=1)


def best_placement(tube: Tube, rewarders: list[Rewarder]) -> tuple[Placement, Rewarder] | None:
    """Return the placement of the cave around a tube, and whose panels stood in it; None when none fit."""
    fits = [(fit_placement(tube, rewarder), rewarder) for rewarder in rewarders]
    fitting = [fit for fit in fits if fit[0].fits(fit[1])]
    return min(fitting, key=lambda fit: fit[0].misfit / fit[0].radius, default=None)


def likely_placement(tube: Tube, others: list[Placement]) -> Placement:
    """Return a placement that makes a cave as wide and long as others are, its near end at 0, the other towards +x.

    For caves whose panels are not in the project, so that nothing says where they stood.
    """
    along = int(np.argmax(np.ptp(tube.line, axis=0)[:2]))
    size = np.median([other.extent for other in others]) / np.ptp(tube.line, axis=0)[along]
    width = np.median([other.radius for other in others]) / np.mean(tube.radii)
    # The original's vehicle always starts looking along +x, and its policies see velocities in the world's frame.
    far = max(tube.line[[0, -1]], key=lambda end: float(np.linalg.norm(end)))
    num_quarters = ((0 if far[0] > 0.0 else 2), (3 if far[1] > 0.0 else 1))[along]
    scale = np.array([size, width, width])
    ends = turned(tube.line[[0, -1]], num_quarters) * scale
    move = -ends[np.argmin(np.linalg.norm(ends, axis=1))]
    radius = float(np.mean(tube.radii) * width)
    return Placement(num_quarters, scale, move, np.zeros(0), radius, float(size * np.ptp(tube.line, axis=0)[along]))


def fit_placement(tube: Tube, rewarder: Rewarder) -> Placement:
    """Return the placement with which the tube's middle line passes closest to the panels' centres, in their order."""
    fits = [_fit(tube, rewarder.centres, quarters) for quarters in range(4)]
    return min(fits, key=lambda fit: fit.misfit)


def _fit(tube: Tube, centres: Array, num_quarters: int) -> Placement:
    from scipy.optimize import least_squares

    line = turned(tube.line, num_quarters)
    along = int(np.argmax(np.ptp(line, axis=0)[:2]))
    first = _first_guess(line, centres, along)

    def misses(values: Array) -> Array:
        return _offsets(_placed(line, values, along), centres).ravel()

    best = least_squares(misses, first, bounds=_bounds(first), x_scale=np.maximum(np.abs(first), 1.0), max_nfev=200)
    scale = _scale(best.x, along)
    offsets = np.linalg.norm(_offsets(_placed(line, best.x, along), centres), axis=1)
    radius = float(np.mean(tube.radii)) * float(best.x[1])
    extent = float(np.ptp(line, axis=0)[along] * best.x[0])
    return Placement(num_quarters, scale, best.x[2:], offsets, radius, extent)


def _first_guess(line: Array, centres: Array, along: int) -> Array:
    size = np.ptp(centres, axis=0)[along] / np.ptp(line, axis=0)[along]
    size = max(float(size), 1e-9)
    move = centres.mean(axis=0) - size * line.mean(axis=0)
    return np.array([size, size, *move])


def _bounds(first: Array) -> tuple[Array, Array]:
    low, high = np.full(5, -np.inf), np.full(5, np.inf)
    low[:2], high[:2] = first[:2] / MAX_SQUEEZE, first[:2] * MAX_SQUEEZE
    return low, high


def _scale(values: Array, along: int) -> Array:
    scale = np.full(3, values[1])
    scale[along] = values[0]
    return scale


def _placed(line: Array, values: Array, along: int) -> Array:
    placed: Array = line * _scale(values, along) + values[2:]
    return placed


def _offsets(line: Array, centres: Array) -> Array:
    """Return the (P, 3) vectors from the nearest points of a polyline to points."""
    a, b = line[:-1], line[1:]
    ahead = b - a
    share = ((centres[:, None] - a) * ahead).sum(axis=2) / np.maximum((ahead * ahead).sum(axis=1), 1e-12)
    nearest = a + np.clip(share, 0.0, 1.0)[..., None] * ahead
    offsets = centres[:, None] - nearest
    best = np.argmin((offsets**2).sum(axis=2), axis=1)
    return np.take_along_axis(offsets, best[:, None, None].repeat(3, axis=2), axis=1)[:, 0]
