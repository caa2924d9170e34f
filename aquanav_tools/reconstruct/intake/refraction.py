"""What the water before a housing does to a photo's geometry, by Snell's law: in numbers, before anything is built."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array

WATER = 1.333
"""Refractive index of fresh water at 10 to 20 degrees Celsius and 550 nm; sea water has 1.34 (Quan and Fry, 1995)."""
_DOME_RADIUS_MM = 50.0
"""Of the usual dome for compact cameras; the figures are per millimetre off its centre."""
_SAMPLES = 200


@dataclass(frozen=True)
class FlatPort:
    """A pinhole camera behind a flat port close to its pupil, as its photos show the water."""

    half_view_air_deg: float
    """From the axis to the photo's corner, in air."""
    half_view_water_deg: float
    """The same in water."""
    edge_shift_px: float
    """Of the corner, against a pinhole camera of WATER times the focal length."""
    residual_px: float
    """Largest error that two radial distortion terms, fitted over the photo, leave."""
    shape_error: float
    """That error as a share of the distance to the axis: the relative error of shape to expect at worst."""
    viewpoint_shift: float
    """How far the corner's rays start behind the axis's, as a share of the distance from pupil to port."""


def flat_port(focal_px: float, width: int, height: int) -> FlatPort:
    """Return what a flat port does to a photo.

    A ray at angle a to the axis in air was at w = asin(sin a / WATER) in water; its place in the photo is focal tan a.
    With the pupil a distance d behind the port the ray crosses the axis d tan a / tan w behind it: no single viewpoint.

    Args:
        focal_px: Focal length in air.
        width: px.
        height: px.
    """
    corner = 0.5 * math.hypot(width, height)
    radius = np.linspace(0.0, corner, _SAMPLES + 1)[1:]
    in_air = np.arctan(radius / focal_px)
    in_water = np.arcsin(np.sin(in_air) / WATER)
    ideal = np.tan(in_water)
    residual = radius - ideal * _radial_fit(ideal, radius)
    worst = int(np.argmax(np.abs(residual)))
    return FlatPort(
        math.degrees(in_air[-1]),
        math.degrees(in_water[-1]),
        float(radius[-1] - WATER * focal_px * ideal[-1]),
        float(abs(residual[worst])),
        float(abs(residual[worst]) / radius[worst]),
        float(math.tan(in_air[-1]) / ideal[-1] - WATER),
    )


def dome_shift_px(focal_px: float, width: int, height: int) -> float:
    """Return how far a photo's corner moves for each millimetre between the lens's pupil and the dome's centre, px.

    A ray at angle a to the axis meets a dome of radius R, d off its centre, at asin(d sin a / R) to its normal and is
    bent by the difference of that to its refracted angle. A centred dome bends nothing.
    """
    corner = 0.5 * math.hypot(width, height)
    angle = math.atan(corner / focal_px)
    at_dome = math.asin(math.sin(angle) / _DOME_RADIUS_MM)
    bent = at_dome - math.asin(math.sin(at_dome) / WATER)
    return focal_px * (math.tan(angle + bent) - math.tan(angle))


def _radial_fit(ideal: Array, radius: Array) -> Array:
    """Return f (1 + k1 r^2 + k2 r^4) at each ideal r, fitted to the radii in px; each ring counts by its area."""
    powers = np.stack([ideal**0, ideal**2, ideal**4], axis=1)
    weight = np.sqrt(ideal)[:, None]
    coefficients, *_ = np.linalg.lstsq(powers * ideal[:, None] * weight, radius * weight[:, 0], rcond=None)
    fitted: Array = powers @ coefficients
    return fitted


def describe_housing(housing: str, focal_px: float | None, width: int, height: int) -> str:
    """Return the sentences that say what scale and shape error to expect from a housing; empty without one.

    Args:
        housing: "none", "flat-port" or "dome".
        focal_px: In air; a camera of 75 degrees across is taken as an example where it is unknown.
        width: px.
        height: px.
    """
    known = focal_px or 0.5 * width / math.tan(math.radians(37.5))
    whose = "this camera" if focal_px else "a camera of 75 degrees across (EXIF tells no focal length)"
    if housing == "none":
        return ""
    if housing == "dome":
        return _describe_dome(dome_shift_px(known, width, height), whose, 0.5 * math.hypot(width, height))
    return _describe_flat_port(flat_port(known, width, height), whose)


def _describe_dome(shift_px: float, whose: str, corner_px: float) -> str:
    return (
        "Dome port: centred on the lens's pupil it changes neither scale nor shape. "
        f"For {whose}, each millimetre off centre moves the corners by {shift_px:.1f} px ({shift_px / corner_px:.2%}) "
        f"on a dome of {_DOME_RADIUS_MM:.0f} mm radius; focal length and radial distortion take up most of that."
    )


def _describe_flat_port(port: FlatPort, whose: str) -> str:
    return (
        f"Flat port: under water the focal length grows by {WATER - 1.0:.0%}, and mapping starts from there. "
        f"For {whose}, the view shrinks from {2 * port.half_view_air_deg:.0f} to {2 * port.half_view_water_deg:.0f} "
        f"degrees, corner to corner, and the corners lie {port.edge_shift_px:.0f} px farther out than in a pinhole "
        f"camera; two terms of radial distortion leave at most {port.residual_px:.2f} px of that, a shape error of up "
        f"to {port.shape_error:.2%}. Were the focal length in air kept, depths would come out "
        f"{1.0 - 1.0 / WATER:.0%} too short. Each 10 mm from the lens's pupil to the port move the viewpoint of the "
        f"corners by {10 * port.viewpoint_shift:.1f} mm, a shape error of {port.viewpoint_shift / 100:.2%} at 1 m that "
        "no lens model takes up."
    )
