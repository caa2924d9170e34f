from __future__ import annotations

import dataclasses
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from aquanav_tools.report.scene_model import MAX_POINTS, scene_caption, write_scene
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.solids import box
from aquanav_tools.types import Pose, yaw_quaternion
from tests.report.trajectories import straight_trajectory

VEHICLE = box((0.4, 0.3, 0.2), (0.0, 0.0, 0.0), (10, 200, 30))
PLACE = np.array([6.0, 0.5, -0.2])


@pytest.fixture(scope="module")
def path(tube: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "view.glb"
    clean = straight_trajectory(400, num_collisions=0)
    pose = Pose(PLACE, yaw_quaternion(0.5 * np.pi))
    write_scene(tube, path, (VEHICLE, pose), (straight_trajectory(50, num_collisions=1), clean))
    return path


@pytest.fixture(scope="module")
def scene(path: Path) -> trimesh.Scene:
    return trimesh.load(path)  # a reader of its own


def world(points: np.ndarray) -> np.ndarray:
    """From glTF's y up to z up."""
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


def trails(path: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points and linear colours of the trails, read by the format's rules: what wrote them is no judge of them."""
    data = path.read_bytes()
    (size,) = struct.unpack_from("<I", data, 12)
    table = json.loads(data[20 : 20 + size])

    def values(number: int, kind: str, width: int) -> np.ndarray:
        accessor = table["accessors"][number]
        start = 28 + size + table["bufferViews"][accessor["bufferView"]]["byteOffset"]
        return np.frombuffer(data, kind, accessor["count"] * width, start).reshape(-1, width)

    nodes = [node for node in table["nodes"] if node.get("name", "").startswith("trail")]
    parts = [table["meshes"][node["mesh"]]["primitives"][0] for node in nodes]
    assert all(part["mode"] == 1 for part in parts)  # LINES
    found = []
    for part in parts:
        ends = values(part["attributes"]["POSITION"], "<f4", 3).reshape(-1, 2, 3)
        assert np.array_equal(ends[1:, 0], ends[:-1, 1])  # one goes on from the other
        colour = values(part["attributes"]["COLOR_0"], "<u1", 4)[0] / 255.0
        found.append((world(np.concatenate([ends[:1, 0], ends[:, 1]])), colour))
    return found


def test_the_cave_is_there_in_world_coordinates(tube: Scenario, scene: trimesh.Scene) -> None:
    cave = scene.geometry["cave"]
    np.testing.assert_allclose(
        world(np.asarray(cave.vertices)).max(axis=0), tube.cavity.mesh.vertices.max(axis=0), atol=1e-5
    )
    assert len(cave.faces) == len(tube.cavity.mesh.faces)


def test_the_vehicle_is_where_it_was_put_and_turned(scene: trimesh.Scene) -> None:
    corners = world(np.asarray(scene.geometry["vehicle"].vertices))
    np.testing.assert_allclose(corners.mean(axis=0), PLACE, atol=1e-6)
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.3, 0.4, 0.2], atol=1e-6)  # a quarter turn


def test_trails_keep_their_ends_have_few_points_and_tell_of_contacts_by_colour(path: Path) -> None:
    (touched, red), (clean, green) = trails(path)
    assert len(touched) == 51 and len(clean) == MAX_POINTS
    for trail in (touched, clean):
        np.testing.assert_allclose(trail[[0, -1], 0], [1.0, 19.0], atol=1e-5)
    assert red[0] > 3.0 * red[1] and green[1] > 3.0 * green[0]


def test_the_caption_tells_the_colours_that_there_are(tube: Scenario) -> None:
    assert "pale wall high and blue wall low. Drag" in scene_caption(tube)
    observed = np.arange(len(tube.cavity.labels)) % 2 == 0
    guessed = dataclasses.replace(tube, cavity=dataclasses.replace(tube.cavity, observed=observed))
    caption = scene_caption(guessed, has_own_colours=True)
    assert "the wall in its own colours, pink where it was filled in. Drag" in caption
