"""What every source of scale or up comes down to: three kinds of observations of one similarity transform.

The unknowns are the logarithm of the scale and the rotation of `world_from_sfm`. A source's offset is its own: a depth
below the surface and a height above the sea agree on metres and on up, not on where zero is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from aquanav_tools.types import Array, BoolArray

C = TypeVar("C", bound="Clue")


@dataclass(frozen=True, eq=False)
class Clue(ABC):
    """Observations from one source, one item per row."""

    source: str
    """What a message calls it, in the plural."""
    labels: tuple[str, ...]
    """What a message calls each of its N items."""
    left_out: tuple[str, ...] = field(default=(), kw_only=True)
    """Further items that say nothing of the model, each with why."""

    @property
    @abstractmethod
    def num_offsets(self) -> int:
        """Unknowns of its own that it takes to fit."""

    @property
    @abstractmethod
    def is_error_known(self) -> bool:
        """Whether residuals are in standard deviations; else these are found from the residuals."""

    @abstractmethod
    def residuals(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return (N, D): how far each item is off, offsets fitted with (N,) weights."""

    @abstractmethod
    def derivatives(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return (N, D, 4) of the residuals, by log(scale) and by a turn of the world about x, y, z."""

    def only(self: C, keep: BoolArray) -> C:
        """Return the clue without some of its items."""
        rows = {name: value[keep] for name, value in vars(self).items() if name in self._rows}
        labels = tuple(label for label, kept in zip(self.labels, keep, strict=True) if kept)
        return replace(self, labels=labels, **rows)

    @property
    @abstractmethod
    def _rows(self) -> tuple[str, ...]:
        """Fields with one row per item."""


@dataclass(frozen=True, eq=False)
class Anchors(Clue):
    """Points of the model whose place in the world was measured; some axes may be unknown."""

    sfm: Array
    """(N, 3) in the model."""
    world: Array
    """(N, 3) m; anything where an axis is unknown."""
    spread: Array
    """(3,) errors of the axes relative to each other; infinite where unknown."""
    is_error_known = False
    _rows = ("sfm", "world")

    @property
    def known(self) -> BoolArray:
        """(3,) which axes are known."""
        return np.isfinite(self.spread)

    @property
    def is_full(self) -> bool:
        """Whether all three axes are known."""
        return bool(self.known.all())

    @property
    def num_offsets(self) -> int:
        """One for each known axis."""
        return int(self.known.sum())

    def residuals(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return the (N, D) misfits of the D known axes."""
        errors: Array = self._turned(scale, rotation, weights) - _centred(self.world, weights)
        return self._known(errors)

    def derivatives(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return their (N, D, 4) derivatives."""
        x, y, z = self._turned(scale, rotation, weights).T
        zero = np.zeros_like(x)
        by_axis = [[x, zero, z, -y], [y, -z, zero, x], [z, y, -x, zero]]
        return self._known(np.array(by_axis).transpose(2, 0, 1))

    def _turned(self, scale: float, rotation: Array, weights: Array) -> Array:
        turned: Array = scale * _centred(self.sfm, weights) @ rotation.T
        return turned

    def _known(self, values: Array) -> Array:
        """Return the known axes of (N, 3, ...) values, each in units of its error."""
        scaled: Array = values[:, self.known] / self.spread[self.known].reshape((-1,) + (1,) * (values.ndim - 2))
        return scaled


@dataclass(frozen=True, eq=False)
class Lengths(Clue):
    """Lengths known in the model and in metres."""

    sfm: Array
    """(N,) in the model."""
    metres: Array
    """(N,)"""
    errors: Array
    """(N,) standard deviation of their ratio, relative."""
    num_offsets = 0
    is_error_known = True
    _rows = ("sfm", "metres", "errors")

    def residuals(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return the (N, 1) logarithms of length ratios, in errors."""
        misfit: Array = (np.log(scale * self.sfm / self.metres) / self.errors)[:, None]
        return misfit

    def derivatives(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return their (N, 1, 4) derivatives."""
        derivatives = np.zeros((len(self.sfm), 1, 4))
        derivatives[:, 0, 0] = 1.0 / self.errors
        return derivatives


@dataclass(frozen=True, eq=False)
class Ups(Clue):
    """Directions of the model that point up."""

    sfm: Array
    """(N, 3) unit vectors in the model."""
    error: float
    """Standard deviation of each about each level axis, rad."""
    num_offsets = 0
    is_error_known = True
    _rows = ("sfm",)

    def residuals(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return the (N, 2) level parts of the directions, in errors."""
        level: Array = (self.sfm @ rotation.T)[:, :2] / self.error
        return level

    def derivatives(self, scale: float, rotation: Array, weights: Array) -> Array:
        """Return their (N, 2, 4) derivatives."""
        x, y, z = (self.sfm @ rotation.T).T / self.error
        zero = np.zeros_like(x)
        return np.array([[zero, zero, z, -y], [zero, -z, zero, x]]).transpose(2, 0, 1)


def _centred(points: Array, weights: Array) -> Array:
    centred: Array = points - weights @ points / weights.sum()
    return centred
