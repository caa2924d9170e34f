"""An episode as a bag of ROS 2 (MCAP): standard messages, which Foxglove and RViz show without code of ours.

Frames are "map" (the scenario's, z up) and "base_link" (the body: x ahead, y left, z up); times are seconds since the
reset. Every topic has a message for each state, those of decisions from the first decision on:

    /odometry   nav_msgs/Odometry              pose in the map, twist in the body frame
    /tf         tf2_msgs/TFMessage             the same pose, map to base_link
    /rays       sensor_msgs/PointCloud2        where each ray that met a wall ends, body frame; fields x, y, z
    /ranges     std_msgs/Float32MultiArray     length of all rays, m
    /current    geometry_msgs/Vector3Stamped   velocity of the water at the vehicle, map, m/s
    /clearance, /progress, /reward             std_msgs/Float64: m, m along the guide, of the decision before
    /collision  std_msgs/Bool                  whether the hull touched the wall since the state before
    /command    geometry_msgs/Vector3Stamped   x ballast, y steer, z thrust of the decision that follows
    /cave       visualization_msgs/Marker      once: the wall, for caves
    /route      nav_msgs/Path                  once: the guide, for caves
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.libraries import require
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.text_files import read_text
from aquanav_tools.types import Array

MAP, BODY = "map", "base_link"
VERSION = 9
"""Of rosbag2's metadata: the newest that rosbags writes, read by ROS 2 from Iron on."""
WALL_COLOUR = (0.55, 0.5, 0.45, 1.0)
_FLOAT32 = 7
"""Of a PointCloud2's fields."""
_TRIANGLES = 11
"""Type of a Marker."""


def check_bag(path: Path) -> None:
    """Check that a bag can be written, before the episode is run.

    Raises:
        LibraryError: rosbags is not installed.
        InputError: there is something at its path.
    """
    require("A bag of ROS 2 (--bag)", "rosbags")
    if path.exists():
        raise InputError(f"{path} exists. Choose another folder for the bag, or remove it.")


def write_bag(path: Path, trajectory: Trajectory, ray_directions: Array, cave: Scenario | None = None) -> None:
    """Write an episode as a bag: a folder with a .mcap file and metadata.yaml, there when it is complete.

    Args:
        path: The folder.
        trajectory: What happened.
        ray_directions: (R, 3) unit vectors in the body frame, in the order of the trajectory's rays.
        cave: The scenario, if it is a cave.

    Raises:
        LibraryError, InputError: as in `check_bag`.
    """
    check_bag(path)
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    partial = path.with_name(path.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    connections: dict[str, Any] = {}
    with Writer(partial, version=VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
        for seconds, topic, message in _Messages(store).of(trajectory, ray_directions, cave):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
            content = store.serialize_cdr(message, message.__msgtype__)
            writer.write(connections[topic], round(seconds * 1e9), content)
    for part in (*partial.glob("*.mcap"), partial / "metadata.yaml"):  # both name the folder that it was written in
        _rename(part, partial.name, path.name)
    partial.rename(path)


def _rename(part: Path, before: str, now: str) -> None:
    """Let a part of a bag be called after its folder."""
    if part.suffix == ".yaml":
        part.write_text(read_text(part).replace(f"{before}.mcap", f"{now}.mcap"), encoding="utf-8")
    else:
        part.rename(part.with_name(f"{now}.mcap"))


class _Messages:
    """Messages of one episode, with the types of a store."""

    def __init__(self, store: Any) -> None:
        """Keep the types."""
        self._types = store.types

    def of(self, trajectory: Trajectory, directions: Array, cave: Scenario | None) -> Iterator[tuple[float, str, Any]]:
        """Yield (time in s, topic, message), in the order of time."""
        if cave is not None:
            yield 0.0, "/cave", self._wall(cave)
            yield 0.0, "/route", self._route(cave)
        longest = trajectory.rays.max(axis=0)
        for n, time in enumerate(trajectory.times.tolist()):
            header = self._header(time, MAP)
            place, turn = self._vector(trajectory.positions[n]), self._turn(trajectory.orientations[n])
            yield time, "/odometry", self._odometry(header, place, turn, trajectory.velocities[n])
            yield time, "/tf", self._transform(header, trajectory.positions[n], turn)
            met = trajectory.rays[n] < longest
            yield time, "/rays", self._cloud(time, (trajectory.rays[n, :, None] * directions)[met])
            yield time, "/ranges", self._ranges(trajectory.rays[n])
            yield time, "/current", self._stamped(header, trajectory.currents[n])
            yield time, "/clearance", self._make("std_msgs/msg/Float64", float(trajectory.clearances[n]))
            yield time, "/progress", self._make("std_msgs/msg/Float64", float(trajectory.progress[n]))
            yield time, "/collision", self._make("std_msgs/msg/Bool", bool(trajectory.collided[n]))
            if n:
                yield time, "/reward", self._make("std_msgs/msg/Float64", float(trajectory.rewards[n - 1]))
            if n < trajectory.num_decisions:
                yield time, "/command", self._stamped(self._header(time, BODY), trajectory.commands[n])

    def _make(self, kind: str, *values: Any) -> Any:
        return self._types[kind](*values)

    def _header(self, seconds: float, frame: str) -> Any:
        nanoseconds = round(seconds * 1e9)
        stamp = self._make("builtin_interfaces/msg/Time", nanoseconds // 10**9, nanoseconds % 10**9)
        return self._make("std_msgs/msg/Header", stamp, frame)

    def _vector(self, values: Any, kind: str = "Point") -> Any:
        return self._make(f"geometry_msgs/msg/{kind}", *(float(value) for value in values))

    def _turn(self, quaternion: Any) -> Any:
        w, x, y, z = (float(value) for value in quaternion)
        return self._make("geometry_msgs/msg/Quaternion", x, y, z, w)

    def _stamped(self, header: Any, values: Any) -> Any:
        return self._make("geometry_msgs/msg/Vector3Stamped", header, self._vector(values, "Vector3"))

    def _odometry(self, header: Any, place: Any, turn: Any, velocity: Any) -> Any:
        unknown = np.zeros(36)
        pose = self._make("geometry_msgs/msg/Pose", place, turn)
        ahead, around = self._vector(velocity[:3], "Vector3"), self._vector(velocity[3:], "Vector3")
        twist = self._make("geometry_msgs/msg/Twist", ahead, around)
        return self._make(
            "nav_msgs/msg/Odometry",
            header,
            BODY,
            self._make("geometry_msgs/msg/PoseWithCovariance", pose, unknown),
            self._make("geometry_msgs/msg/TwistWithCovariance", twist, unknown),
        )

    def _transform(self, header: Any, position: Any, turn: Any) -> Any:
        moved = self._make("geometry_msgs/msg/Transform", self._vector(position, "Vector3"), turn)
        return self._make(
            "tf2_msgs/msg/TFMessage", [self._make("geometry_msgs/msg/TransformStamped", header, BODY, moved)]
        )

    def _cloud(self, seconds: float, points: Array) -> Any:
        fields = [
            self._make("sensor_msgs/msg/PointField", name, 4 * n, _FLOAT32, 1) for n, name in enumerate(("x", "y", "z"))
        ]
        data = np.frombuffer(points.astype("<f4").tobytes(), dtype=np.uint8)
        header = self._header(seconds, BODY)
        return self._make(
            "sensor_msgs/msg/PointCloud2", header, 1, len(points), fields, False, 12, 12 * len(points), data, True
        )

    def _ranges(self, rays: Any) -> Any:
        layout = self._make("std_msgs/msg/MultiArrayLayout", [], 0)
        return self._make("std_msgs/msg/Float32MultiArray", layout, rays.astype(np.float32))

    def _wall(self, cave: Scenario) -> Any:
        corners = cave.cavity.mesh.vertices[cave.cavity.mesh.faces.ravel()]
        still = self._make("geometry_msgs/msg/Pose", self._vector((0.0, 0.0, 0.0)), self._turn((1.0, 0.0, 0.0, 0.0)))
        moment = self._make("builtin_interfaces/msg/Duration", 0, 0)
        none = self._make("std_msgs/msg/Header", self._make("builtin_interfaces/msg/Time", 0, 0), "")
        return self._make(
            "visualization_msgs/msg/Marker",
            self._header(0.0, MAP),
            "cave",
            0,
            _TRIANGLES,
            0,
            still,
            self._vector((1.0, 1.0, 1.0), "Vector3"),
            self._make("std_msgs/msg/ColorRGBA", *WALL_COLOUR),
            moment,
            False,
            [self._vector(corner) for corner in corners],
            [],
            "",
            self._make("sensor_msgs/msg/CompressedImage", none, "", np.zeros(0, dtype=np.uint8)),
            [],
            "",
            "",
            self._make("visualization_msgs/msg/MeshFile", "", np.zeros(0, dtype=np.uint8)),
            False,
        )

    def _route(self, cave: Scenario) -> Any:
        header, still = self._header(0.0, MAP), self._turn((1.0, 0.0, 0.0, 0.0))
        poses = [
            self._make(
                "geometry_msgs/msg/PoseStamped",
                header,
                self._make("geometry_msgs/msg/Pose", self._vector(place), still),
            )
            for place in cave.guide.centres
        ]
        return self._make("nav_msgs/msg/Path", header, poses)
