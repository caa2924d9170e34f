from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.pictures.chase import ChaseCamera
from aquanav_tools.envs.pictures.exposure import AutoExposure
from aquanav_tools.envs.pictures.vehicle_camera import VehicleCamera
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.solids import box
from aquanav_tools.types import Array, Capsule, rotation_matrix, yaw_quaternion
from tests.caves import TUBE_RADIUS

SIZE = (96, 72)
HULL = Capsule(0.17, 0.117)
WIDTH = 0.34
BODY = box((0.457, WIDTH, 0.25), (0.0, 0.0, 0.0), (250, 120, 20))
SPECK = box((0.001,) * 3, (0.0, 0.0, 0.0), (250, 120, 20))
AHEAD = np.array([1, 1, 2])


def state_at(x: float, y: float, z: float, yaw: float = 0.0) -> Array:
    return np.concatenate([[x, y, z], yaw_quaternion(yaw), np.zeros(6)])


@pytest.mark.parametrize("view", ["chase", "onboard"])
def test_pictures_change_nothing_about_the_episode(tube: Scenario, view: str) -> None:
    seen, blind = CaveEnv(tube, render_mode="rgb_array", view=view, render_size=SIZE), CaveEnv(tube)
    np.testing.assert_array_equal(seen.reset(seed=3)[0], blind.reset(seed=3)[0])
    pictures = []
    for _ in range(5):
        np.testing.assert_array_equal(seen.step(AHEAD)[0], blind.step(AHEAD)[0])
        pictures.append(seen.render())
    assert pictures[0].shape == (72, 96, 3)
    assert pictures[0].dtype == np.uint8
    assert pictures[-1].std() > 5.0
    np.testing.assert_array_equal(pictures[-1], seen.render())
    assert (pictures[0] != pictures[-1]).any()


def test_an_episode_begins_with_the_same_picture_whatever_was_before(tube: Scenario) -> None:
    env = CaveEnv(tube, render_mode="rgb_array", render_size=SIZE)
    env.reset(seed=3)
    first = env.render()
    for _ in range(8):
        env.step(np.array([0, 0, 2]))
        env.render()
    env.reset(seed=3)
    np.testing.assert_array_equal(first, env.render())


def test_without_a_render_mode_there_is_a_warning_and_no_picture(tube: Scenario) -> None:
    env = CaveEnv(tube)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match='Make it with render_mode="rgb_array"'):
        assert env.render() is None


def test_gymnasium_records_frames(tube: Scenario) -> None:
    import aquanav_tools.envs  # noqa: F401  # registers

    env = gymnasium.make("aquanav/Cave-v0", scenario=tube, render_mode="rgb_array", render_size=SIZE)
    wrapped = gymnasium.wrappers.RenderCollection(env)
    wrapped.reset(seed=0)
    wrapped.step(AHEAD)
    assert len(wrapped.render()) == 2
    assert env.metadata["render_fps"] == 10


def test_the_following_camera_sees_the_vehicle_where_a_pinhole_has_it(tube: Scenario) -> None:
    camera = VehicleCamera(tube, HULL, BODY, "chase", (320, 240))
    empty = VehicleCamera(tube, HULL, SPECK, "chase", (320, 240))
    state = state_at(6.0, 0.2, -0.1, 0.3)
    is_body = np.abs(camera.picture(state, 0.0).astype(int) - empty.picture(state, 0.0)).max(axis=2) > 40
    rows, columns = np.nonzero(is_body)
    # 0.7 m and 1.5 lengths of 0.457 m behind, 18 degrees up, looking at a place 0.6 m before the vehicle; by hand.
    far, rise = 0.7 + 1.5 * 0.457, np.radians(18.0)
    behind, above = far * np.cos(rise), far * np.sin(rise)
    down = rise - np.arctan2(above, behind + 0.6)
    focal = 16.0 / np.hypot(36.0, 24.0) * np.hypot(320, 240)
    assert columns.mean() + 0.5 == pytest.approx(160.0, abs=1.5)
    assert 0.5 * (rows.min() + rows.max() + 1) == pytest.approx(120.0 + focal * np.tan(down), abs=6.0)
    # The box's end, half its length nearer to the camera, is the widest thing seen.
    assert np.ptp(columns) + 1 == pytest.approx(focal * WIDTH / (behind - 0.228), rel=0.1)


def test_the_following_camera_stays_clear_of_every_wall_and_sees_the_vehicle(tube: Scenario) -> None:
    chase = ChaseCamera(tube.field, HULL.length)
    solid = tube.cavity.mesh.to_trimesh()
    for number, yaw in enumerate(np.linspace(0.0, 4.0 * np.pi, 48)):  # turning on the spot, close to the ceiling
        state = state_at(6.0, 0.6, 0.9, yaw)
        centre, axes = chase.pose(state[:3], rotation_matrix(state[3:7]), 0.0 if number == 0 else 0.1)
        # What the vehicle's middle keeps from the wall is 1.5 m less 1.08 m; six tenths of that, or 0.25 m, is kept;
        # the field's spacing bounds what a sample misses.
        assert TUBE_RADIUS - np.hypot(*centre[1:]) > min(0.25, 0.6 * (TUBE_RADIUS - 1.0817)) - tube.field.spacing
        assert solid.contains(centre[None]).all()
        between = state[:3] + np.linspace(0.0, 1.0, 20)[:, None] * (centre - state[:3])
        assert (tube.field.clearance(between) > 0.05).all()
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)


def test_the_following_camera_turns_smoothly(tube: Scenario) -> None:
    chase = ChaseCamera(tube.field, HULL.length)
    chase.pose(np.array([6.0, 0.0, 0.0]), np.eye(3), 0.0)
    _, before = chase.pose(np.array([6.0, 0.0, 0.0]), np.eye(3), 0.1)
    _, after = chase.pose(np.array([6.0, 0.0, 0.0]), rotation_matrix(yaw_quaternion(np.pi / 2)), 0.1)
    turned = np.degrees(np.arccos(np.clip(before[2] @ after[2], -1.0, 1.0)))
    assert 3.0 < turned < 30.0  # a lag of 0.45 s does a fifth of a quarter turn in a tenth of a second: 18 degrees


def test_what_is_left_of_the_vehicle_is_left_in_its_picture(tube: Scenario) -> None:
    camera = VehicleCamera(tube, HULL, BODY, "onboard", SIZE)
    # Beside the left wall, which is near and so brightly lit.
    left, right = np.split(camera.picture(state_at(6.0, 1.1, 0.0), 0.0).mean(axis=2), 2, axis=1)
    assert left.mean() > 1.2 * right.mean()


def test_the_exposure_follows_the_light_as_fast_as_a_camera_does() -> None:
    dim, bright = np.full((16, 16, 3), 0.01, np.float32), np.full((16, 16, 3), 0.1, np.float32)
    meter = AutoExposure()
    steady = meter.develop(dim, 0.0)
    at_once, later = meter.develop(bright, 0.1), meter.develop(bright, 5.0)
    assert at_once.mean() > later.mean() + 20.0
    np.testing.assert_allclose(later, steady, atol=2)
    np.testing.assert_array_equal(later, meter.develop(bright, 0.0))


@pytest.mark.parametrize("wrong", [{"view": "chse"}, {"render_size": (10, 10)}, {"render_mode": "humn"}])
def test_what_cannot_be_rendered_is_refused(tube: Scenario, wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        CaveEnv(tube, **{"render_mode": "rgb_array", **wrong})


def test_a_near_wall_in_a_dark_picture_keeps_its_detail() -> None:
    light = np.full((40, 40, 3), 0.01, np.float32)
    light[:, :4] = 1.0  # a tenth of the picture is a hundred times as bright
    picture = AutoExposure().develop(light, 0.0)
    assert picture[:, :4].max() < 240
    assert picture[:, 4:].min() > 10
