from __future__ import annotations

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.cave.closing import tiles
from aquanav_tools.cave.closing.field_edits import BAND_VOXELS, NO_EDITS, FieldEdits
from aquanav_tools.cave.closing.packed_samples import packed, unpacked
from aquanav_tools.cave.closing.tiles import TILE, TileCache, implicit_field, water_surface
from aquanav_tools.cave.closing.winding import winding_in_box
from aquanav_tools.cave.scan.sight import make_sight
from aquanav_tools.types import Mesh
from tests.cave.open_caves import without_faces_near

VOXEL = 0.05


def sphere(radius: float = 2.5) -> Mesh:
    """A sphere that spans several tiles."""
    solid = trimesh.creation.icosphere(5, radius)
    return Mesh(np.array(solid.vertices), np.array(solid.faces, dtype=np.int64))


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.vstack([mesh.vertices for mesh in meshes]), np.vstack(faces))


def test_tiles_join_without_a_seam() -> None:
    ball = sphere()
    assert 5.0 / VOXEL > TILE  # the sphere crosses the borders of tiles
    surface = water_surface(implicit_field(ball, VOXEL))
    prove_watertight(surface)
    radii = np.linalg.norm(surface.vertices, axis=1)
    # Smoothing by s voxels draws a sphere's wall inwards by s^2 / radius; interpolation errs less.
    assert np.abs(radii - 2.5).max() < 0.1 * VOXEL
    assert surface.to_trimesh().volume == pytest.approx(4 / 3 * np.pi * 2.5**3, rel=3e-3)


def test_the_surface_does_not_depend_on_where_tiles_begin() -> None:
    ball = sphere(1.5)
    stray = Mesh(ball.vertices * 0.02 + [-4.0, -3.0, -3.5], ball.faces)  # moves the lattice's origin
    bodies = water_surface(implicit_field(joined(ball, stray), VOXEL)).to_trimesh().split()
    largest = max(bodies, key=lambda body: body.volume)
    assert largest.is_watertight
    assert largest.volume == pytest.approx(water_surface(implicit_field(ball, VOXEL)).to_trimesh().volume, rel=1e-3)


def test_a_hole_is_closed_smoothly() -> None:
    holed = without_faces_near(sphere(), np.array([2.5, 0.0, 0.0]), 0.8)
    surface = water_surface(implicit_field(holed, VOXEL))
    prove_watertight(surface)
    cap = np.pi * 0.13**2 * (2.5 - 0.13 / 3)  # of the height that a chord of 0.8 m to its pole leaves: 0.8^2 / 5
    assert surface.to_trimesh().volume == pytest.approx(4 / 3 * np.pi * 2.5**3 - cap, rel=3e-3)


def test_a_known_leg_keeps_a_sealed_passage_open() -> None:
    left, right = sphere(1.0), sphere(1.0)
    apart = joined(left, Mesh(right.vertices + [2.3, 0.0, 0.0], right.faces))
    assert len(water_surface(implicit_field(apart, VOXEL)).to_trimesh().split()) == 2
    leg = np.array([[[0.0, 0.0, 0.0], [2.3, 0.0, 0.0]]])
    carved = water_surface(implicit_field(apart, VOXEL), FieldEdits(leg, np.array([0.2]), np.zeros((0, 5)), 0.0))
    prove_watertight(carved)
    gap = np.pi * 0.2**2 * 0.3
    balls = 2 * 4 / 3 * np.pi
    # Smoothing draws the wall of a ball of 1 m in by (0.6 voxels)^2 / 1 m: 0.7 % of its volume; samples do more.
    assert carved.to_trimesh().volume == pytest.approx(balls + gap, rel=0.015)


def test_a_leg_through_rock_far_from_any_wall_is_dug_all_the_way() -> None:
    apart = 4.0 * TILE * VOXEL
    left, right = sphere(0.5), sphere(0.5)
    both = joined(left, Mesh(right.vertices + [apart, 0.0, 0.0], right.faces))
    leg = np.array([[[0.0, 0.0, 0.0], [apart, 0.0, 0.0]]])
    carved = water_surface(implicit_field(both, VOXEL), FieldEdits(leg, np.array([0.2]), np.zeros((0, 5)), 0.0))
    prove_watertight(carved)
    assert len(carved.to_trimesh().split()) == 1


def test_what_is_sampled_again_is_as_if_it_were_sampled_at_first() -> None:
    ball = without_faces_near(sphere(1.0), np.array([1.0, 0.0, 0.0]), 0.4)
    stray = Mesh(ball.vertices * 0.02 + [-4.3, 0.0, 0.0], ball.faces)
    holed = joined(ball, stray)  # so that a border of tiles passes through the ball
    spurious = np.array([[0.0, 0.0, 1.0, 0.5, 0.0], [0.9, 0.0, 0.0, 0.4, 0.0]])
    edits = FieldEdits(np.array([[[0.0, 0.0, 0.0], [0.0, 1.6, 0.0]]]), np.array([0.2]), spurious, 0.2)
    field, cache = implicit_field(holed, VOXEL), TileCache()
    before = water_surface(field, NO_EDITS, cache)
    again, at_first = water_surface(field, edits, cache), water_surface(field, edits)
    assert not np.array_equal(again.vertices, before.vertices)
    assert np.array_equal(again.vertices, at_first.vertices)
    assert np.array_equal(again.faces, at_first.faces)
    assert again.to_trimesh().is_watertight


def test_a_pillar_across_a_border_of_tiles_is_smoothed_away_on_both_sides() -> None:
    ball = sphere(1.0)
    rod = trimesh.creation.cylinder(0.06, 1.96, sections=24)
    rod.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    pillar = Mesh(np.array(rod.vertices), np.array(rod.faces, dtype=np.int64)[:, ::-1])
    stray = Mesh(ball.vertices * 0.02 + [-4.3, 0.0, 0.0], ball.faces)  # so that a border of tiles crosses the rod
    field, cache = implicit_field(joined(ball, pillar, stray), VOXEL), TileCache()
    border = np.flatnonzero(np.abs(field.lattice.origin[0] + VOXEL * TILE * np.arange(1, 4)) < 0.3)
    assert len(border) == 1
    before = max(water_surface(field, NO_EDITS, cache).to_trimesh().split(), key=lambda body: body.volume)
    assert before.euler_number == 0  # it joins wall and wall
    edits = FieldEdits(NO_EDITS.legs, NO_EDITS.leg_radii, np.array([[0.0, 0.0, 0.0, 0.6, 0.0]]), 0.15)
    after = max(water_surface(field, edits, cache).to_trimesh().split(), key=lambda body: body.volume)
    assert after.is_watertight and after.euler_number == 2
    gone = np.pi * 0.06**2 * 1.2
    # The rod is 1.2 voxels thick: it was drawn half as thick or twice.
    assert 0.3 * gone < after.volume - before.volume < 3.0 * gone


def test_no_tile_is_sampled_again_for_its_next_corrections(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(tiles, "winding_in_box", lambda *given: (asked.append(None), winding_in_box(*given))[1])
    field, cache = implicit_field(sphere(1.0), VOXEL), TileCache()
    water_surface(field, NO_EDITS, cache)
    counts = []
    for height in (0.7, 0.8, 0.9):
        leg = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, height + 0.5]]])
        edits = FieldEdits(leg, np.array([0.2]), np.array([[0.0, 0.0, height, 0.3, 0.0]]), 0.1)
        surface = water_surface(field, edits, cache)
        assert surface.vertices[:, 2].max() == pytest.approx(height + 0.7, abs=VOXEL)
        counts.append(len(asked))
    assert counts[0] == counts[1] == counts[2]


def test_packed_samples_come_back_as_they_were(rng: np.random.Generator) -> None:
    samples = np.clip(rng.normal(0.0, 3.0, (17, 18, 19)), -BAND_VOXELS, BAND_VOXELS).astype(np.float32)
    assert 0.2 < (np.abs(samples) < BAND_VOXELS).mean() < 0.8
    np.testing.assert_array_equal(unpacked(packed(samples)), samples)


@pytest.mark.parametrize("shift", [0.0, 0.2, 0.5])
def test_a_narrow_beam_that_cameras_looked_along_leaves_no_seam_where_it_enters_a_tile(shift: float) -> None:
    ball = sphere(1.0)
    # Three cameras look out of the ball through a hole, along +x, at wall 40 m away: a beam that widens to 0.4 m.
    places = np.array([[0.0, shift + y, shift] for y in (-0.01, 0.0, 0.01)])
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    poses = np.array([np.column_stack([turn, -turn @ place]) for place in places])
    pinholes = np.tile([100.0, 100.0, 2.0, 2.0], (3, 1))
    sight = make_sight(poses, pinholes, [np.full((4, 4), 40.0, dtype=np.float32)] * 3)
    far = Mesh(np.array([[12.0, 9.0, 9.0], [12.1, 9.0, 9.0], [12.0, 9.1, 9.0]]), np.array([[0, 1, 2]]))
    holed = without_faces_near(ball, np.array([1.0, shift, shift]), 0.3)
    surface = water_surface(implicit_field(joined(holed, far), VOXEL, sight))
    assert surface.vertices[:, 0].max() > TILE * VOXEL  # out of the ball's tiles
    assert surface.to_trimesh().is_watertight
