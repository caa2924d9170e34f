"""Start poses from strangers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from aquanav_tools.errors import ScenarioError
from aquanav_tools.scenario.geometry import read_starts, write_starts
from tests.caves import tube_scenario


@pytest.mark.parametrize("orientation", [[0.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [1e200, 1e200, 0.0, 0.0]])
def test_a_start_whose_orientation_turns_nothing_is_refused(orientation: list[float], tmp_path: Path) -> None:
    path = tmp_path / "starts.json"
    write_starts(tube_scenario().starts, path)
    assert len(read_starts(path)) == 20
    table = json.loads(path.read_text())
    table["starts"][3]["orientation"] = orientation
    path.write_text(json.dumps(table))
    with pytest.raises(ScenarioError, match=r"an orientation has length \S+, not 1"):
        read_starts(path)
