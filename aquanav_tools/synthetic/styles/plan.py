"""What a drawn cave is made of: passages with a cross-section at every station, rock that stands in them, relief.

Coordinates are in metres, z up. The cave is cut off by the planes x = 0 and x = `Plan.extent`, where it has its two
portals; a main passage leads straight through both.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.types import Array

NO_FLOOR = -1e9
"""Height of a floor that is not there, m."""


@dataclass(frozen=True, eq=False)
class Passage:
    """A swept cross-section: a superellipse with one half height and exponent above the axis and one below."""

    axis: Array
    """(C, 3) stations, evenly spaced, m."""
    heading: Array
    """(C,) direction of the passage in plan, rad; it says which way is sideways where the axis is vertical."""
    half_width: Array
    """(C,) m."""
    above: Array
    """(C,) from the axis to the ceiling, m."""
    below: Array
    """(C,) from the axis to the rock below, m."""
    exponent_above: float = 2.0
    """2 is an ellipse; larger ones come closer to a rectangle."""
    exponent_below: float = 2.0
    lean: Array | None = None
    """(C,) by how much the passage swings sideways over its height, m."""
    lean_length: float = 4.0
    """Height over which it swings to and fro, m."""
    floor: Array | None = None
    """(C,) depth of the level floor of sediment under the axis, m; none when not given."""


@dataclass(frozen=True, eq=False)
class Block:
    """A convex block of rock, as it falls from a ceiling."""

    centre: Array
    """(3,) m."""
    normals: Array
    """(K, 3) unit vectors out of its faces."""
    distances: Array
    """(K,) of its faces from the centre, m."""

    @property
    def radius(self) -> float:
        """Of a ball around the centre that the block is taken to lie in, m."""
        return 1.6 * float(self.distances.max())


@dataclass(frozen=True, eq=False)
class Column:
    """An upright column of rock from floor to ceiling, narrowest in its middle."""

    foot: Array
    """(3,) m."""
    height: float
    """m."""
    radius: float
    """In its middle, m."""
    flare: float = 0.6
    """By how much it is wider at both ends, as a share of the radius."""


@dataclass(frozen=True)
class Relief:
    """How rough the wall is, m: amplitudes of noise at several scales, each smaller in tight passages."""

    swell: float = 0.15
    """Bulges and hollows of 1 to 3 m."""
    ledges: float = 0.0
    """Beds of rock that stand out in level bands."""
    bed: float = 0.5
    """Thickness of these beds, m."""
    scallops: float = 0.0
    """Hollows with sharp crests between them."""
    scallop_length: float = 0.6
    """Length of these hollows, m."""
    joints: float = 0.0
    """Angular breaks along cracks in two upright directions."""
    grain: float = 0.05
    """The finest that the surface can show."""
    floor: float = 0.1
    """Of the floor of sediment."""
    dip: tuple[float, float] = (0.0, 0.0)
    """Slope of the beds along x and y."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A cave before its surface is made."""

    passages: tuple[Passage, ...]
    """The main one first."""
    extent: float
    """Distance between the two portals along x, m."""
    opening: float
    """Width of the largest ball that fits through its narrowest place before relief, m."""
    relief: Relief = field(default_factory=Relief)
    blocks: tuple[Block, ...] = ()
    columns: tuple[Column, ...] = ()

    @property
    def wall_area(self) -> float:
        """About the area of the wall, m^2, without what stands in the passages."""
        return sum(
            float(np.linalg.norm(np.diff(one.axis, axis=0), axis=1).mean())
            * float(np.pi * (one.half_width + 0.5 * (one.above + one.below)).sum())
            for one in self.passages
        )

    @property
    def length(self) -> float:
        """Metres along the main passage between the portals."""
        axis = self.passages[0].axis
        inside = axis[(axis[:, 0] >= 0.0) & (axis[:, 0] <= self.extent)]
        return length_of(inside)
