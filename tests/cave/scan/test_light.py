from __future__ import annotations

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.cave.scan.light import dark_faces
from aquanav_tools.cave.scan.orientation import face_areas
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.synthetic import caves, damage, networks
from aquanav_tools.synthetic.rock import embed_in_rock
from aquanav_tools.types import Mesh, PointCloud

OFFSET = 0.01
RADIUS, LENGTH = 1.2, 10.0
MIDDLE = np.array([[0.5 * LENGTH, 0.0, 0.0]])


def tube_in_rock(margin: float = 1.0) -> Mesh:
    return embed_in_rock(damage.intact(caves.tube(RADIUS, LENGTH, 32, 41)), margin).mesh


def is_tunnel(mesh: Mesh) -> np.ndarray:
    return np.linalg.norm(mesh.triangles[..., 1:], axis=2).max(axis=1) < RADIUS + 1e-6


@pytest.mark.parametrize("margin", [0.3, 1.0, 10.0])
def test_a_lamp_in_a_tunnel_lights_the_tunnel_and_not_the_block(margin: float) -> None:
    block = tube_in_rock(margin)
    assert np.array_equal(dark_faces(block, MIDDLE, OFFSET), ~is_tunnel(block))


def test_light_goes_round_the_turns_of_a_helix() -> None:
    helix = networks.helix()
    axis = helix.passages[0].axis
    assert not dark_faces(helix.scan(), axis[:1] + 0.05 * (axis[1] - axis[0]), OFFSET).any()


def test_a_sealed_cave_is_lit_and_the_box_around_it_dark() -> None:
    cave, box = trimesh.creation.icosphere(3, 2.0), trimesh.creation.box([6.0, 6.0, 6.0])
    both = trimesh.util.concatenate([cave, box])
    dark = dark_faces(Mesh(np.array(both.vertices), np.array(both.faces)), np.zeros((1, 3)), OFFSET)
    assert np.array_equal(dark, np.arange(len(dark)) >= len(cave.faces))


def test_without_a_lamp_nothing_is_dark() -> None:
    assert not dark_faces(tube_in_rock(), np.zeros((0, 3)), OFFSET).any()


def test_a_small_dark_part_stays_for_others_to_judge() -> None:
    tube, box = caves.tube(RADIUS, LENGTH, 32, 41).mesh.to_trimesh(), trimesh.creation.box([1.0, 1.0, 1.0])
    both = trimesh.util.concatenate([tube, box.apply_translation([5.0, 0.0, 3.0])])
    assert not dark_faces(Mesh(np.array(both.vertices), np.array(both.faces)), MIDDLE, OFFSET).any()


def test_the_tunnel_of_a_block_becomes_an_open_surface_that_faces_its_water() -> None:
    surface = surface_from_mesh(tube_in_rock(), 0.1, MIDDLE)
    areas, normals = face_areas(surface.mesh)
    middles = surface.mesh.triangles.mean(axis=1) * [0.0, 1.0, 1.0]
    assert (np.einsum("fi,fi->f", normals, middles) > 0.9 * np.linalg.norm(middles, axis=1)).all()
    # A prism of 32 sides, 1 mm shorter at either end.
    perimeter = 2.0 * 32 * RADIUS * np.sin(np.pi / 32)
    assert areas.sum() == pytest.approx(perimeter * (LENGTH - 2e-3), rel=1e-6)


def test_of_a_cloud_of_a_block_the_points_of_the_tunnel_stay() -> None:
    points, _ = trimesh.sample.sample_surface(tube_in_rock().to_trimesh(), 60_000, seed=0)
    surface = surface_from_cloud(PointCloud(np.asarray(points)), 0.15, MIDDLE)
    radii = np.linalg.norm(surface.points[:, 1:], axis=1)
    assert np.quantile(np.abs(radii - RADIUS), 0.98) < 0.05
