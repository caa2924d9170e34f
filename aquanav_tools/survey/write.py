"""Writing a centreline with passage dimensions as a Survex data file (.svx)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from aquanav_tools.survey.legs import SurveyLegs
from aquanav_tools.types import Array

DECIMALS = 4
"""Coordinates are written to a tenth of a millimetre, finer than any survey and Survex's own centimetres."""
_MAX_ENTRANCE_NAME = 40


def write_svx(
    path: Path,
    title: str,
    points: Array,
    lrud: Array | None = None,
    entrances: Mapping[str, int] | None = None,
    survey: SurveyLegs | None = None,
) -> None:
    """Write a centreline as a Survex data file that `cavern` and `read_svx` read.

    The stations are numbered from 0, except the entrances, which bear their names. Coordinate differences are those of
    the rounded points, so that rounding does not add up along the line.

    Args:
        path: where to write, usually ending in .svx.
        title: shown by viewers.
        points: (N, 3) east, north, up, m; at least 2.
        lrud: (N, 4) left, right, up, down from the point to the wall, m, looking along the line; NaN where not known.
        entrances: index of the point for each entrance's name.
        survey: stations and legs written beside it, in a survey called "survey".

    Raises:
        ValueError: shapes do not fit, a coordinate is not finite, or an entrance is no point.
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 or not np.isfinite(points).all():
        raise ValueError(f"A centreline needs at least 2 finite points of 3 coordinates, got shape {points.shape}.")
    if lrud is not None and np.shape(lrud) != (len(points), 4):
        raise ValueError(f"{len(points)} points need ({len(points)}, 4) passage dimensions, not {np.shape(lrud)}.")
    names = _station_names(len(points), entrances or {})
    rounded = points.round(DECIMALS)
    lines = [f'*title "{_plain(title)}"', "*begin centreline", f"*fix {names[0]} {_numbers(rounded[0])}"]
    lines.append("*data cartesian from to dx dy dz")
    steps = np.diff(rounded, axis=0)
    lines += [f"{a} {b} {_numbers(step)}" for a, b, step in zip(names, names[1:], steps, strict=False)]
    lines += [f"*entrance {names[index]}" for index in (entrances or {}).values()]
    if lrud is not None:
        lines.append("*data passage station left right up down")
        lines += [
            f"{name} {_numbers(row)}" for name, row in zip(names, np.asarray(lrud, dtype=np.float64), strict=True)
        ]
    lines.append("*end centreline")
    if survey is not None:
        lines += _survey_lines(survey)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _survey_lines(survey: SurveyLegs) -> list[str]:
    """Return the block of a survey, its legs as differences of rounded positions, so that loops close."""
    # A dot in a name would name a survey inside this one; levels are joined by underscores instead.
    names = [re.sub(r"[^A-Za-z0-9_-]", "_", name) or f"unnamed_{n}" for n, name in enumerate(survey.names)]
    names = [name if names.count(name) == 1 else f"{name}_{n}" for n, name in enumerate(names)]
    rounded = survey.positions.round(DECIMALS)
    lines = ["*begin survey", "*case preserve"]
    first = int(survey.legs[0, 0])
    lines += [f"*fix {names[first]} {_numbers(rounded[first])}", "*data cartesian from to dx dy dz"]
    lines += [f"{names[a]} {names[b]} {_numbers(rounded[b] - rounded[a])}" for a, b in survey.legs.tolist()]
    lines += [f"*entrance {names[n]}" for n in np.flatnonzero(survey.is_entrance)]
    return [*lines, "*end survey"]


def _station_names(count: int, entrances: Mapping[str, int]) -> list[str]:
    names = [str(index) for index in range(count)]
    for entrance, index in entrances.items():
        if not 0 <= index < count:
            raise ValueError(f"The entrance '{entrance}' is at point {index}, but there are {count} points.")
        slug = re.sub(r"[^a-z0-9_]+", "_", entrance.lower()).strip("_")[:_MAX_ENTRANCE_NAME] or "entrance"
        names[index] = f"{slug}_{index}"  # the index keeps it apart from other stations, whatever the name
    return names


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.{DECIMALS}f}" if np.isfinite(value) else "-" for value in values)


def _plain(text: str) -> str:
    """Return a text fit for a quoted string in a data file."""
    return " ".join(text.replace('"', "'").split())
