"""Data sheets of sensors: TOML files, read strictly into a sensor's dataclass. Those in `sheets/` go by name.

A figure that a sheet gives as "±x" is taken as one standard deviation: what a device of that kind is off by is drawn
anew in each episode.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.tables import from_table, read_toml

T = TypeVar("T")
FOLDER = Path(__file__).parent / "sheets"


def sheet_names(kind: str) -> list[str]:
    """Return the names of the data sheets that come with aquanav for "depth", "imu", "dvl", "track" or "sonar"."""
    names = [path.stem for path in FOLDER.glob("*.toml")]
    return sorted(name.removeprefix(f"{kind}-") for name in names if name.startswith(f"{kind}-"))


def read_sheet(cls: type[T], source: T | Mapping[str, Any] | str | Path, kind: str) -> T:
    """Return a sensor's data.

    Args:
        cls: The sensor's dataclass.
        source: An instance of it, its fields as a table, the name of a sheet that comes with aquanav, or a TOML file.
        kind: What the messages call the sensor, and the beginning of its sheets' file names.

    Raises:
        InputError: there is no such sheet, or it makes no sense; the message has the nearest name or the key.
    """
    if isinstance(source, cls):
        return source
    if isinstance(source, Mapping):
        return from_table(cls, dict(source), f"The table of the sensor '{kind}'")
    if not isinstance(source, str | Path):
        raise InputError(
            f"The data of the sensor '{kind}' must be a {cls.__name__}, a table, a name or a path, not a "
            f"{type(source).__name__}."
        )
    if isinstance(source, str) and re.fullmatch(r"[\w-]+", source):
        known = sheet_names(kind)
        if source not in known:
            raise InputError(f"There is no data sheet '{source}' for the sensor '{kind}'.{did_you_mean(source, known)}")
        source = FOLDER / f"{kind}-{source}.toml"
    return from_table(cls, read_toml(Path(source)), str(source))


def check_range(sensor: str, name: str, value: float, low: float, high: float) -> None:
    """Refuse a figure that is out of its range.

    Raises:
        ValueError: with the figure's name and the range.
    """
    if not low <= value <= high:
        raise ValueError(f"The {sensor} has {name} = {value}, which must be from {low:g} to {high:g}.")
