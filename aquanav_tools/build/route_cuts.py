"""Cuts given in metres along the route of an earlier build, as planes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aquanav_tools.build.options import BuildOptions
from aquanav_tools.errors import InputError
from aquanav_tools.geometry.polyline import arc_lengths, point_at
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.replacing import read_record
from aquanav_tools.scenario.shipped import SETTINGS_FILE
from aquanav_tools.types import Array

HALF_CHORD = 0.5
"""A cut stands across the route's direction over twice this length, m."""
Plane = tuple[float, float, float, float, float, float]


def with_planes(options: BuildOptions, announce: Callable[[str], None]) -> BuildOptions:
    """Return the options with planes in place of metres along a route, and say which planes these are.

    Raises:
        InputError: there is no earlier build, it was cut itself or made of another input, or its route has no such
            place.
    """
    places = options.closing.cut_at
    if not places:
        return options
    folder = options.closing.route_of or options.output
    line = _route_in(folder, options)
    planes = tuple(_plane(line, place, folder) for place in places)
    words = " ".join(f"--cut {' '.join(f'{value:.3f}' for value in plane)}" for plane in planes)
    announce(f"Cutting at {', '.join(f'{place:g} m' for place in places)} of the route in {folder}, as with {words}")
    closing = dataclasses.replace(options.closing, cut=(*options.closing.cut, *planes), cut_at=(), route_of=None)
    return dataclasses.replace(options, closing=closing)


def _route_in(folder: Path, options: BuildOptions) -> Array:
    """Return the (C, 3) route of an earlier build of the same input, m."""
    if not (folder / SETTINGS_FILE).is_file():
        raise InputError(
            f"There is no scenario in {folder}, and --cut-at counts metres along the route of an earlier build. Build "
            "once without it, look up the metres in the report, and name that folder with --route-of."
        )
    record = read_record(folder)
    inputs = record.get("inputs", {})
    if options.kind != "photos" and options.input.name not in inputs:
        raise InputError(
            f"The scenario in {folder} was built from {', '.join(sorted(inputs)[:3]) or 'something unknown'}, not from "
            f"{options.input.name}: a place on its route may be anywhere in this cave. Name another with --route-of."
        )
    earlier = record.get("options", {}).get("closing", {}).get("cut", [])
    if earlier:
        cuts = " ".join(f"--cut {' '.join(f'{value:.3f}' for value in plane)}" for plane in earlier)
        raise InputError(
            f"The scenario in {folder} was cut itself, so that its metres count along what was left. Name the build "
            f"without cuts with --route-of; or, to cut the same once more, give its planes again: {cuts}"
        )
    return read_scenario(folder).guide.centreline


def _plane(line: Array, place: float, folder: Path) -> Plane:
    """Return the plane across a route at a place, m, that takes away the shorter part of it."""
    lengths = arc_lengths(line)
    total = float(lengths[-1])
    if not 0.0 < place < total:
        raise InputError(
            f"--cut-at is {place:g} m, and the route in {folder} is {total:.1f} m long. Give a place on it, as in its "
            "report."
        )
    around = np.clip([place - HALF_CHORD, place, place + HALF_CHORD], 0.0, total)
    behind, at, ahead = point_at(line, lengths, around)
    direction = (ahead - behind) / np.linalg.norm(ahead - behind)
    x, y, z = (float(value) for value in at)
    nx, ny, nz = (float(value) for value in (-direction if place < 0.5 * total else direction))
    return x, y, z, nx, ny, nz
