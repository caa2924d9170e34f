from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from PIL import Image

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.rendering import VehicleCamera, film, film_size
from aquanav_tools.errors import InputError
from aquanav_tools.photograph.lens import make_lens
from aquanav_tools.photograph.options import CameraOptions
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array, Capsule, yaw_quaternion

SIZE = (96, 72)
HULL = Capsule(0.2, 0.3)
AHEAD = np.array([1, 1, 2])


def state_at(x: float, y: float, z: float, yaw: float = 0.0) -> Array:
    return np.concatenate([[x, y, z], yaw_quaternion(yaw), np.zeros(6)])


def is_hull(picture: np.ndarray, empty: np.ndarray) -> np.ndarray:
    """Pixels that differ from the picture of the same place without a vehicle."""
    return np.abs(picture.astype(int) - empty).max(axis=2) > 40


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


def test_the_following_camera_sees_the_hull_where_a_pinhole_has_it(tube: Scenario) -> None:
    camera = VehicleCamera(tube.cavity.mesh, HULL, "chase", (320, 240))
    speck = VehicleCamera(tube.cavity.mesh, Capsule(0.01, 0.01), "chase", (320, 240))
    state = state_at(6.0, 0.2, -0.1, 0.3)
    rows, columns = np.nonzero(is_hull(camera.picture(state), speck.picture(state)))
    # 1.4 m behind and 0.45 m above, looking at a place 0.6 m before the vehicle: by hand, in the vertical plane.
    far, down = np.hypot(1.4, 0.45), np.arctan2(0.45, 1.4) - np.arctan2(0.45, 2.0)
    focal = make_lens(CameraOptions(width=320, height=240)).focal_px
    assert columns.mean() + 0.5 == pytest.approx(160.0, abs=1.5)
    assert 0.5 * (rows.min() + rows.max() + 1) == pytest.approx(120.0 + focal * np.tan(down), abs=4.0)
    # Its near end, a ball 0.15 m behind the middle, is the widest thing seen.
    assert np.ptp(columns) + 1 == pytest.approx(2.0 * focal * 0.2 / (far - 0.15), rel=0.1)


def test_the_following_camera_stays_in_the_water(tube: Scenario) -> None:
    camera = VehicleCamera(tube.cavity.mesh, HULL, "chase", SIZE)
    solid = tube.cavity.mesh.to_trimesh()
    for yaw in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
        state = state_at(6.0, 0.9, 0.6, yaw)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        shot = camera._chase(state[:3], turn)
        assert solid.contains(shot.centre[None]).all()
        np.testing.assert_allclose(shot.cam_from_world @ shot.cam_from_world.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(shot.cam_from_world) == pytest.approx(1.0)


def test_what_is_left_of_the_vehicle_is_left_in_its_picture(tube: Scenario) -> None:
    camera = VehicleCamera(tube.cavity.mesh, HULL, "onboard", SIZE)
    # Beside the left wall, which is near and so brightly lit.
    left, right = np.split(camera.picture(state_at(6.0, 1.1, 0.0)).mean(axis=2), 2, axis=1)
    assert left.mean() > 1.2 * right.mean()


@pytest.mark.parametrize("wrong", [{"view": "chse"}, {"render_size": (10, 10)}, {"render_mode": "humn"}])
def test_what_cannot_be_rendered_is_refused(tube: Scenario, wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        CaveEnv(tube, **{"render_mode": "rgb_array", **wrong})


def test_a_film_has_a_frame_for_every_state(tube: Scenario, tmp_path: Path) -> None:
    import cv2

    camera = VehicleCamera(tube.cavity.mesh, HULL, "chase", SIZE)
    states = np.array([state_at(3.0 + 0.1 * n, 0.0, 0.0) for n in range(6)])
    film(camera, states, tmp_path / "dive.mp4", 10.0)
    reader = cv2.VideoCapture(str(tmp_path / "dive.mp4"))
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    frames = []
    while (read := reader.read())[0]:
        frames.append(read[1][..., ::-1])
    assert len(frames) == 6
    assert np.corrcoef(frames[3].ravel(), camera.picture(states[3]).ravel())[0, 1] > 0.95
    assert [path.name for path in tmp_path.iterdir()] == ["dive.mp4"]


def test_a_gif_has_a_frame_for_every_state_and_repeats(tube: Scenario, tmp_path: Path) -> None:
    camera = VehicleCamera(tube.cavity.mesh, HULL, "chase", SIZE)
    states = np.array([state_at(3.0 + 0.1 * n, 0.0, 0.0) for n in range(6)])
    film(camera, states, tmp_path / "dive.gif", 10.0)
    with Image.open(tmp_path / "dive.gif") as gif:
        assert (gif.format, gif.n_frames, gif.info["loop"]) == ("GIF", 6, 0)
        for number, state in enumerate(states):
            gif.seek(number)
            assert gif.info["duration"] == 100
            shown = np.asarray(gif.convert("RGB"), dtype=float)
            # 256 colours that cover all of a picture: 5 levels off at most in one of a cave and a hull.
            assert np.abs(shown - camera.picture(state)).max() <= 8.0
    assert [path.name for path in tmp_path.iterdir()] == ["dive.gif"]


def test_a_film_of_another_kind_or_in_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no films like dive\.avi\. Give it a name that ends in \.mp4 or \.gif"):
        film_size(tmp_path / "dive.avi")
    with pytest.raises(InputError, match=r"no folder .*nowhere for the film dive\.gif\. Make it first"):
        film_size(tmp_path / "nowhere" / "dive.gif")
