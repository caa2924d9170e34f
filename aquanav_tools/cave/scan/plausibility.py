"""Whether a scan has the size of a cave and stands upright: wrong units and axes are told before the work."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan.wall_samples import WallSamples, floor_shares, passage_widths
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, Mesh, PointCloud

METRES_PER_UNIT = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048, "in": 0.0254}
PROPOSED = {"m": "metres", "dm": "decimetres", "cm": "centimetres", "mm": "millimetres", "km": "kilometres"}
LENGTHS = (0.5, 20_000.0)
"""No scan of a cave is shorter, or longer, m: the longest cave known, Mammoth Cave, lies within 16 km."""
LONGEST_UNASKED = 500.0
"""A scan longer than this is rather one in centimetres or millimetres, unless --unit says otherwise, m."""
WIDTHS = (0.1, 500.0)
"""No passage is narrower, or wider, m: the widest chamber known, Sarawak Chamber, measures 435 m across, and what is
narrower lets no vehicle through."""
TYPICAL_WIDTH = 3.0
"""Of a passage, m: of the possible units, the one that comes nearest to it is proposed."""
TYPICAL_LENGTH = 15.0
"""Of a scan, m: the same where no passage is found."""
STEEP = 1.5
"""A scan so many times as high as long stands on its end, or is a shaft."""
CLEARLY_MORE = 3.0
"""Times as much floor and ceiling as the usual axis would give speaks for another one."""
Y_UP_SUFFIXES = (".glb", ".gltf")
"""Of formats that have y up by their specification."""


def check_size(
    surface: Mesh | PointCloud, wall: WallSamples | None, unit: str | None, declared: float | None = None
) -> None:
    """Refuse a size that no cave has, in whatever unit.

    Args:
        surface: in the unit of its file.
        wall: its samples.
        unit: that the user gave; None without.
        declared: metres in the unit that the file names; None where it names none.

    Raises:
        InputError: with the sizes, and the unit that it may be in.
    """
    length = float(_extents(surface).max())
    if not length > 0.0:
        return
    widths = np.zeros(0) if wall is None else passage_widths(wall)
    width = float(np.median(widths)) if len(widths) else None
    metres = METRES_PER_UNIT[unit] if unit else declared or 1.0
    if not _fits(metres, length, width) or (unit is None and declared is None and length > LONGEST_UNASKED):
        raise InputError(_refusal(length, width, unit, declared))


def _refusal(length: float, width: float | None, unit: str | None, declared: float | None) -> str:
    """Return what to say about a length and a width of passages in the file's unit; None where none was found."""
    metres = METRES_PER_UNIT[unit] if unit else declared or 1.0
    across = "" if width is None else f", and its passages are about {_metres(metres * width)} m wide"
    size = f"the cave is {_metres(metres * length)} m long{across}"
    is_told = unit is None and declared is not None
    used = f"the unit that the file names ({declared:g} m)" if is_told else f"--unit {unit or 'm'}"
    fitting = [
        name for name in PROPOSED if METRES_PER_UNIT[name] != metres and _fits(METRES_PER_UNIT[name], length, width)
    ]
    if not fitting:
        return (
            f"With {used} {size}. No cave is of that size, and no other unit makes it one: the export "
            "went wrong. Export the scan again."
        )
    asked, typical = (length, TYPICAL_LENGTH) if width is None else (width, TYPICAL_WIDTH)
    likely = min(fitting, key=lambda name: abs(np.log(METRES_PER_UNIT[name] * asked / typical)))
    if unit is None and declared is None:
        insist = " If it is really that size, give --unit m." if _fits(1.0, length, width) else ""
        return f"T{size[1:]}: are these {PROPOSED[likely]}? Then give --unit {likely}.{insist}"
    better = METRES_PER_UNIT[likely]
    there = "" if width is None else f" with passages {_metres(better * width)} m wide"
    return (
        f"With {used} {size}. No cave is of that size. The file is rather in {PROPOSED[likely]}, in which it is "
        f"{_metres(better * length)} m long{there}: give --unit {likely}."
    )


def _fits(metres: float, length: float, width: float | None) -> bool:
    """Return whether a cave may have a length and a width of passages in a unit of so many metres."""
    is_width = width is None or WIDTHS[0] <= metres * width <= WIDTHS[1]
    return LENGTHS[0] <= metres * length <= LENGTHS[1] and is_width


def _metres(value: float) -> str:
    return f"{value:,.0f}" if 100.0 <= value < 1e9 else f"{value:.2g}"


def upright_cautions(
    surface: Mesh | PointCloud, wall: WallSamples | None, options: ScanOptions, path: Path, declared: str | None = None
) -> tuple[tuple[str, str], ...]:
    """Return a caution where a scan stands on its end for no other reason than the axis that was said to point up.

    A level gallery on its end looks like a shaft. So one is taken for granted where the file's own axis is kept.

    Args:
        surface: in the axes of its file.
        wall: its samples.
        options: with the axis that points up.
        path: of the file: some formats have y up.
        declared: axis that points up as the file says; None where it does not.
    """
    default = declared or "z"
    chosen = options.up or default
    likely = "y" if path.suffix.lower() in Y_UP_SUFFIXES else default
    if wall is None or chosen == likely:
        return ()
    extents, up = _extents(surface), "xyz".index(chosen[-1])
    others = [axis for axis in range(3) if axis != up]
    if extents[up] < STEEP * extents[others].max():
        return ()
    shares = floor_shares(wall)
    usual = "xyz".index(likely)
    best = max(others, key=lambda axis: shares[axis])
    if usual in others and shares[best] < CLEARLY_MORE * shares[usual]:
        best = usual
    name, given = "xyz"[best], "xyz"[up]
    note = " (the default)" if name == default else ""
    plan = " by ".join(f"{extents[axis]:.3g}" for axis in others)
    sentence = (
        f"With --up {chosen} the cave is a shaft: {extents[up]:.3g} high and {plan} wide, in the file's unit. Its "
        f"longest axis is the file's {given}, and {shares[up]:.0%} of its wall is floor or ceiling. If it is a level "
        f"gallery, --up {name}{note} fits: then it is {extents[best]:.3g} high, and {shares[best]:.0%} of its wall "
        "is floor or ceiling."
    )
    return (("stands-on-end", sentence),)


def _extents(surface: Mesh | PointCloud) -> Array:
    """Return the (3,) sizes of a scan along its axes, without stray points, in its own unit."""
    points = surface.vertices if isinstance(surface, Mesh) else surface.points
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    extents: Array = high - low
    return extents
