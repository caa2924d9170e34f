"""Patches of wall that nobody saw, in a tube."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.measure.unseen import PIECE_REACH, ROOM, TO_WALL, unseen_patches
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import BoolArray, Mesh
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_field


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return tube(TUBE_RADIUS, TUBE_LENGTH, sections=128, rings=401).truth


@pytest.fixture(scope="module")
def field() -> DistanceField:
    return tube_field()


def cavity(mesh: Mesh, is_unseen: BoolArray) -> Cavity:
    is_lid = np.abs(mesh.normals[:, 0]) > 0.5
    return Cavity(mesh, np.where(is_lid, 1, WALL), ~is_unseen, ())


def around(mesh: Mesh, x: float, angle_deg: float, length: float, width: float) -> BoolArray:
    """Faces within `length` m along the tube and `width` m of its girth about a place, 0 degrees left, 90 up."""
    middles = mesh.triangles.mean(axis=1)
    angle = np.arctan2(middles[:, 2], middles[:, 1]) - np.radians(angle_deg)
    girth = TUBE_RADIUS * np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    return (np.abs(middles[:, 0] - x) < 0.5 * length) & (girth < 0.5 * width)


def test_a_known_patch_is_found_with_its_area_and_a_place_to_look_from(mesh: Mesh, field: DistanceField) -> None:
    (patch,) = unseen_patches(cavity(mesh, around(mesh, 8.0, 90.0, 1.5, 1.2)), field)
    assert patch.area == pytest.approx(1.5 * 1.2, rel=0.05)  # faces of 5 x 10 cm at its border
    np.testing.assert_allclose(patch.centre, [8.0, 0.0, TUBE_RADIUS], atol=0.1)
    np.testing.assert_allclose(patch.outward, [0.0, 0.0, 1.0], atol=0.05)
    np.testing.assert_allclose(patch.stand, [8.0, 0.0, TUBE_RADIUS - TO_WALL], atol=0.1)
    np.testing.assert_allclose(patch.ahead, [0.0, 0.0, 1.0], atol=0.05)
    assert patch.clearance == pytest.approx(TO_WALL, abs=0.05)


def test_two_patches_come_largest_first_and_specks_not_at_all(mesh: Mesh, field: DistanceField) -> None:
    large, small = around(mesh, 5.0, 0.0, 2.0, 1.0), around(mesh, 12.0, 180.0, 1.0, 1.0)
    speck = around(mesh, 16.0, 45.0, 0.1, 0.2)
    assert speck.any()
    patches = unseen_patches(cavity(mesh, large | small | speck), field)
    assert [round(patch.area) for patch in patches] == [2, 1]
    np.testing.assert_allclose(patches[1].outward, [0.0, -1.0, 0.0], atol=0.05)


def test_a_long_patch_is_cut_into_pieces_that_fit_a_view_each(mesh: Mesh, field: DistanceField) -> None:
    unseen = around(mesh, 10.0, 90.0, 14.0, 1.0)
    patches = unseen_patches(cavity(mesh, unseen), field)
    assert len(patches) >= 14.0 / (2 * PIECE_REACH)
    assert np.sum([patch.area for patch in patches]) == pytest.approx(mesh.areas[unseen].sum())
    assert len(np.unique(np.concatenate([patch.faces for patch in patches]))) == unseen.sum()
    for patch in patches:
        assert np.ptp(mesh.triangles.mean(axis=1)[patch.faces, 0]) < 2 * PIECE_REACH


def test_wall_unseen_on_both_sides_is_looked_at_from_two_places(mesh: Mesh, field: DistanceField) -> None:
    ring = around(mesh, 10.0, 0.0, 1.5, 100.0)
    patches = unseen_patches(cavity(mesh, ring), field)
    assert len(patches) >= 3
    for patch in patches:
        assert patch.clearance > ROOM
        assert patch.ahead @ patch.outward > 0.9


def test_where_all_was_seen_there_is_no_patch(mesh: Mesh, field: DistanceField) -> None:
    assert unseen_patches(cavity(mesh, np.zeros(len(mesh.faces), bool)), field) == ()
