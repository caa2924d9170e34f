from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.photograph.options import CaptureOptions, PathName
from aquanav_tools.photograph.trajectory import HOVER_SPEED, SURFACE_TIME, look, plan_capture
from aquanav_tools.synthetic.caves import tube

CENTRELINE = tube(2.0, 10.0).centreline
STEADY = {"unsteady_m": 0.0, "unsteady_deg": 0.0}


def test_a_level_camera_looking_along_x_has_right_at_minus_y_and_down_at_minus_z() -> None:
    np.testing.assert_allclose(look(0.0, 0.0), [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(look(0.0, 0.4)[2], [np.cos(0.4), 0.0, np.sin(0.4)])
    np.testing.assert_allclose(look(0.3, 0.2, 0.1) @ look(0.3, 0.2, 0.1).T, np.eye(3), atol=1e-12)


def test_five_photos_are_taken_at_every_station_inside_the_passage() -> None:
    shots = plan_capture(CENTRELINE, CaptureOptions(photos=25))
    centres = np.array([shot.centre for shot in shots])
    assert len(shots) == 25
    assert np.linalg.norm(centres[:, 1:], axis=1).max() < 0.5
    speeds = np.linalg.norm([shot.velocity for shot in shots], axis=1)
    assert np.sqrt(np.mean(speeds**2) / 3) == pytest.approx(HOVER_SPEED, rel=0.3)  # 75 samples


@pytest.mark.parametrize("path", ["stations", "forward", "sweep", "loop", "passes"])
def test_every_path_gives_the_photos_asked_for_in_order_of_time(path: PathName) -> None:
    shots = plan_capture(CENTRELINE, CaptureOptions(path, 37))
    assert len(shots) == 37
    assert np.all(np.diff([shot.time for shot in shots]) > 0)
    for shot in shots:
        np.testing.assert_allclose(shot.cam_from_world @ shot.cam_from_world.T, np.eye(3), atol=1e-12)


def test_a_forward_swim_goes_at_its_speed_and_looks_where_it_goes() -> None:
    shots = plan_capture(CENTRELINE, CaptureOptions("forward", 20, speed=0.3, **STEADY))
    for shot in shots[1:-1]:
        np.testing.assert_allclose(shot.velocity, [0.3, 0.0, 0.0], atol=1e-6)
        np.testing.assert_allclose(shot.cam_from_world[2], [1.0, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(shot.spin, 0.0, atol=1e-9)
    assert shots[-1].time == pytest.approx(9.2 / 0.3)


def test_spin_and_velocity_predict_the_next_pose() -> None:
    shots = plan_capture(CENTRELINE, CaptureOptions("sweep", 1200, speed=1.0, turn_rate_deg=90.0))
    checked = 0
    for here, there in zip(shots[100:1100:29], shots[101:1101:29], strict=True):
        step = there.time - here.time
        turn = there.cam_from_world @ here.cam_from_world.T  # exp(-[spin]x step)
        spin = -np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (2 * step)
        np.testing.assert_allclose(spin, here.spin, atol=0.02)  # the steps are 10 ms, the shake's period 1.6 s
        np.testing.assert_allclose((there.centre - here.centre) / step, here.velocity, atol=0.01)
        checked += 1
    assert checked > 30


def test_a_loop_ends_with_its_first_view() -> None:
    shots = plan_capture(CENTRELINE, CaptureOptions("loop", 60, **STEADY))
    np.testing.assert_allclose(shots[-1].centre, shots[0].centre, atol=1e-9)
    np.testing.assert_allclose(shots[-1].cam_from_world, shots[0].cam_from_world, atol=1e-9)
    sideways = np.array([shot.cam_from_world[2, 1] for shot in shots])
    assert sideways.min() < -0.7 < 0.7 < sideways.max()  # both walls


def test_three_passes_look_left_right_and_up_with_a_pause_between_them() -> None:
    shots = plan_capture(CENTRELINE, CaptureOptions("passes", 30, **STEADY))
    ahead = np.array([shot.cam_from_world[2] for shot in shots])
    assert np.all(ahead[:10, 1] > 0.5)
    assert np.all(ahead[10:20, 1] < -0.5)
    assert np.all(ahead[20:, 2] > 0.5)
    assert shots[10].time - shots[9].time == pytest.approx(SURFACE_TIME)


@pytest.mark.parametrize("wrong", [{"photos": 2}, {"photos": 10_000}, {"unsteady_m": -1.0}, {"speed": 0.0}])
def test_senseless_captures_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"photos|CaptureOptions"):
        CaptureOptions(**wrong)  # type: ignore[arg-type]
