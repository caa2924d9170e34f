from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors.depth import DepthCell
from tests.sim.batch.sensors.rooms import room_batch

ENTRANCE = 1.0
"""Height of the room's."""


def test_depth_counts_from_the_entrance_in_steps_of_the_resolution() -> None:
    positions = np.array([[0.0, 0.0, -1.234], [0.0, 0.0, 2.0]])
    assert np.allclose(DepthCell({"full_scale": 10.0}).measure(room_batch(positions=positions))[:, 0], [2.234, -1.0])
    coarse = DepthCell({"full_scale": 10.0, "resolution": 0.05})
    assert np.allclose(coarse.measure(room_batch(positions=positions))[:, 0], [2.25, -1.0])


def test_readings_end_at_full_scale() -> None:
    cell = DepthCell({"full_scale": 2.0})
    read = cell.measure(room_batch(positions=[[0.0, 0.0, -2.5]]))
    assert read[0, 0] == 2.0
    assert cell.spec(None, None).contains(read[0])  # type: ignore[arg-type]  # it needs neither


def test_errors_have_the_sheets_sizes_and_a_devices_own_stay() -> None:
    num, depth = 20_000, 3.0
    batch = room_batch(positions=np.tile([0.0, 0.0, ENTRANCE - depth], (num, 1)), seeds=np.arange(num))
    device = DepthCell({"full_scale": 100.0, "scale_error": 0.01, "bias": 0.02})
    first = device.measure(batch).copy()
    assert first.std() == pytest.approx(np.hypot(0.01 * depth, 0.02), rel=5 / np.sqrt(2 * num))
    noisy = DepthCell({"full_scale": 100.0, "noise": 0.05})
    before = noisy.measure(batch).copy()
    batch.state.decisions.fill_(1)
    assert np.array_equal(device.measure(batch), first)
    change = noisy.measure(batch) - before
    assert change.std() == pytest.approx(np.sqrt(2.0) * 0.05, rel=5 / np.sqrt(2 * num))


def test_a_negative_figure_is_refused() -> None:
    assert DepthCell("ms5837-30ba").data.resolution == 0.002
    with pytest.raises(InputError, match=r"noise = -0.1, which must be from 0 to 10"):
        DepthCell({"full_scale": 10.0, "noise": -0.1})
