"""`aquanav info FOLDER`: the same numbers as in the report, under the same names."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.route.passability import Narrow, Passability, RouteClearance
from aquanav_tools.cli.cave_facts import cave_facts, is_built_cave
from aquanav_tools.errors import InputError

SQUEEZE = Narrow(np.array([5.0, 0.0, 0.0]), 4.0, 0.55, 0.34)
BESIDE = RouteClearance(0.21, 30.0, np.array([31.0, 0.0, 0.0]), 0.71, 0.5, 0.4)
SIZES = {"route_length": 40.0, "total_length": 60.0, "volume": 100.0, "num_portals": 1}


def written(folder: Path, **report: object) -> Path:
    (folder / "report.json").write_text(json.dumps(report))
    return folder


def test_the_numbers_are_those_of_the_report_each_under_one_name(tmp_path: Path) -> None:
    found = Passability(0.34, SQUEEZE, (SQUEEZE,), SQUEEZE.width, BESIDE)
    folder = written(tmp_path, statistics=SIZES, passability=found.facts(), has_north=True)
    assert is_built_cave(folder)
    rows = dict(cave_facts(folder))
    assert rows["largest vehicle"] == "0.55 m wide, at the narrowest place"
    assert rows["narrowest place"] == "0.55 m at 4.0 m: passable for the vehicle of 0.340 m"
    assert rows["narrow places"] == "1 below 0.68 m"
    assert rows["least clearance"] == "0.21 m at 30.0 m of the route, where the passage is 0.71 m wide"
    assert rows["north"] == "is y"


@pytest.mark.parametrize(
    ("report", "message"),
    [({"error": "The passage is too tight."}, "stopped: The passage is too tight"), ({"statistics": SIZES}, "again")],
)
def test_a_folder_without_these_numbers_says_why(tmp_path: Path, report: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        cave_facts(written(tmp_path, **report))


def test_a_vehicle_is_no_cave(tmp_path: Path) -> None:
    assert not is_built_cave(tmp_path)
    assert not is_built_cave(Path("bluerov2"))
