"""Vehicles are data: one TOML file each, in the folder `vehicles` beside this module or anywhere else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.tables import from_table, parse_toml, read_toml

VEHICLE_DIR = Path(__file__).parent / "vehicles"
MODELS: dict[str, type[Vehicle]] = {"fossen": FossenVehicle, "original": OriginalVehicle}
"""What the key `model` of a file may say; "fossen" when it is not there."""


def known_vehicles() -> tuple[str, ...]:
    """Return the names of the vehicles that ship with aquanav."""
    return tuple(sorted(path.stem for path in VEHICLE_DIR.glob("*.toml")))


def load_vehicle(name: str | Path) -> Vehicle:
    """Return a vehicle by its name, or from the TOML file at a path that ends in .toml.

    Raises:
        InputError: no such vehicle (with the closest name), or the file has an unknown, missing or senseless value
            (with the name of the field).
    """
    path = vehicle_path(name)
    return _vehicle_from(read_toml(path), path.name)


def vehicle_path(name: str | Path) -> Path:
    """Return the file of a shipped vehicle by its name; a path that ends in .toml is returned as it is.

    Raises:
        InputError: no vehicle of that name ships with aquanav; the message has the closest one.
    """
    if Path(name).suffix == ".toml":
        return Path(name)
    if str(name) not in known_vehicles():
        raise InputError(f"There is no vehicle '{name}'.{did_you_mean(str(name), known_vehicles())}")
    return VEHICLE_DIR / f"{name}.toml"


def parse_vehicle(text: str, where: str) -> Vehicle:
    """Return the vehicle in the text of a TOML file; `where` is what messages call it.

    Raises:
        InputError: as `load_vehicle`.
    """
    return _vehicle_from(parse_toml(text, where), where)


def _vehicle_from(table: dict[str, Any], where: str) -> Vehicle:
    model = table.get("model", "fossen")
    if model not in MODELS:
        raise InputError(f"{where}: model is {model!r}.{did_you_mean(str(model), MODELS)}")
    return from_table(MODELS[model], table, where)
