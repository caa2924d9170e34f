from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.disturbance import RayErrors
from aquanav_tools.sim.batch.sensors.fan import RangeFan, Sonar3D
from aquanav_tools.sim.batch.sensors.fan_spec import PRESET_FANS, FanSpec, RangeErrors, paper_fan
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.types import rotation_matrix, yaw_quaternion
from tests.sim.batch.sensors.rooms import distance_to_room, random_poses, room_batch

AHEAD = (1.0, 0.0, 0.0)


@pytest.mark.parametrize(("source", "tolerance"), [("mesh", 1e-5), ("field", 0.01)])
def test_distances_are_those_of_the_room_in_closed_form(
    source: str, tolerance: float, rng: np.random.Generator
) -> None:
    """The mesh's rays are in float32; the field's samples stand 0.1 m apart and round the room's edges off."""
    positions, turns = random_poses(rng, 50)
    fan = RangeFan(FanSpec(lengths=(9.0,), directions=tuple(map(tuple, rng.normal(size=(100, 3)).tolist()))))
    measured = fan.measure(room_batch(source, positions=positions, orientations=turns))
    ways = np.einsum("nij,rj->nri", [rotation_matrix(turn) for turn in turns], fan.pattern.directions)
    expected = np.minimum(distance_to_room(positions[:, None], ways), 9.0)
    assert np.quantile(np.abs(measured - expected), 0.99) < tolerance


def test_the_papers_fan_has_the_originals_rays() -> None:
    pattern, original = paper_fan().pattern, original_pattern()
    assert np.allclose(pattern.directions, original.directions, atol=1e-15)
    assert np.array_equal(pattern.lengths, original.lengths)


def test_azimuth_is_towards_left_and_elevation_up() -> None:
    pattern = FanSpec(lengths=(5.0,), azimuths_deg=(0.0, 90.0, 0.0), elevations_deg=(0.0, 0.0, 90.0)).pattern
    assert np.allclose(pattern.directions, np.eye(3), atol=1e-15)


def test_constant_errors_are_those_of_the_task_to_the_bit(rng: np.random.Generator) -> None:
    num = 40
    positions, turns = random_poses(rng, num)
    seeds, decisions = rng.integers(1 << 32, size=num), rng.integers(1000, size=num)
    batch = room_batch(positions=positions, orientations=turns, seeds=seeds, decisions=decisions)
    true = RangeFan(paper_fan()).measure(batch).copy()
    erring = RangeFan(paper_fan(RangeErrors(constant=0.05, dropout=0.1))).measure(batch)
    expected, _ = RayErrors(num, original_pattern().lengths, 0.05, 0.1).disturb(true, seeds, decisions)
    assert np.array_equal(erring, expected)
    assert not np.array_equal(erring, true)


def test_proportional_errors_grow_with_the_distance() -> None:
    num, distance = 20_000, 6.0
    fan = RangeFan(FanSpec((20.0,), (AHEAD,), noise=RangeErrors(constant=0.02, proportional=0.01)))
    measured = fan.measure(room_batch(positions=np.zeros((num, 3)), seeds=np.arange(num)))[:, 0]
    assert measured.std() == pytest.approx(0.02 + 0.01 * distance, rel=5 / np.sqrt(2 * num))  # 5 standard errors
    assert measured.mean() == pytest.approx(distance, abs=5 * 0.08 / np.sqrt(num))


@pytest.mark.parametrize("source", ["mesh", "field"])
@pytest.mark.parametrize("angle_deg", [20.0, 50.0, 80.0])
def test_echoes_are_lost_by_the_angle_to_the_wall(source: str, angle_deg: float) -> None:
    """Before the far wall, turned away from its normal by an angle."""
    num = 20_000
    errors = RangeErrors(dropout=0.1, grazing_dropout=0.8, grazing_from_deg=40.0)
    fan = RangeFan(FanSpec((30.0,), (AHEAD,), noise=errors))
    arrays = {
        "positions": np.tile([5.5, -3.5, 0.0], (num, 1)),
        "orientations": np.tile(yaw_quaternion(np.radians(angle_deg)), (num, 1)),
        "seeds": np.arange(num),
    }
    lost = (fan.measure(room_batch(source, **arrays))[:, 0] == 30.0).mean()
    expected = 0.1 + 0.9 * 0.8 * max(angle_deg - 40.0, 0.0) / 50.0
    assert lost == pytest.approx(expected, abs=5 * np.sqrt(0.25 / num))


@pytest.mark.parametrize("num_threads", [1, 2])
def test_a_vehicle_measures_alone_what_it_measures_among_many(num_threads: int, rng: np.random.Generator) -> None:
    num = 1024
    positions, turns = random_poses(rng, num)
    seeds, order = rng.integers(1 << 32, size=num), rng.permutation(num)
    errors = RangeErrors(constant=0.05, proportional=0.01, dropout=0.1, grazing_dropout=0.5)
    fan = RangeFan(paper_fan(errors))
    arrays = {"positions": positions, "orientations": turns, "seeds": seeds}
    together = fan.measure(room_batch("field", num_threads, order=order, **arrays)).copy()
    for n in (0, 511, 1023):
        alone = fan.measure(room_batch("field", **{name: array[n : n + 1] for name, array in arrays.items()}))
        assert np.array_equal(alone[0], together[n])


def test_only_vehicles_that_begin_anew_are_measured_where_only_they_are_asked_for() -> None:
    batch, fan = (
        room_batch(positions=np.zeros((2, 3)), restarted=np.array([0, 1])),
        RangeFan(FanSpec((20.0,), (AHEAD,))),
    )
    assert np.allclose(fan.measure(batch)[:, 0], 6.0)
    batch.state.positions.assign(np.ones((2, 3)))
    batch.only_restarted = True
    assert np.allclose(fan.measure(batch)[:, 0], [6.0, 5.0])


def test_a_fan_is_read_from_toml(tmp_path: Path) -> None:
    path = tmp_path / "fan.toml"
    path.write_text("lengths = [10]\nazimuths_deg = [-45, 0, 45]\n[noise]\nconstant = 0.1\n")
    fan = RangeFan(path)
    assert fan.data.noise.constant == 0.1
    assert np.allclose(fan.pattern.lengths, 10.0)
    path.write_text("lengths = [10]\nazimuth_deg = [-45, 0, 45]\n")
    with pytest.raises(InputError, match=r"unknown key 'azimuth_deg'. Did you mean 'azimuths_deg'"):
        RangeFan(path)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"lengths": (5.0,)}, "either directions or azimuths_deg"),
        ({"lengths": (5.0, 6.0), "azimuths_deg": (0.0, 1.0, 2.0)}, "fan of 3 rays has 2 lengths"),
        ({"lengths": (0.0,), "azimuths_deg": (0.0,)}, "must be above 0"),
        ({"lengths": (5.0,), "directions": ((0.0, 0.0, 0.0),)}, "must not be zero"),
        ({"lengths": (5.0,), "azimuths_deg": (float("nan"),)}, "finite"),
        ({"lengths": (5.0,), "azimuths_deg": (0.0,) * 5000}, "5000 rays; at most 4096"),
        ({"lengths": (5.0,), "azimuths_deg": (0.0,), "noise": {"dropout": 1.5}}, "dropout = 1.5"),
        ({"lengths": (5.0,), "azimuths_deg": (0.0,), "noise": {"grazing_from_deg": 90.0}}, "grazing_from_deg = 90"),
    ],
)
def test_a_senseless_fan_is_refused_with_what_is_wrong(table: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        RangeFan(table)


def test_an_unknown_fan_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="no data sheet 'papr' for the sensor 'fan'"):
        RangeFan("papr")


def test_a_reading_stands_until_the_period_is_over_and_none_outlives_its_episode() -> None:
    fan = RangeFan(FanSpec((20.0,), (AHEAD,), period=0.2))  # two decisions
    batch = room_batch(positions=np.zeros((2, 3)), decisions=np.array([4, 7]))
    fan.measure(batch)
    read = []
    for x, decisions, restarted in ((1.0, [5, 8], [0, 0]), (2.0, [6, 0], [0, 1]), (3.0, [7, 1], [0, 0])):
        batch.state.positions.assign(np.tile([x, 0.0, 0.0], (2, 1)))
        batch.state.decisions.assign(np.array(decisions, dtype=np.int32))
        batch.state.restarted.assign(np.array(restarted, dtype=np.int32))
        read.append(fan.measure(batch)[:, 0].copy())
    # The wall ahead is 6 m from the middle; the second vehicle was first read at 1 m, its next episode begins at 2 m.
    np.testing.assert_allclose(read, [[6.0, 5.0], [4.0, 4.0], [4.0, 4.0]], atol=1e-5)
    kept = fan.state()
    batch.state.decisions.assign(np.array([8, 2], dtype=np.int32))
    fan.measure(batch)
    fan.restore(kept)
    batch.state.decisions.assign(np.array([9, 3], dtype=np.int32))
    np.testing.assert_allclose(fan.measure(batch)[:, 0], [4.0, 4.0], atol=1e-5)


def test_the_3d_sonars_look_ahead_within_their_angles_five_times_a_second() -> None:
    spec = PRESET_FANS["sonar3d"]
    x, y, z = spec.pattern.directions.T
    assert len(x) == 117 and spec.period == 0.2
    assert np.degrees(np.abs(np.arctan2(y, x)).max()) == pytest.approx(45.0)
    assert np.degrees(np.abs(np.arcsin(z)).max()) == pytest.approx(40.0)
    order, signs = Sonar3D().mirror_image()
    assert (signs == 1.0).all()
    np.testing.assert_allclose(spec.pattern.directions[order], spec.pattern.directions * [1.0, -1.0, 1.0], atol=1e-12)


def test_a_period_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match=r"period -1\.0 s, which must be from 0 to 100"):
        RangeFan({"lengths": [4.0], "azimuths_deg": [0.0], "period": -1.0})
