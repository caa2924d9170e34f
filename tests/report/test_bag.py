"""A bag of ROS 2 holds what happened, as a reader that we did not write sees it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.report.recording.bag import write_bag
from aquanav_tools.report.trajectory import Trajectory
from tests.caves import tube_scenario

pytest.importorskip("rosbags", reason="rosbags is not installed: pip install 'aquanav[ros]'")
DIRECTIONS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])


def dive(num: int = 4) -> Trajectory:
    """Return three decisions whose numbers are all different."""
    rng = np.random.default_rng(5)
    turns = rng.normal(size=(num, 4))
    rays = np.full((num, 3), 5.0)
    rays[1:, 0], rays[2:, 2] = [1.5, 1.25, 1.0], [0.5, 0.25]
    return Trajectory(
        seed=1,
        start_index=0,
        outcome="success",
        times=1.25 + 0.1 * np.arange(num),
        positions=rng.normal(size=(num, 3)),
        clearances=rng.uniform(size=num),
        collided=np.array([False, True, False, False]),
        progress=rng.uniform(size=num),
        num_collisions=1,
        orientations=turns / np.linalg.norm(turns, axis=1, keepdims=True),
        velocities=rng.normal(size=(num, 6)),
        currents=rng.normal(size=(num, 3)),
        rays=rays,
        costs=np.zeros(num),
        actions=np.zeros((num - 1, 3)),
        commands=rng.uniform(-1.0, 1.0, (num - 1, 3)),
        rewards=rng.normal(size=num - 1),
        reward_terms={},
    )


def read(folder: Path) -> dict[str, list[Any]]:
    """Return (seconds, message) of each topic."""
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed: pip install '.[dev]'")
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed: pip install '.[dev]'")
    found: dict[str, list[Any]] = {}
    for item in reader.read_ros2_messages(str(folder / f"{folder.name}.mcap")):
        found.setdefault(item.channel.topic, []).append((item.log_time_ns * 1e-9, item.ros_msg))
    return found


def xyz(value: Any) -> list[float]:
    return [value.x, value.y, value.z]


def test_every_state_and_decision_is_there_in_its_units(tmp_path: Path) -> None:
    trajectory, scenario = dive(), tube_scenario()
    write_bag(tmp_path / "dive", trajectory, DIRECTIONS, scenario)
    found = read(tmp_path / "dive")
    for (seconds, message), n in zip(found["/odometry"], range(4), strict=True):
        assert seconds == pytest.approx(trajectory.times[n])
        assert message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec == pytest.approx(trajectory.times[n])
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
        assert xyz(message.pose.pose.position) == trajectory.positions[n].tolist()
        turn = message.pose.pose.orientation
        assert [turn.w, turn.x, turn.y, turn.z] == trajectory.orientations[n].tolist()
        assert xyz(message.twist.twist.linear) + xyz(message.twist.twist.angular) == trajectory.velocities[n].tolist()
    moved = [message.transforms[0] for _, message in found["/tf"]]
    assert [xyz(one.transform.translation) for one in moved] == trajectory.positions.tolist()
    assert [xyz(message.vector) for _, message in found["/current"]] == trajectory.currents.tolist()
    assert [xyz(message.vector) for _, message in found["/command"]] == trajectory.commands.tolist()
    assert [message.data for _, message in found["/reward"]] == trajectory.rewards.tolist()
    assert [message.data for _, message in found["/clearance"]] == trajectory.clearances.tolist()
    assert [message.data for _, message in found["/progress"]] == trajectory.progress.tolist()
    assert [message.data for _, message in found["/collision"]] == [False, True, False, False]
    assert [list(message.data) for _, message in found["/ranges"]] == trajectory.rays.tolist()


def test_rays_that_met_the_wall_are_points_in_the_body_frame(tmp_path: Path) -> None:
    write_bag(tmp_path / "dive", dive(), DIRECTIONS)
    clouds = [message for _, message in read(tmp_path / "dive")["/rays"]]
    assert [field.name for field in clouds[0].fields] == ["x", "y", "z"]
    points = [np.frombuffer(bytes(cloud.data), "<f4").reshape(cloud.width, 3).tolist() for cloud in clouds]
    assert points == [[], [[1.5, 0, 0]], [[1.25, 0, 0], [0, 0, -0.5]], [[1, 0, 0], [0, 0, -0.25]]]


def test_the_wall_and_the_route_are_those_of_the_scenario(tmp_path: Path) -> None:
    scenario = tube_scenario()
    write_bag(tmp_path / "dive", dive(), DIRECTIONS, scenario)
    found = read(tmp_path / "dive")
    ((_, wall),) = found["/cave"]
    corners = np.array([xyz(point) for point in wall.points]).reshape(-1, 3, 3)
    # Gauss: the volume within a closed surface from its corners alone.
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert abs(volume) == pytest.approx(scenario.cavity.mesh.volume, rel=1e-9)
    ((_, route),) = found["/route"]
    assert [xyz(pose.pose.position) for pose in route.poses] == scenario.guide.centres.tolist()


def test_a_bag_is_complete_or_not_there_and_replaces_nothing(tmp_path: Path) -> None:
    path = tmp_path / "dive"
    broken = replace(dive(), commands=np.zeros((1, 3)))
    with pytest.raises(IndexError):
        write_bag(path, broken, DIRECTIONS)
    assert not path.exists()
    write_bag(path, dive(), DIRECTIONS)
    assert sorted(part.name for part in path.iterdir()) == ["dive.mcap", "metadata.yaml"]
    assert (
        "dive.mcap" in (path / "metadata.yaml").read_text() and ".partial" not in (path / "metadata.yaml").read_text()
    )
    with pytest.raises(InputError, match=r"exists\. Choose another folder for the bag"):
        write_bag(path, dive(), DIRECTIONS)
