"""What a vehicle reckons of its track is what the simulated sensor reads."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import tomllib

from aquanav_tools.deploy import Track
from aquanav_tools.deploy.track import DISTANCES, SPACING
from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors import track as simulated
from aquanav_tools.types import rotation_matrix
from tests.conftest import REPOSITORY
from tests.sim.batch.sensors.rooms import room_batch
from tests.sim.batch.sensors.test_inertial import at

SHEET = REPOSITORY / "aquanav_tools" / "sim" / "batch" / "sensors" / "sheets" / "track-a50.toml"


def test_it_reads_what_the_sensor_reads_on_a_way_that_winds_and_tilts(rng: np.random.Generator) -> None:
    """40 m of a random walk, begun with the nose down; the sensor without its errors."""
    num = 400
    turns = np.cumsum(rng.normal(0.0, 0.2, num))
    tilts = np.clip(np.cumsum(rng.normal(0.0, 0.05, num)) - 0.3, -1.0, 1.0)
    ahead = np.stack([np.cos(tilts) * np.cos(turns), np.cos(tilts) * np.sin(turns), np.sin(tilts)], axis=1)
    positions = [5.0, -2.0, 1.0] + np.cumsum(0.1 * rng.uniform(0.2, 1.6, num)[:, None] * ahead, axis=0)
    batch = room_batch(positions=positions[:1])
    sensor, track = simulated.Track({"distances": list(DISTANCES)}), Track()
    for decision in range(num):
        c, s = np.cos(turns[decision] / 2), np.sin(turns[decision] / 2)
        p, q = np.cos(tilts[decision] / 2), -np.sin(tilts[decision] / 2)  # about the left, up is negative
        orientation = np.array([[c * p, -s * q, c * q, s * p]])  # turned by the heading, then tilted
        now = at(batch, decision, positions=positions[decision : decision + 1], orientations=orientation)
        bow = rotation_matrix(orientation[0])[:, 0]
        found = track(positions[decision], float(np.arctan2(bow[1], bow[0])), float(bow[2]))
        np.testing.assert_allclose(found, sensor.measure(now)[0], atol=2e-5)
    assert np.linalg.norm(np.diff(positions, axis=0), axis=1).sum() > max(DISTANCES)


def test_a_dive_that_begins_knows_nothing_of_the_one_before() -> None:
    track = Track((1.0, 4.0))
    first = track([0.0, 0.0, 0.0], 0.5)
    assert np.allclose(first, [-1.0, 0.0, 0.0, -4.0, 0.0, 0.0])
    for step in range(30):
        track([0.0, 0.1 * step, 0.0], 0.5)
    track.reset()
    assert np.allclose(track([7.0, 3.0, 1.0], -2.0), first)


def test_figures_that_it_is_made_for_are_the_sheets_and_the_sensors() -> None:
    assert tuple(tomllib.loads(SHEET.read_text(encoding="utf-8"))["distances"]) == DISTANCES
    assert float(simulated.SPACING) == SPACING
    assert "distances" in {field.name for field in dataclasses.fields(simulated.TrackSheet)}


@pytest.mark.parametrize("reading", [([0.0, 0.0], 0.0), ([0.0, np.nan, 0.0], 0.0), ([0.0, 0.0, 0.0], np.inf)])
def test_what_is_no_place_is_refused(reading: tuple[list[float], float]) -> None:
    with pytest.raises(InputError, match="3 finite coordinates and finite angles"):
        Track()(*reading)
