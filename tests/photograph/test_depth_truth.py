"""Depth maps as a reference, in a room whose walls are known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from PIL import Image

from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.types import Mesh, Sim3, rotation_matrix
from eval.photos.depth_truth import (
    CELL,
    DepthReference,
    depth_centres,
    is_free,
    is_judged,
    lattice,
    read_depth_reference,
    refined,
    score_against,
)

SIZE = np.array([3.0, 2.4, 2.0])
FOCAL, WIDTH, HEIGHT = 320.0, 512, 384


def room() -> trimesh.Trimesh:
    """Its corners at the origin and at SIZE."""
    return trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], SIZE])


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> DepthReference:
    """The depth maps of cameras in the middle of the room that look ahead, to the left, and between."""
    folder = tmp_path_factory.mktemp("room")
    truth = folder / "truth"
    truth.mkdir()
    np.savetxt(truth / "camera-intrinsics.txt", [[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    solid = room()
    scene = SmoothScene(Mesh(np.asarray(solid.vertices, float), np.asarray(solid.faces, np.int64)))
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = np.stack([u / FOCAL, v / FOCAL, np.ones_like(u)], axis=-1).reshape(-1, 3)
    for index in range(15):
        place, turn = np.array([0.8 + 0.04 * index, 1.2, 1.0]), look(np.radians((0.0, 45.0, 90.0)[index % 3]), 0.0)
        depth = scene.cast(place, rays @ turn)[0].reshape(HEIGHT, WIDTH)
        Image.fromarray(np.round(1000.0 * depth).astype(np.uint16)).save(truth / f"frame-{index:02d}.depth.png")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn.T, place
        np.savetxt(truth / f"frame-{index:02d}.pose.txt", pose)
    assert depth_centres(folder)["frame-00.color.jpg"] == pytest.approx([0.8, 1.2, 1.0])
    return read_depth_reference(folder)


def samples_that_can_be_judged(reference: DepthReference, count: int = 40_000) -> np.ndarray:
    samples = np.asarray(trimesh.sample.sample_surface(room(), count, seed=0)[0])
    return samples[is_judged(reference, samples)]


def test_points_of_depth_maps_lie_on_the_walls_and_face_where_the_cameras_looked(reference: DepthReference) -> None:
    points = reference.points
    to_wall = np.minimum(np.abs(points), np.abs(points - SIZE)).min(axis=1)
    assert np.median(to_wall) < 0.001  # depths are whole millimetres
    assert to_wall.max() < 0.01  # a cell in an edge has points on two walls
    assert points[:, 0].max() > SIZE[0] - CELL  # the wall ahead was seen, and that behind never
    assert points[:, 0].min() > CELL


def test_walls_that_lie_3_cm_off_pass_at_5_cm_and_not_at_2(reference: DepthReference) -> None:
    middle, seen = 0.5 * SIZE, samples_that_can_be_judged(reference)
    far = np.abs(seen - middle) / (0.5 * SIZE)
    wall_axis = np.eye(3)[far.argmax(axis=1)]
    pushed = seen - 0.03 * wall_axis * np.sign(seen - middle)
    at_2, at_5, at_10 = score_against(reference, pushed)
    assert at_2.precision < 0.1  # but for some near edges, where the other wall lies as near
    assert at_5.precision > 0.97  # every second pixel of a map 3 m away leaves some cells empty
    assert at_10.precision > 0.99
    assert at_10.recall > 0.95
    # 13,000 random samples lie 2 cm and more from some cells' points; none lies 5 cm from one.
    assert score_against(reference, seen)[1].f_score > 0.95


def test_what_the_depth_camera_never_looked_at_is_not_judged(reference: DepthReference) -> None:
    behind, ahead, beyond = [0.1, 1.2, 1.0], [2.0, 1.2, 1.0], [4.0, 1.2, 1.0]
    assert is_judged(reference, np.array([behind, ahead, beyond])).tolist() == [False, True, False]
    assert is_free(reference, np.array([behind, ahead, beyond])).tolist() == [False, True, False]


def test_free_space_lies_within_the_room(reference: DepthReference) -> None:
    places = lattice(-0.5 * np.ones(3), SIZE + 0.5)
    free = places[is_free(reference, places)]
    assert len(free) > 10_000
    assert ((free > 0.0) & (free < SIZE)).all()


def test_a_cloud_of_another_scale_is_laid_onto_the_reference(reference: DepthReference) -> None:
    turn = rotation_matrix(np.array([np.cos(0.4), 0.0, np.sin(0.4), 0.0]))
    build_from_truth = Sim3(0.5, turn, np.array([1.0, -2.0, 3.0]))
    seen = samples_that_can_be_judged(reference)
    truth_from_build = Sim3(2.0, turn.T, -2.0 * turn.T @ build_from_truth.translation)
    nearly = Sim3(2.04, truth_from_build.rotation, truth_from_build.translation + 0.03)  # 4 cm of the far wall, and 5
    found = refined(build_from_truth.apply(seen), reference.points, nearly)
    # Points slide along the walls from round to round; less than a millimetre a round is left after 30.
    assert found.scale == pytest.approx(2.0, rel=0.005)
    assert np.linalg.norm(found.apply(build_from_truth.apply(seen)) - seen, axis=1).max() < CELL
