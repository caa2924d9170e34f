"""Which ways from camera to camera are known to lead through water."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquanav_tools.build.photo_free_space import photo_free_space, ways_ahead
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.types import Array, PointCloud
from tests.cave.open_caves import LENGTH, RADIUS, bend, disc, joined, straight
from tests.cave.sights import sight_of


def reconstruction_at(centres: Array) -> Reconstruction:
    names, rotations = tuple(f"{index}.jpg" for index in range(len(centres))), np.tile(np.eye(3), (len(centres), 1, 1))
    return Reconstruction(PointCloud(np.zeros((0, 3))), centres, rotations, names, (), {})


def test_ways_along_a_passage_are_legs() -> None:
    centres = np.array([[1.0, 0.0, 0.2], [2.5, 0.3, 0.0], [4.0, 0.0, -0.2], [5.5, 0.1, 0.0]])
    found = replace(reconstruction_at(centres), sight=sight_of(straight(), centres, 0.0))
    free_space = photo_free_space(found, np.array([True, True, True, True]))
    np.testing.assert_array_equal(free_space.legs, np.stack([centres[:-1], centres[1:]], axis=1))
    np.testing.assert_array_equal(free_space.inside, centres)
    assert free_space.sight is found.sight


def test_a_camera_outside_has_no_leg_and_is_not_in_the_water() -> None:
    centres = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    found = replace(reconstruction_at(centres), sight=sight_of(straight(), centres, 0.0))
    free_space = photo_free_space(found, np.array([False, True, True]))
    np.testing.assert_array_equal(free_space.legs, centres[None, 1:])
    np.testing.assert_array_equal(free_space.inside, centres[1:])


def test_a_straight_way_through_the_rock_inside_a_bend_is_no_leg() -> None:
    wall = bend(5.0)  # a quarter turn around (0, 5, 0)
    centres = np.array([[0.3, 0.0, 0.0], [5.0, 4.7, 0.0]])
    assert 5.0 - np.linalg.norm(centres.mean(axis=0) - [0.0, 5.0, 0.0]) > RADIUS
    found = replace(reconstruction_at(centres), sight=sight_of(wall, centres, 45.0))
    assert photo_free_space(found, np.array([True, True])).legs.shape == (0, 2, 3)


def test_a_way_much_longer_than_the_others_was_not_swum() -> None:
    centres = np.array([[x, 0.0, 0.0] for x in (1.0, 1.5, 2.0, 2.5, 8.0, 8.5, 9.0)])
    found = replace(reconstruction_at(centres), sight=sight_of(straight(), centres, 0.0))
    legs = photo_free_space(found, np.ones(len(centres), bool)).legs
    np.testing.assert_array_equal(legs, np.stack([centres[:-1], centres[1:]], axis=1)[[0, 1, 2, 4, 5]])


def test_without_depth_maps_only_the_cameras_are_known() -> None:
    free_space = photo_free_space(reconstruction_at(np.zeros((3, 3))), np.array([True, False, True]))
    assert free_space.inside.shape == (2, 3)
    assert free_space.legs.shape == (0, 2, 3)
    assert free_space.sight is None


def test_where_open_walls_are_accepted_the_ways_ahead_of_cameras_are_water_too() -> None:
    centres = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    dead_end = joined(straight(), disc(LENGTH, 0.0, -1.0))
    found = replace(reconstruction_at(centres), sight=sight_of(dead_end, centres, 0.0))
    assert found.sight is not None
    ahead = ways_ahead(found.sight)
    np.testing.assert_allclose(ahead[:, 0], centres, atol=1e-9)
    # The middle of each photo shows the disc across the end and wall before it: half of the way there is water.
    assert (ahead[:, 1, 0] - centres[:, 0] <= 0.5 * (LENGTH - centres[:, 0])).all()
    assert (ahead[:, 1, 0] - centres[:, 0] > RADIUS).all()
    np.testing.assert_allclose(ahead[:, 1, 1:], 0.0, atol=1e-9)
    without, more = (photo_free_space(found, np.array([True, True]), accept_open=on).legs for on in (False, True))
    assert len(more) == len(without) + 2
