"""Vehicles in a cave that was built for another one. The tube is 4 m wide, and its starts lie from x = 1.5 m on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import aquanav_tools.envs  # noqa: F401  # registers the environments
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.factory import with_vehicle
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.envs.vehicles import dived_by, vehicle_of
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.bay import read_bay
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_scenario
from tests.vehicles import write_vehicle

MAKERS: dict[str, Callable[..., Any]] = {
    "one": CaveEnv,
    "gymnasium": lambda tube, **options: gymnasium.make("aquanav/Cave-v0", scenario=tube, **options),
    "batch": lambda tube, **options: CaveBatch(tube, 2, next_step=True, **options),
    "vector": lambda tube, **options: gymnasium.make_vec(
        "aquanav/Cave-v0", num_envs=2, vectorization_mode="vector_entry_point", scenario=tube, **options
    ),
    "sb3": lambda tube, **options: BatchedVecEnv(tube, 2, **options),
}


@pytest.mark.parametrize("maker", MAKERS)
def test_a_boat_is_refused_in_a_tube_with_both_sizes(maker: str) -> None:
    # 1.545 m of radius at starts 0.5 m beside the middle of a tube of 2 m.
    with pytest.raises(InputError, match=r"boat \(9.40 m long, 3.09 m wide\) cannot begin in tube: at each of its 20"):
        MAKERS[maker](tube_scenario(), vehicle="boat")


def test_a_hull_wider_than_the_passage_is_told_how_wide_that_is(tmp_path: Path) -> None:
    wide = write_vehicle(tmp_path / "wide.toml", 2.2, 4.5)
    told = (
        r"wide \(4.50 m long, 4.40 m wide\) finds no way to the goal of tube, .* is 4.00 m wide where it is narrowest"
    )
    with pytest.raises(InputError, match=told):
        CaveEnv(tube_scenario(), vehicle=wide)


def test_starts_at_which_a_long_hull_touches_are_left_out(tmp_path: Path) -> None:
    long = write_vehicle(tmp_path / "long.toml", 0.2, 5.0)
    with pytest.warns(UserWarning, match="4 of the 20 starts of tube are left out: the hull of long would touch"):
        env = CaveEnv(tube_scenario(), vehicle=long)
    begun = [env.reset(seed=seed)[1]["position"] for seed in range(40)]
    assert min(position[0] for position in begun) >= 2.5  # half its length from the lid at x = 0
    assert len({position[0] for position in begun}) == 8
    assert env.num_starts == 16


def test_what_is_left_out_is_numbered_as_in_the_files(tmp_path: Path) -> None:
    tube = tube_scenario()
    fitted = dived_by(tube, write_vehicle(tmp_path / "long.toml", 0.2, 5.0))
    assert fitted.other_vehicle is not None
    assert fitted.other_vehicle.left_out == (0, 1, 2, 3)  # at x = 1.5 and 2.22 m, two each
    assert vehicle_of(fitted).name == fitted.settings.vehicle == "long"
    assert dived_by(tube, tmp_path / "long.toml") is fitted  # environments share it


def test_ways_are_those_of_the_wider_hull(tmp_path: Path) -> None:
    fitted = dived_by(tube_scenario(), write_vehicle(tmp_path / "wide.toml", 0.9, 2.0))
    for start in fitted.starts:
        assert start.geodesic_to_goal == pytest.approx(TUBE_LENGTH - 1.0 - start.pose.position[0], rel=0.02)
        assert TUBE_RADIUS - abs(start.pose.position[1]) > 0.9


def test_smaller_hulls_and_the_own_vehicle_change_nothing(tmp_path: Path) -> None:
    tube = tube_scenario()
    assert CaveEnv(tube).scenario is tube
    assert CaveEnv(tube, vehicle=write_vehicle(tmp_path / "small.toml", 0.1, 0.3)).scenario is tube
    assert dived_by(tube, "bluerov2") is tube


def test_the_same_vehicle_in_single_and_batched_environments_begins_at_the_same_starts(tmp_path: Path) -> None:
    long = write_vehicle(tmp_path / "long.toml", 0.2, 5.0)
    tube = tube_scenario()
    with pytest.warns(UserWarning, match="left out"):
        batch = CaveBatch(tube, 16, next_step=True, vehicle=long)
    batch.reset(range(16), list(range(16)))
    env = CaveEnv(tube, vehicle=long)
    for number, position in enumerate(batch.copy_of("positions")):
        assert np.allclose(env.reset(options={"start": number})[1]["position"], position)
    batch.close()


def test_a_misspelt_vehicle_gets_the_nearest_name() -> None:
    with pytest.raises(InputError, match="Did you mean 'bluerov2-heavy'"):
        with_vehicle(tube_scenario(), "bluerov-heavy")


def test_bays_take_boats_and_no_divers() -> None:
    bay = read_bay("bay-calm")
    assert with_vehicle(bay, "otter") is bay
    other = with_vehicle(bay, "boat")
    assert other.other_vehicle is not None and other.other_vehicle.name == "boat"
    with pytest.raises(InputError, match="There is no boat 'bluerov2'"):
        with_vehicle(bay, "bluerov2")
