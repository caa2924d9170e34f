"""The tables that a report has about photos."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aquanav_tools.cave.measure.unseen import ROOM, UnseenPatch
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.html import Table
from aquanav_tools.types import Array


def unseen_table(patches: Sequence[UnseenPatch], photos: Sequence[int], cave: CaveMap, in_all: int) -> Table:
    """Return where to take more photos.

    Args:
        patches: unseen wall, in the order of its numbers on the drawings.
        photos: how many show each patch.
        cave: for the distance along its route.
        in_all: patches, with those that are not listed.
    """
    along = cave.along(np.array([patch.stand for patch in patches]))
    rows = tuple(
        (
            str(number),
            f"{patch.area:.1f} m²",
            f"{distance:.1f}",
            _row(patch.stand)
            + ("" if patch.clearance >= ROOM else f" (tight: {max(patch.clearance, 0.0):.2f} m free)"),
            _direction(patch.ahead),
            _row(patch.centre),
            _why(count),
        )
        for number, (patch, distance, count) in enumerate(zip(patches, along, photos, strict=True), start=1)
    )
    title = "Add photos here" + ("" if in_all == len(patches) else f": the largest {len(patches)} of {in_all} places")
    columns = ("number", "wall", "along (m)", "stand at (m)", "look towards", "wall's middle (m)", "why")
    return Table(title, columns, rows)


def _direction(ahead: Array) -> str:
    """Return a view's bearing and slope, as a diver reads compass and clinometer."""
    slope = float(np.degrees(np.arcsin(np.clip(ahead[2], -1.0, 1.0))))
    if abs(slope) > 75.0:
        return "straight up" if slope > 0.0 else "straight down"
    bearing = float(np.degrees(np.arctan2(ahead[0], ahead[1]))) % 360.0
    tilt = "level" if abs(slope) < 5.0 else f"{abs(slope):.0f}° {'up' if slope > 0 else 'down'}"
    return f"{bearing:.0f}°, {tilt}"


def _why(photos: int) -> str:
    if photos == 0:
        return "in no photo"
    if photos == 1:
        return "in one photo; depth takes two"
    return f"in {photos} photos, not measured: far, dark, plain, oblique or open water"


def photo_tables(facts: dict[str, Any]) -> tuple[Table, ...]:
    """Return how the photos fared, from the first look to registration, as far as they came."""
    tables = [_photo_table(facts)] if "registered" in facts else []
    if facts.get("scale_sources"):
        tables.append(scale_table(facts["scale_sources"]))
    if facts.get("unregistered"):
        rows = tuple((photo["name"], photo["cause"], photo["sentence"]) for photo in facts["unregistered"])
        tables.append(Table("Photos that did not register", ("photo", "cause", "why"), rows))
    return (*tables, *_preflight_tables(facts))


def _photo_table(facts: dict[str, Any]) -> Table:
    """Return the counts and errors of a reconstruction, in words and units."""
    names = {
        "photos": ("Photos used", "{}"),
        "registered": ("Photos that found their place", "{}"),
        "sparse_points": ("Sparse points", "{}"),
        "reprojection_error_px": ("Mean reprojection error", "{} px"),
        "cloud_points": ("Points of the dense cloud", "{}"),
        "scale_error_percent_95": ("Scale, 95 % interval", "± {} %"),
        "up_error_deg_95": ("Up, 95 % cone", "± {}°"),
        "camera_occlusion": ("Wall around the cameras", "{:.0%} of the view"),
        "camera_facing": ("Walls before them that face each other", "on {:.0%} of all lines"),
    }
    found = {name: facts[name] for name in names if facts.get(name) is not None}
    rows = tuple((names[name][0], names[name][1].format(value)) for name, value in found.items())
    return Table("Photos", ("what", "value"), rows)


def _preflight_tables(facts: dict[str, Any]) -> tuple[Table, ...]:
    """Return the photos that were named before the work began, and what the work was expected to take."""
    if "forecast" not in facts:
        return ()
    expected = facts["forecast"]
    rows = [(name, f"{value:.0f} s") for name, value in expected["seconds"].items()]
    rows += [("memory", f"{expected['memory_gb']:.1f} GB"), ("disk", f"{expected['disk_gb']:.1f} GB")]
    tables = [Table(f"Forecast for the photo stages ({expected['cores']} cores)", ("what", "expected"), tuple(rows))]
    named = [(photo["name"], "not used", photo["reason"]) for photo in facts["left_out"]]
    named += [(photo["name"], photo["code"].replace("-", " "), photo["value"]) for photo in facts["preflight"]]
    if named:
        tables.append(Table("Photos with something wrong at first look", ("photo", "what", "evidence"), tuple(named)))
    return tuple(tables)


def scale_table(sources: list[dict[str, Any]]) -> Table:
    """Return what each source of scale and up said alone, as `Georeference.statistics` lists them."""
    rows = tuple(
        (
            one["source"],
            str(one["items"]),
            "-" if one["scale"] is None else f"{one['scale']:.4g} ± {one['scale_error_percent']:.2g} %",
            f"± {one['up_error_deg']:.2g}",
            "-" if one["rms_m"] is None else f"{one['rms_m']:.3f}",
            "yes" if one["used"] else "no: it contradicts a better one",
            ", ".join(one["left_out"][:5]) or "-",
        )
        for one in sources
    )
    columns = ("source", "items", "metres per unit", "up (degrees)", "misfit (m)", "used", "left out")
    return Table("Scale and up, each source alone, with 95 % intervals", columns, rows)


def _row(vector: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in vector)
