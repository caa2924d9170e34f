from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.envs.observation import layout, observation_space
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, rotation_matrix
from tests.sim.batch.worlds import look_from, make_world

ENTRANCE = np.array([0.0, 0.0, 4.0])


def observe(
    tube: Scenario, state: Array, goal: Array, level: float = 0.0, command: tuple[float, ...] = (0, 0, 0)
) -> dict[str, Array]:
    world = make_world(tube, load_vehicle("bluerov2"), 1, goal=goal, entrance=ENTRANCE)
    world.as_numpy("levels")[:], world.as_numpy("commands")[:] = level, command
    (obs,) = look_from(world, state[None])
    assert observation_space("full").contains(obs)
    return {name: obs[part].astype(np.float64) for name, part in layout("full").items()}


def state_at(position: Array, quaternion: Array, velocity: Array | None = None) -> Array:
    return np.concatenate([position, quaternion, np.zeros(6) if velocity is None else velocity])


def yaw_then_pitch(yaw: float, pitch: float) -> Array:
    """Quaternion of Rz(yaw) Ry(pitch); a positive pitch points the nose down."""
    a, b, c, d = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    return np.array([a * c, -b * d, a * d, b * c])


def test_paper_has_31_values_and_full_begins_with_them() -> None:
    assert max(part.stop for part in layout("paper").values()) == 31
    assert list(layout("full").items())[:2] == list(layout("paper").items())


def test_slices_of_the_layout_cover_the_observation_once() -> None:
    stops = [0, *(part.stop for part in layout("full").values())]
    assert [part.start for part in layout("full").values()] == stops[:-1]
    assert stops[-1] == observation_space("full").shape[0]


def test_rays_read_as_fractions_of_their_lengths(tube: Scenario) -> None:
    obs = observe(tube, state_at(np.array([10.0, 0, 0]), yaw_then_pitch(0, 0)), np.ones(3))
    assert obs["rays"][0] == 1.0  # 3.9 m ahead, and 14.9 degrees up, in a tube of radius 2 m
    sideways = 2.0 / np.cos(np.arctan2(4.0, 15.0)) / original_pattern().lengths[7:9]  # right and left, of the first fan
    assert obs["rays"][7:9] == pytest.approx(np.minimum(sideways, 1.0), abs=0.03)


@pytest.mark.parametrize("pitch", [0.0, 0.4])
def test_goal_is_given_relative_to_the_horizontal_heading(
    tube: Scenario, rng: np.random.Generator, pitch: float
) -> None:
    for _ in range(10):
        yaw, azimuth, elevation = rng.uniform(-3.1, 3.1), rng.uniform(-3.1, 3.1), rng.uniform(-1.5, 1.5)
        distance, position = rng.uniform(0.5, 100), rng.normal(size=3)
        bearing = yaw + azimuth
        way = [np.cos(elevation) * np.cos(bearing), np.cos(elevation) * np.sin(bearing), np.sin(elevation)]
        goal = position + distance * np.array(way)
        seen = observe(tube, state_at(position, yaw_then_pitch(yaw, pitch)), goal)["goal"]
        np.testing.assert_allclose(
            seen, [distance / (distance + 10), azimuth / np.pi, elevation / (np.pi / 2)], atol=1e-6
        )


def test_goal_to_the_left_reads_positive(tube: Scenario) -> None:
    seen = observe(tube, state_at(np.zeros(3), yaw_then_pitch(0, 0)), np.array([0.0, 5.0, 0.0]))["goal"]
    assert seen[1] == pytest.approx(0.5)


def test_tilt_is_the_sine_of_how_far_nose_and_left_side_point_up(tube: Scenario) -> None:
    quaternion = yaw_then_pitch(1.0, -0.3)  # nose up
    seen = observe(tube, state_at(np.zeros(3), quaternion), np.ones(3))["tilt"]
    np.testing.assert_allclose(seen, rotation_matrix(quaternion)[2, :2], atol=1e-7)
    assert seen[0] == pytest.approx(np.sin(0.3))


def test_motion_and_controls_are_passed_on_scaled(tube: Scenario) -> None:
    velocity = np.array([1.0, -0.5, 0.2, 0.1, -0.2, 1.5])
    state = state_at(np.zeros(3), yaw_then_pitch(2.0, 0.1), velocity)
    seen = observe(tube, state, np.ones(3), level=-0.4, command=(1.0, 0.0, -1.0))
    np.testing.assert_allclose(seen["velocity"], velocity[:3] / (1 + abs(velocity[:3])), atol=1e-7)
    np.testing.assert_allclose(seen["rates"], velocity[3:] / (np.pi / 2 + abs(velocity[3:])), atol=1e-7)
    np.testing.assert_allclose(seen["trim"], -0.4, atol=1e-7)
    np.testing.assert_array_equal(seen["command"], [1, 0, -1])


def test_depth_counts_from_the_entrance_downwards(tube: Scenario) -> None:
    seen = [
        observe(tube, state_at(np.array([0, 0, z]), yaw_then_pitch(0, 0)), np.ones(3))["depth"]
        for z in (4.0, -6.0, 14.0)
    ]
    np.testing.assert_allclose(np.ravel(seen), [0.0, 0.5, -0.5], atol=1e-7)


def test_wild_states_stay_inside_the_space(tube: Scenario) -> None:
    observe(tube, state_at(np.full(3, 1e4), yaw_then_pitch(0, 0), np.full(6, 100.0)), np.zeros(3))
    observe(tube, state_at(np.zeros(3), yaw_then_pitch(0, 0)), np.zeros(3))  # at the goal itself


def test_unknown_preset_suggests_the_closest() -> None:
    with pytest.raises(InputError, match="Did you mean 'paper'"):
        layout("papier")
