"""What tests of evaluations share."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "tube"
    write_scenario(tube, path)
    return path
