"""Drawn caves made larger or smaller, as far as the vehicle fits."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.starting import MARGIN
from aquanav_tools.envs.vehicles import vehicle_of
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.scaling import scaled
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.train.cave_supply import CaveSequence
from aquanav_tools.train.scaled_caves import NARROWEST, scaled_to_fit
from tests.caves import TUBE_RADIUS, tube_scenario
from tests.train.runs import assert_stopped_run_ends_alike, tiny_pipeline
from tests.train.test_drawn_caves import MIXED, ON_BATCH, stub


def test_a_cave_gets_no_smaller_than_its_vehicle_fits_through() -> None:
    tube = tube_scenario()
    radius = vehicle_of(tube).capsule.radius
    tightest = NARROWEST * radius / TUBE_RADIUS
    small = scaled_to_fit(tube, 0.8 * tightest)
    factor = small.guide.length / tube.guide.length
    assert factor == pytest.approx((0.8 * tightest) ** 0.5)  # the first of the factors nearer to 1
    assert factor * TUBE_RADIUS > NARROWEST * radius
    half = scaled_to_fit(tube, 0.5)
    assert half.guide.length == pytest.approx(0.5 * tube.guide.length)
    assert len(half.starts) == len(tube.starts)


def test_starts_at_which_the_hull_would_touch_are_left_out() -> None:
    tube = tube_scenario()
    # At half the size the wall stands 1 m off the axis; a start 0.47 m from it has no room for a hull of 0.17 m.
    pose = tube.starts[0].pose
    beside = dataclasses.replace(pose, position=pose.position * [1.0, 0.0, 0.0] + [0.0, 1.7, 0.0])
    starts = (dataclasses.replace(tube.starts[0], pose=beside), *tube.starts[1:])
    half = scaled_to_fit(dataclasses.replace(tube, starts=starts), 0.5)
    assert len(half.starts) == len(tube.starts) - 1
    batch = CaveBatch(half, 1, next_step=False, current="still")
    batch.close()


def test_a_cave_keeps_room_to_begin_anywhere() -> None:
    """Starts on the axis of a tube of 0.23 m have 6 cm of room, but none anywhere has the 10 cm that are asked for."""
    tube, factor = tube_scenario(), 0.23 / TUBE_RADIUS
    capsule = vehicle_of(tube).capsule
    assert NARROWEST * capsule.radius < factor * TUBE_RADIUS < capsule.radius + MARGIN
    small = scaled_to_fit(tube, factor)
    assert small.guide.length / tube.guide.length == pytest.approx(factor**0.5)
    batch = CaveBatch(small, 2, next_step=False, current="still", starts="anywhere")
    batch.close()


def test_a_cave_that_is_too_tight_for_another_vehicle_is_dived_by_it_once_it_is_larger() -> None:
    tight = scaled(tube_scenario(), 0.12)
    hull = load_vehicle("original-auv").capsule
    assert 0.12 * TUBE_RADIUS < hull.radius < 0.48 * TUBE_RADIUS
    roomy = scaled_to_fit(tight, 4.0, "original-auv")
    assert vehicle_of(roomy).capsule == hull
    assert len(roomy.starts) == len(tight.starts)
    with pytest.raises(InputError, match="original-auv"):
        scaled_to_fit(tight, 1.1, "original-auv")


def test_factors_are_drawn_from_the_range_and_depend_on_seed_and_number_alone() -> None:
    sequence = CaveSequence(("mixed",), 3, None, (0.5, 2.0))
    factors = [sequence.scale(number) for number in range(500)]
    assert min(factors) > 0.5 and max(factors) < 2.0
    assert sum(factor < 1.0 for factor in factors) == pytest.approx(250, abs=45)  # four standard deviations
    assert factors[:9] == [CaveSequence(("maze",), 3, None, (0.5, 2.0)).scale(number) for number in range(9)]


def test_a_stopped_run_ends_as_one_that_never_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stub(monkeypatch, tmp_path / "caves")
    pipeline = tiny_pipeline(
        Path(MIXED), 1, ON_BATCH, num_caves=2, new_cave_every=48, steps=384, cave_scales=(0.5, 1.5), current="half"
    )
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch, 2)


def test_scales_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match=r"cave_scales must rise and lie between 0.1 and 10, and they are 1.5, 0.5"):
        tiny_pipeline(Path(MIXED), 1, ON_BATCH, cave_scales=(1.5, 0.5))
