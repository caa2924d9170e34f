"""Vehicles that are bluerov2 in another hull."""

from __future__ import annotations

import re
from pathlib import Path

from aquanav_tools.sim.vehicle import VEHICLE_DIR


def write_vehicle(path: Path, radius: float, length: float) -> Path:
    """Write bluerov2 with a capsule of another size, m, named as the file; return the file."""
    text = (VEHICLE_DIR / "bluerov2.toml").read_text()
    text = re.sub(r"^radius = .*$", f"radius = {radius}", text, count=1, flags=re.M)
    text = re.sub(r"^axis_length = .*$", f"axis_length = {length - 2.0 * radius}", text, count=1, flags=re.M)
    path.write_text(text.replace('name = "bluerov2"', f'name = "{path.stem}"'))
    return path
