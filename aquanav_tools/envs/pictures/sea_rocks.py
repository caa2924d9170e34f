"""Rocks at sea as they are drawn: exact where a hull meets them, weathered above."""

from __future__ import annotations

import numpy as np

from aquanav_tools.sea.sea_map import Rock, rock_solid
from aquanav_tools.types import Array, IntArray, Mesh

SPACING = 0.8
"""Between points along an outline, m."""
EXACT = 0.6
"""Up to this height above still water a rock is its outline, m: higher than any hull that may touch it."""
LEVELS = ((0.25, 0.97), (0.5, 0.88), (0.75, 0.70), (0.92, 0.45))
"""Shares of the height above EXACT, and what is left of the outline there."""
ROUGH = 0.35
"""Share of what is taken away from the outline by which it varies."""


def drawn_rock(rock: Rock, depth: float) -> Mesh:
    """Return the triangles of a rock as it is drawn, normals outwards, m.

    Rocks touch as upright prisms. This one has the prism's outline from the sea bed to EXACT above the water, and is
    within the prism above; reefs, low rocks, and those with triangles of their own are as they touch.
    """
    if rock.solid is not None or rock.top <= EXACT:
        return rock_solid(rock, depth)
    outline = _points_along(rock.outline)
    middle = outline.mean(axis=0)
    rng = np.random.default_rng(np.abs(np.round(100.0 * middle)).astype(np.uint64))
    rings = [np.column_stack([outline, np.full(len(outline), z)]) for z in (-depth, 0.0, EXACT)]
    for share, left in LEVELS:
        rough = _smooth(rng.standard_normal(len(outline)))
        kept = np.clip(left + ROUGH * (1.0 - left) * rough, 0.05, 1.0)[:, None]
        heights = EXACT + (rock.top - EXACT) * np.clip(share + 0.03 * _smooth(rng.standard_normal(len(outline))), 0, 1)
        rings.append(np.column_stack([middle + kept * (outline - middle), heights]))
    ends = np.array([[*middle, rock.top], [*middle, -depth]])
    return Mesh(np.concatenate([*rings, ends]), _skin(len(outline), len(rings)))


def _points_along(outline: Array) -> Array:
    """Return the points of an outline with more between them, on its edges."""
    pieces = []
    for here, after in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        count = max(int(np.ceil(np.linalg.norm(after - here) / SPACING)), 1)
        pieces.append(here + np.arange(count)[:, None] / count * (after - here))
    return np.concatenate(pieces)


def _smooth(values: Array) -> Array:
    """Return values around a ring, each the mean of its neighbours' and its own, with deviation 1."""
    mean = (np.roll(values, 1) + values + np.roll(values, -1)) / 3.0
    found: Array = mean / max(float(mean.std()), 1e-9)
    return found


def _skin(count: int, num_rings: int) -> IntArray:
    """Return the triangles between rings of points, one above the other, and from the outer rings to the two ends."""
    here = np.arange(count)
    after = (here + 1) % count
    bands = []
    for ring in range(num_rings - 1):
        low, high = ring * count, (ring + 1) * count
        bands += [np.stack([low + here, low + after, high + after], axis=1)]
        bands += [np.stack([low + here, high + after, high + here], axis=1)]
    last = (num_rings - 1) * count
    bands.append(np.stack([after, here, np.full(count, num_rings * count + 1)], axis=1))
    bands.append(np.stack([last + here, last + after, np.full(count, num_rings * count)], axis=1))
    return np.concatenate(bands).astype(np.int64)
