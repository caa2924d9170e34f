"""Reading and writing scenario folders (format 1). Nobody else knows their file names.

Every file but scenario.toml is listed there with its SHA-256, so that a changed or missing file is noticed before any
of it is used. scenario.toml is written last: a folder without it is not a scenario.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import weakref
from pathlib import Path
from typing import Any

from aquanav_tools.errors import ScenarioError, near_names
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario import geometry
from aquanav_tools.scenario.flow_file import read_flow, write_flow
from aquanav_tools.scenario.replacing import finish_replacing
from aquanav_tools.scenario.schema import FORMAT, Scenario, ScenarioSettings
from aquanav_tools.scenario.shipped import BAYS, SETTINGS_FILE, scenario_folder, scenario_names
from aquanav_tools.shipped import shipped_names
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.text_files import read_text

GEOMETRY_FILES = ("cave.ply", "collision.obj", "field.npz", "guide.json", "starts.json")
VEHICLE_FILE = "vehicle.toml"
"""Only there when the scenario carries its vehicle."""
FLOW_FILE = "flow.npz"
"""Only there when water flows through the cave."""
MAX_FILE_BYTES = 4 << 30
_in_use: weakref.WeakValueDictionary[tuple[Path, str], Scenario] = weakref.WeakValueDictionary()


def write_scenario(scenario: Scenario, folder: Path) -> Scenario:
    """Write a scenario into `folder` (made when absent) and return it as it reads back.

    Other files already there (pictures, reports) stay. Until the last step the folder has no scenario.toml.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / SETTINGS_FILE).unlink(missing_ok=True)
    geometry.write_cavity(scenario.cavity, folder / "cave.ply")
    geometry.write_collision(scenario.collision, folder / "collision.obj")
    geometry.write_field(scenario.field, folder / "field.npz")
    geometry.write_guide(scenario.guide, scenario.cavity.portals, folder / "guide.json", scenario.network)
    geometry.write_starts(scenario.starts, folder / "starts.json")
    names = list(GEOMETRY_FILES)
    if scenario.vehicle_toml:
        (folder / VEHICLE_FILE).write_text(scenario.vehicle_toml, encoding="utf-8")
        names.append(VEHICLE_FILE)
    if scenario.flow is not None:
        write_flow(scenario.flow, folder / FLOW_FILE)
        names.append(FLOW_FILE)
    _write_settings(scenario.settings, names, folder)
    return read_scenario(folder)


def read_scenario(folder: str | Path) -> Scenario:
    """Return the scenario in a folder, or the shipped one of a name, after checking all of it.

    While one that was read from the same files is in use, that same one is returned: environments share it. Its arrays
    are not to be written to.

    Raises:
        ScenarioError: no such folder, an unknown or missing key, a value out of range, a file that is missing,
            outside the folder, changed since it was written, or inconsistent with the others.
    """
    folder = scenario_folder(folder)
    try:
        finish_replacing(folder)
    except OSError as cause:
        raise ScenarioError(
            f"The build of {folder} was stopped while it moved its files into place, and that cannot be finished: "
            f"{cause}. Make the folder writable and try again."
        ) from cause
    if not (folder / SETTINGS_FILE).is_file():
        near = near_names(folder.name, [*scenario_names(), *shipped_names(BAYS)])
        raise ScenarioError(
            f"{folder} is not a scenario: it has no {SETTINGS_FILE}. Name a folder that aquanav-build-cave finished, "
            f"or a shipped scenario; the nearest names are {', '.join(near)}, and `aquanav list` has all."
        )
    table = read_toml(folder / SETTINGS_FILE, ScenarioError)
    if table.pop("format", None) != FORMAT:
        raise ScenarioError(
            f"{folder / SETTINGS_FILE} is not of format {FORMAT}. Another version of aquanav wrote it; build it again."
        )
    hashes = _check_files(folder, table.pop("files", None))
    settings = from_table(ScenarioSettings, table, SETTINGS_FILE, ScenarioError)
    content = _content_hash(folder, hashes)
    known = _in_use.get((folder.resolve(), content))
    if known is not None:
        return known
    guide, portals = geometry.read_guide(folder / "guide.json")
    scenario = Scenario(
        settings=settings,
        cavity=geometry.read_cavity(folder / "cave.ply", portals),
        collision=geometry.read_collision(folder / "collision.obj"),
        field=geometry.read_field(folder / "field.npz"),
        guide=guide,
        starts=geometry.read_starts(folder / "starts.json"),
        vehicle_toml=read_text(folder / VEHICLE_FILE, ScenarioError) if VEHICLE_FILE in hashes else "",
        flow=read_flow(folder / FLOW_FILE) if FLOW_FILE in hashes else None,
        network=geometry.read_network(folder / "guide.json"),
        content_hash=content,
        folder=folder.resolve(),
    )
    _in_use[folder.resolve(), content] = scenario
    return scenario


def _write_settings(settings: ScenarioSettings, names: list[str], folder: Path) -> None:
    import tomli_w

    table: dict[str, Any] = {"format": FORMAT, **dataclasses.asdict(settings)}
    if settings.water.surface is None:
        del table["water"]["surface"]  # TOML has no word for it
    table["files"] = {name: file_hash(folder / name) for name in names}
    partial = folder / (SETTINGS_FILE + ".partial")
    partial.write_text(tomli_w.dumps(table), encoding="utf-8")
    os.replace(partial, folder / SETTINGS_FILE)


def _check_files(folder: Path, files: object) -> dict[str, str]:
    if not isinstance(files, dict) or set(files) - {VEHICLE_FILE, FLOW_FILE} != set(GEOMETRY_FILES):
        listed = sorted(files) if isinstance(files, dict) else files
        raise ScenarioError(
            f"{SETTINGS_FILE} must list exactly the files {', '.join(GEOMETRY_FILES)}, not {listed}. Build it again."
        )
    for name, expected in files.items():
        path = folder / name
        if not path.is_file() or not path.resolve().is_relative_to(folder.resolve()):
            raise ScenarioError(f"{folder} lacks its file {name}. Copy the whole folder, or build it again.")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ScenarioError(f"{path} has {path.stat().st_size} bytes, more than {MAX_FILE_BYTES}. Build it again.")
        actual = file_hash(path)
        if actual != expected:
            raise ScenarioError(
                f"{path} has changed since the scenario was written "
                f"(SHA-256 {actual[:12]}, listed {str(expected)[:12]}). Restore the file, or build the scenario again."
            )
    return files


def _content_hash(folder: Path, hashes: dict[str, str]) -> str:
    digest = hashlib.sha256((folder / SETTINGS_FILE).read_bytes())
    for name in sorted(hashes):
        digest.update(hashes[name].encode())
    return digest.hexdigest()
