"""The script that says how often the waypoint is right: where the oracle dives through a straight tube, it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eval import waypoint_agreement
from tests.train.runs import tiny_tube


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "tube")


def test_along_a_straight_tube_waypoint_and_goal_lie_ahead(tube: Path) -> None:
    both = waypoint_agreement.cosines(str(tube), 2, "still")
    assert len(both) > 20 and np.median(both[:, 1]) > 0.95
    assert (both[:, 0] > 0.5).mean() > 0.9


def test_dives_that_do_not_arrive_are_no_measure(tube: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waypoint_agreement, "MOST_DECISIONS", 3)
    with pytest.raises(SystemExit, match="None of 2 dives of the oracle"):
        waypoint_agreement.cosines(str(tube), 2, "still")
