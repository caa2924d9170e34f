"""Bays as scenarios: which bay, boat and sea the episodes of the surface task have, in a settings file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from aquanav_tools.errors import ScenarioError
from aquanav_tools.provenance import digest, file_hash
from aquanav_tools.scenario.schema import OtherVehicle
from aquanav_tools.scenario.shipped import BAYS
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.original import SUFFIX as ORIGINAL_SUFFIX
from aquanav_tools.shipped import shipped_names, shipped_path
from aquanav_tools.tables import from_table, read_toml

FORMAT = 1
SETTINGS_SUFFIX, MAP_SUFFIX = ".toml", ".json"
MAX_MAP_BYTES = 100_000_000


@dataclass(frozen=True)
class BaySettings:
    """What a bay's settings file says."""

    vehicle: str = "otter"
    """Name of a boat; "boat" is the original's."""
    sea: str = "calm"
    """still, calm, breeze or rough."""
    decisions: int = 2400
    """Episode limit."""
    map: str | None = None
    """File of a fixed bay beside the settings: a map, or a scene of the original. Without it each episode has another
    bay."""
    rocks: MapSettings | None = None
    """What bays are like that are drawn; the usual ones, for the boat's width, when not given."""

    def __post_init__(self) -> None:
        if self.map is not None and self.rocks is not None:
            raise ValueError("map and rocks exclude each other: a fixed bay is not drawn. Leave one out.")
        if self.map is not None and Path(self.map).name != self.map:
            raise ValueError(f"map = {self.map!r} must be the name of a file beside the settings, without a folder.")
        if self.decisions < 1:
            raise ValueError(f"decisions = {self.decisions} must be at least 1.")


@dataclass(frozen=True, eq=False)
class Bay:
    """A scenario of the surface task."""

    name: str
    settings: BaySettings
    map_path: Path | None
    """Of a fixed bay."""
    content_hash: str
    """Of settings and map."""
    other_vehicle: OtherVehicle | None = None
    """The boat where that is not the one in the settings' file."""


def is_bay(spec: str | Path) -> bool:
    """Return whether a scenario's name or path means a bay: a shipped one's name, or a .toml or .json file."""
    return str(spec) in shipped_names(BAYS) or Path(spec).suffix in (SETTINGS_SUFFIX, MAP_SUFFIX)


def read_bay(spec: str | Path) -> Bay:
    """Return the bay of a shipped name, of a settings file, or of a map's file by itself.

    A scene of the original has its boat, and still water.

    Raises:
        ScenarioError: a file is missing, or a setting is unknown or senseless.
    """
    path = shipped_path(BAYS, str(spec)) if str(spec) in shipped_names(BAYS) else Path(spec)
    if path.suffix == MAP_SUFFIX:
        is_original = _rocks_of(path).exists()
        settings = BaySettings(map=path.name)
        settings = replace(settings, vehicle="boat", sea="still") if is_original else settings
    else:
        table = read_toml(path, ScenarioError)
        if table.pop("format", None) != FORMAT:
            raise ScenarioError(f"{path} is no bay of format {FORMAT}: write format = {FORMAT} at its top.")
        settings = from_table(BaySettings, table, path.name, ScenarioError)
    if settings.map is None:
        return Bay(path.stem, settings, None, digest(settings))
    map_path = path.with_name(settings.map)
    return Bay(path.stem, settings, map_path, digest(replace(settings, map=None), _hashes(map_path)))


def _hashes(map_path: Path) -> list[str]:
    """Return the hashes of a map's files, of sizes that can be read."""
    files = [file for file in (map_path, _rocks_of(map_path)) if file.is_file()]
    if map_path not in files:
        raise ScenarioError(f"There is no map {map_path}. Check the path.")
    for file in files:
        if file.stat().st_size > MAX_MAP_BYTES:
            raise ScenarioError(
                f"{file} has {file.stat().st_size / 1e6:.0f} MB, and a map at most 100. Check the path."
            )
    return [file_hash(file) for file in files]


def _rocks_of(map_path: Path) -> Path:
    """Return the file of an original scene's rocks."""
    return map_path.with_name(map_path.stem + ORIGINAL_SUFFIX)
