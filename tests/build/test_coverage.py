"""Which wall photos show, in a tube where it can be told on paper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.build.coverage import MOST_OBLIQUE, count_photos
from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.reconstruct.record import DenseView
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import Array, Sim3

RADIUS = 2.0
AHEAD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""`cam_from_world` of a level camera that looks along x."""


@pytest.fixture(scope="module")
def cavity() -> Cavity:
    mesh = tube(RADIUS, 20.0, rings=201).truth
    is_lid = np.abs(mesh.normals[:, 0]) > 0.5
    return Cavity(mesh, np.where(is_lid, 1 + (mesh.normals[:, 0] > 0), WALL), ~is_lid, ())


def square_view(x: float, frame: Sim3 | None = None) -> DenseView:
    """A camera on the axis that looks along x, 90 degrees wide and high, given in another frame than the world's."""
    world_from_sfm = frame or Sim3()
    centre = (np.array([x, 0.0, 0.0]) - world_from_sfm.translation) @ world_from_sfm.rotation / world_from_sfm.scale
    matrix = np.array([[100.0, 0.0, 100.0], [0.0, 100.0, 100.0], [0.0, 0.0, 1.0]])
    return DenseView("p", matrix, AHEAD @ world_from_sfm.rotation, centre, (200, 200), Path("p.png"), None)


def expected(middles: Array, x: float) -> Array:
    """Wall inside a square frame of 90 degrees and seen at more than 10 degrees."""
    ahead, aside = middles[:, 0] - x, np.abs(middles[:, 1:]).max(axis=1)
    to_wall = RADIUS * np.cos(np.pi / 64)  # from the axis to the middle of a side
    distance = np.linalg.norm(middles - [x, 0.0, 0.0], axis=1)
    return (aside < ahead) & (to_wall > MOST_OBLIQUE * distance)


def test_a_camera_on_the_axis_sees_a_ring_of_wall(cavity: Cavity) -> None:
    middles, is_wall = cavity.mesh.triangles.mean(axis=1), cavity.labels == WALL
    counts = count_photos(cavity, [square_view(3.0)], Sim3())
    np.testing.assert_array_equal(counts[is_wall] == 1, expected(middles, 3.0)[is_wall])
    assert 0.3 < counts[is_wall].mean() < 0.7


def test_photos_add_up_in_any_frame(cavity: Cavity) -> None:
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    frame = Sim3(2.5, turn, np.array([3.0, -1.0, 0.5]))
    middles, is_wall = cavity.mesh.triangles.mean(axis=1), cavity.labels == WALL
    counts = count_photos(cavity, [square_view(x, frame) for x in (3.0, 5.0, 6.0)], frame)
    total = np.sum([expected(middles, x) for x in (3.0, 5.0, 6.0)], axis=0)
    np.testing.assert_array_equal(counts[is_wall], total[is_wall])


def test_one_looks_into_a_cave_through_its_portal_but_not_through_rock(cavity: Cavity) -> None:
    is_wall = cavity.labels == WALL
    through_portal = count_photos(cavity, [square_view(-1.0)], Sim3())[is_wall]
    assert through_portal.sum() > 100
    walled_up = replace(cavity, labels=np.zeros_like(cavity.labels))
    assert count_photos(walled_up, [square_view(-1.0)], Sim3())[is_wall].sum() == 0
