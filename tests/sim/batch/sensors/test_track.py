from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors.base import SensorBatch
from aquanav_tools.sim.batch.sensors.track import Track
from aquanav_tools.types import yaw_quaternion
from tests.sim.batch.sensors.rooms import SECONDS, room_batch
from tests.sim.batch.sensors.test_inertial import at

STEP = 0.1
"""Of a vehicle in a decision, m."""
PERFECT = {"distances": [1.0, 4.0]}


def swim(track: Track, batch: SensorBatch, path: np.ndarray, headings: np.ndarray | None = None) -> np.ndarray:
    """Take vehicles along paths, (T, N, 3), and return the last readings, (N, D, 3)."""
    read: Any = None
    for decision, positions in enumerate(path):
        arrays = {"positions": positions}
        if headings is not None:
            arrays["orientations"] = np.array([yaw_quaternion(angle) for angle in headings[decision]])
        read = track.measure(at(batch, decision, **arrays))
    return np.asarray(read).reshape(path.shape[1], -1, 3).copy()


def line(direction: list[float], length: float) -> np.ndarray:
    """Return (T, 1, 3) positions STEP apart."""
    way = np.arange(0.0, length + 1e-9, STEP)
    return way[:, None, None] * np.array(direction)


def test_a_straight_way_lies_behind() -> None:
    read = swim(Track(PERFECT), room_batch(positions=np.zeros((1, 3))), line([1.0, 0.0, 0.0], 6.0))
    # Points of the track are up to a spacing, 0.25 m, old.
    assert np.allclose(read[0], [[-1.0, 0.0, 0.0], [-4.0, 0.0, 0.0]], atol=0.35)
    assert (read[0, :, 0] <= -PERFECT["distances"][0]).all()


def test_before_it_began_the_track_lies_straight_astern() -> None:
    read = swim(Track(PERFECT), room_batch(positions=np.zeros((1, 3))), line([0.6, 0.0, -0.8], 2.0))
    # Of 4 m, 2 were swum, and 2 lie behind where the bow pointed along x.
    assert np.allclose(read[0, 1], [-1.2 - 2.0, 0.0, 1.6], atol=1e-5)


def test_who_stays_where_it_is_differs_from_who_begins() -> None:
    read = swim(Track(PERFECT), room_batch(positions=np.zeros((1, 3))), np.zeros((1, 1, 3)))
    assert np.allclose(read[0], [[-1.0, 0.0, 0.0], [-4.0, 0.0, 0.0]], atol=1e-6)
    angles = np.linspace(0.0, 8.0 * np.pi, 161)
    path = 0.15 * np.stack([np.cos(angles), np.sin(angles), np.zeros(161)], axis=1)[:, None]
    staying = swim(Track({"distances": [1.0, 2.0]}), room_batch(positions=path[0]), path)
    assert (np.linalg.norm(staying[0], axis=1) < 0.5).all()


def test_axes_are_level_and_by_the_heading() -> None:
    path = line([1.0, 0.0, 0.0], 2.0)
    headings = np.full((len(path), 1), 0.5 * np.pi)  # it looks to the left of where it moves
    read = swim(Track(PERFECT), room_batch(positions=np.zeros((1, 3))), path, headings)
    # In 2 m it came along x, which is to its right; before that from where it looked, which is astern.
    assert np.allclose(read[0, 1], [-2.0, 2.0, 0.0], atol=1e-5)
    nose_down = [np.cos(0.5), 0.0, np.sin(0.5), 0.0]  # turned by 1 rad about the left
    track, batch = Track(PERFECT), room_batch(positions=np.zeros((1, 3)), orientations=[nose_down])
    before = 2.0 * np.array([-np.cos(1.0), 0.0, np.sin(1.0)])
    assert np.allclose(swim(track, batch, path)[0, 1], before - [2.0, 0.0, 0.0], atol=1e-5)


def test_a_circle_leads_back_to_where_it_was() -> None:
    """After the whole of a circle with a circumference of 4 m, the point 4 m back is here, that 1 m back is not."""
    angles = np.linspace(0.0, 2.0 * np.pi, 41)
    radius = 4.0 / (2.0 * np.pi)
    path = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(41)], axis=1)[:, None]
    read = swim(Track(PERFECT), room_batch(positions=path[0]), path)
    assert np.linalg.norm(read[0, 1]) < 0.05
    assert np.linalg.norm(read[0, 0]) == pytest.approx(2.0 * radius * np.sin(np.pi / 4.0), abs=0.3)


def test_measuring_twice_changes_nothing_and_an_episodes_beginning_forgets() -> None:
    track, batch = Track("a50"), room_batch(positions=np.zeros((2, 3)), seeds=np.arange(2))
    path = line([1.0, 0.0, 0.0], 3.0).repeat(2, axis=1)
    read = swim(track, batch, path)
    assert np.array_equal(track.measure(batch).reshape(read.shape), read)
    begun = track.measure(at(batch, 0, positions=np.ones((2, 3))))
    assert np.allclose(begun.reshape(2, -1, 3)[..., 1:], 0.0)
    assert np.array_equal(swim(track, batch, path), read)


def test_what_it_remembers_can_be_kept_and_restored() -> None:
    track, batch = Track(PERFECT), room_batch(positions=np.zeros((1, 3)))
    swim(track, batch, line([1.0, 0.0, 0.0], 2.0))
    kept = track.state()
    after = track.measure(at(batch, 21, positions=[[2.1, 0.0, 0.0]])).copy()
    swim(track, batch, line([0.0, 1.0, 0.0], 3.0))
    track.restore(kept)
    assert np.array_equal(track.measure(at(batch, 21, positions=[[2.1, 0.0, 0.0]])), after)


def test_errors_have_the_sheets_sizes() -> None:
    num, length, turned = 4000, 10.0, np.radians(3.0)
    seconds = round(length / STEP) * SECONDS
    path = line([0.0, 1.0, 0.0], length).repeat(num, axis=1)  # to the left: what lies before it, astern, is exact
    batch = room_batch(positions=path[0], seeds=np.arange(num))
    by_scale = swim(Track({"distances": [20.0], "scale_error": 0.02}), batch, path)[:, 0]
    assert by_scale[:, 1].std() == pytest.approx(0.02 * length, rel=5 / np.sqrt(2 * num))
    drift = float(np.degrees(turned) / (seconds / 60.0))
    drifting = swim(Track({"distances": [20.0], "heading_drift_deg_per_min": drift}), batch, path)[:, 0]
    # The heading is off by `turned` in the end and by half of it on the mean; so the way seems to come from elsewhere.
    assert drifting[:, 0].std() == pytest.approx(0.5 * turned * length, rel=0.06)


def test_a_senseless_sheet_is_refused() -> None:
    with pytest.raises(InputError, match="The track has no distances"):
        Track({"distances": []})
    with pytest.raises(InputError, match=r"distances = 0.1, which must be from 0.25 to 200"):
        Track({"distances": [0.1]})
    with pytest.raises(InputError, match=r"no data sheet 'a5' for the sensor 'track'. Did you mean 'a50'"):
        Track("a5")
