from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest

from aquanav_tools.evaluate.energy import drag_power
from aquanav_tools.evaluate.metrics import EpisodeMetrics, EpisodeReference, measure, region_of, spl
from aquanav_tools.evaluate.summary import group, summarise
from aquanav_tools.sim.randomisation import varied_body
from aquanav_tools.sim.vehicle import load_vehicle
from tests.report.trajectories import straight_trajectory
from tests.sim.bodies import at_rest, run

POWER = partial(drag_power, load_vehicle("bluerov2"))
WIDTH = 2.0 * load_vehicle("bluerov2").capsule.radius
REFERENCE = EpisodeReference("tube", "as given", WIDTH, route_length=18.0, top_speed=1.0, power=POWER)


def episode(**overrides: object) -> EpisodeMetrics:
    values = {"digest": str(overrides), **overrides}
    return dataclasses.replace(measure(straight_trajectory(), 18.0, REFERENCE), **values)  # type: ignore[arg-type]


def test_metrics_of_a_straight_episode_are_those_computed_by_hand() -> None:
    result = measure(straight_trajectory(100), 9.0, REFERENCE)
    assert result.time == pytest.approx(10.0)
    assert result.path_length == pytest.approx(18.0)
    assert result.progress == pytest.approx(18.0)
    assert (result.min_clearance, result.clearance_p5, result.mean_clearance) == pytest.approx((0.5, 0.525, 0.75))
    assert (result.reward, result.cost, result.collisions) == pytest.approx((50.0, 3.0, 1))
    assert result.spl == pytest.approx(0.5)
    assert result.time_ratio == pytest.approx(10.0 / 9.0)
    assert result.time_close == 0.0  # never below 0.34 m, the vehicle's width
    assert (result.control_effort, result.control_change) == pytest.approx((1 / 3, 0.0))
    assert result.jerk == pytest.approx(0.0, abs=1e-9)


def test_energy_at_constant_speed_is_drag_times_way() -> None:
    speed, way = 1.8, 18.0
    drag = 4.03 * speed + 18.18 * speed**2  # the BlueROV2's surge damping, N
    assert measure(straight_trajectory(), 18.0, REFERENCE).energy == pytest.approx(drag * way)


def test_energy_goes_by_the_damping_that_the_episode_drew() -> None:
    speed, way, drawn = 1.8, 18.0, {"linear_damping": 0.5, "quadratic_damping": 0.7, "mass": 1.2}
    trajectory = dataclasses.replace(straight_trajectory(), dynamics=drawn)
    drag = 0.5 * 4.03 * speed + 0.7 * 18.18 * speed**2
    assert measure(trajectory, 18.0, REFERENCE).energy == pytest.approx(drag * way)
    original, velocity = load_vehicle("original-auv"), np.array([[1.8, 0.0, 0.0, 0.0, 0.0, 0.0]])
    lost = drag_power(original, velocity, {"linear_damping": 0.5}) / drag_power(original, velocity, {})
    assert lost == pytest.approx(0.5)


def test_the_power_of_drag_is_what_the_kernels_take_from_the_kinetic_energy(rng: np.random.Generator) -> None:
    vehicle, drawn = load_vehicle("bluerov2"), {"linear_damping": 0.6, "quadratic_damping": 0.8}
    draws = {name: np.array([value]) for name, value in drawn.items()}
    free = {"net_weight": 0.0, "arm": np.zeros(3)}
    parameters = dataclasses.replace(varied_body(vehicle, 1000.0, draws, 1), **free)
    state, dt = at_rest(), 1e-5
    state[7:10] = rng.uniform(-1.0, 1.0, 3)  # no turning, which its autopilot damps as well
    slower = run(state, 1, parameters, dt=dt)
    mass = parameters.mass[0]
    before, after = (0.5 * velocity @ mass @ velocity for velocity in (state[7:], slower[7:]))
    # In a step of 10 us drag takes about 1e-5 of the speed, so its power changes by as little.
    assert (before - after) / dt == pytest.approx(drag_power(vehicle, state[None, 7:], drawn)[0], rel=1e-4)


def test_drifting_with_the_water_costs_no_energy() -> None:
    trajectory = straight_trajectory()
    drifting = dataclasses.replace(trajectory, currents=np.tile([1.8, 0.0, 0.0], (101, 1)))
    assert measure(drifting, 18.0, REFERENCE).energy == pytest.approx(0.0, abs=1e-9)


def test_velocity_that_grows_by_the_square_of_time_has_constant_jerk() -> None:
    trajectory = straight_trajectory()
    velocities = np.zeros((101, 6))
    velocities[:, 1] = 0.5 * 0.7 * trajectory.times**2
    assert measure(dataclasses.replace(trajectory, velocities=velocities), 18.0, REFERENCE).jerk == pytest.approx(0.7)


def test_time_below_the_vehicles_width_is_counted_in_seconds() -> None:
    clearances = np.where(np.arange(101) <= 30, 0.33, 0.35)
    assert measure(straight_trajectory(clearances=clearances), 18.0, REFERENCE).time_close == pytest.approx(3.0)


def test_spl_of_three_episodes_is_the_one_computed_by_hand() -> None:
    values = [spl(True, 10.0, 12.5), spl(False, 10.0, 10.0), spl(True, 8.0, 8.0)]
    assert values == pytest.approx([0.8, 0.0, 1.0])
    summary = summarise([episode(spl=value) for value in values])
    assert summary.means["spl"].mean == pytest.approx(0.6)
    assert spl(True, 10.0, 9.5) == 1.0  # the goal's tolerance can save half a metre


def test_region_is_the_third_of_the_route_that_the_start_lies_in() -> None:
    assert [region_of(way, 9.0) for way in (9.5, 7.0, 5.0, 1.0)] == [
        "first third", "first third", "middle third", "last third",
    ]  # fmt: skip


def test_one_contact_spoils_collision_free_success_but_not_success() -> None:
    summary = summarise(
        [episode(collisions=0), episode(collisions=1), episode(outcome="timeout", collisions=0, spl=0.0)]
    )
    assert summary.success.rate == pytest.approx(2 / 3)
    assert summary.collision_free_success.rate == pytest.approx(1 / 3)
    assert summary.outcomes == {"success": 2, "collision": 0, "timeout": 1, "failed": 0}
    assert summary.collisions_per_100m.mean == pytest.approx(100.0 * 1 / (3 * 18.0))


def test_episode_that_repeats_to_the_bit_counts_once() -> None:
    summary = summarise([episode(digest="a"), episode(digest="a"), episode(digest="b", outcome="timeout")])
    assert (summary.episodes, summary.distinct_episodes) == (3, 2)
    assert summary.success.rate == 0.5


def test_groups_hold_the_episodes_of_their_name() -> None:
    groups = group([episode(condition="calm", seed=1), episode(condition="rough", outcome="timeout", seed=2)])
    rates = {part.name: part.summary.success.rate for part in groups if part.by == "condition"}
    assert rates == {"calm": 1.0, "rough": 0.0}


def test_a_boats_effort_is_that_of_its_two_controls() -> None:
    boat = dataclasses.replace(REFERENCE, num_controls=2)
    assert measure(straight_trajectory(100), 9.0, boat).control_effort == pytest.approx(1 / 2)  # full thrust, no steer
