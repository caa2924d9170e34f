"""From calibrated readings to a leg's vector and how uncertain it is.

The covariance is the first-order propagation of the readings' standard deviations, J diag(sd^2) J^T, plus the scatter
of where on the station each end was taken ("position", a third of its variance along each axis). For tape, compass and
clino and for Cartesian data this is, measured with loops of one leg each, what Survex's `cavern` 1.4.4 does. In three
places we keep to the propagation where that version does not: depth gauge and cylindrical legs (its covariances are
permuted, some not positive definite), Topofil counts (taken as exact), and foresights averaged with backsights of
another standard deviation (its mean lies outside both). Only such averages, and loops with such legs, differ.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array

UNKNOWN_SLOPE_VARIANCE = 0.1
"""Variance of the rise over a leg without clino reading, in units of its length squared. Survex: proportional to the
tape; the factor was found by experiment with `cavern`."""


@dataclass(frozen=True)
class Estimate:
    """A value with its variance."""

    value: float
    variance: float

    def merged(self, other: Estimate) -> Estimate:
        """Return the mean of two readings of one thing, weighted by how certain they are."""
        total = self.variance + other.variance
        if total == 0.0:
            return Estimate(0.5 * (self.value + other.value), 0.0)
        value = (self.value * other.variance + other.value * self.variance) / total
        return Estimate(value, self.variance * other.variance / total)


def sloping_leg(tape: Estimate, bearing: Estimate, slope: Estimate, sd: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the (3,) vector and (3, 3) covariance of a leg measured by length, m, bearing and slope, rad."""
    sin_b, cos_b = math.sin(bearing.value), math.cos(bearing.value)
    sin_s, cos_s = math.sin(slope.value), math.cos(slope.value)
    length = tape.value
    ahead = np.array([cos_s * sin_b, cos_s * cos_b, sin_s])
    to_right = length * cos_s * np.array([cos_b, -sin_b, 0.0])
    upwards = length * np.array([-sin_s * sin_b, -sin_s * cos_b, cos_s])
    jacobian = np.stack([ahead, to_right, upwards], axis=1)
    return length * ahead, _covariance(jacobian, [tape.variance, bearing.variance, slope.variance], sd)


def plumb_leg(tape: Estimate, direction: float, sd: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the vector and covariance of a leg straight up (direction 1) or down (-1)."""
    sideways = (tape.value * sd["plumb"]) ** 2
    covariance = np.diag([sideways, sideways, tape.variance])
    return np.array([0.0, 0.0, direction * tape.value]), covariance + _station_scatter(sd)


def unsloped_leg(tape: Estimate, bearing: Estimate, sd: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the vector and covariance of a leg without slope: taken as level, its rise hardly known."""
    level = Estimate(0.0, 0.0)
    vector, covariance = sloping_leg(tape, bearing, level, sd)
    covariance[2, 2] += UNKNOWN_SLOPE_VARIANCE * tape.value**2
    return vector, covariance


def depth_leg(
    tape: Estimate, bearing: Estimate, rise: Estimate, sd: Mapping[str, float], *, is_tape_level: bool
) -> tuple[Array, Array]:
    """Return the vector and covariance of a leg measured by length, bearing and rise.

    Args:
        tape: along the leg, or, where `is_tape_level`, its horizontal length, m.
        bearing: rad.
        rise: m, upwards.
        sd: standard deviations, m and rad.
        is_tape_level: which of the two the tape is.

    Raises:
        ValueError: the rise exceeds the tape.
    """
    if is_tape_level or tape.value == 0.0:
        level, by_tape, by_rise = tape.value, 1.0, 0.0
    else:
        if abs(rise.value) > tape.value:
            raise ValueError(f"the depth changes by {abs(rise.value):.2f} m over a tape of {tape.value:.2f} m")
        level = math.sqrt(tape.value**2 - rise.value**2)
        by_tape, by_rise = (tape.value / level, -rise.value / level) if level > 0.0 else (1.0, 0.0)
    ahead = np.array([math.sin(bearing.value), math.cos(bearing.value), 0.0])
    to_right = level * np.array([ahead[1], -ahead[0], 0.0])
    jacobian = np.stack([by_tape * ahead, to_right, by_rise * ahead + [0.0, 0.0, 1.0]], axis=1)
    vector = level * ahead + [0.0, 0.0, rise.value]
    return vector, _covariance(jacobian, [tape.variance, bearing.variance, rise.variance], sd)


def cartesian_leg(vector: Array, sd: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the vector and covariance of a leg given by its three components, m."""
    return vector, np.diag([sd["dx"] ** 2, sd["dy"] ** 2, sd["dz"] ** 2])


def _covariance(jacobian: Array, variances: list[float], sd: Mapping[str, float]) -> Array:
    covariance: Array = (jacobian * variances) @ jacobian.T + _station_scatter(sd)
    return covariance


def _station_scatter(sd: Mapping[str, float]) -> Array:
    scatter: Array = np.eye(3) * sd["position"] ** 2 / 3.0
    return scatter
