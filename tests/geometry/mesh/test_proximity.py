"""Points near a surface, lines through one, and the pieces and seams of meshes, against closed forms and a peer."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import trimesh

from aquanav_tools.geometry.mesh.components import component, component_ids, component_volumes
from aquanav_tools.geometry.mesh.piercings import signed_piercings
from aquanav_tools.geometry.mesh.proximity import are_within, surface_tree
from aquanav_tools.geometry.mesh.welding import weld
from aquanav_tools.types import Mesh


def ball(radius: float, middle: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    solid = trimesh.creation.icosphere(3, radius)
    return Mesh(np.array(solid.vertices) + middle, np.array(solid.faces, dtype=np.int64))


def test_the_same_points_are_near_as_by_igl(rng: np.random.Generator) -> None:
    mesh, points = ball(1.0), rng.uniform(-1.5, 1.5, (2000, 3))
    squared = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[0]
    for distance in (0.01, 0.2, 0.9):
        assert np.array_equal(are_within(surface_tree(mesh), points, distance), squared <= distance**2)


def test_nothing_is_near_no_surface() -> None:
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    assert not are_within(surface_tree(nothing), np.zeros((5, 3)), 1e9).any()


@pytest.mark.parametrize("shift", [0.0, 0.37])
def test_counting_piercings_tells_inside_from_outside(shift: float) -> None:
    # Unshifted, lines run through corners and along edges of the box, which no face may count twice or leave out.
    box = trimesh.creation.box([4.0, 6.0, 8.0])
    mesh = Mesh(np.array(box.vertices) + shift, np.array(box.faces, dtype=np.int64))
    origin, count = np.full(3, -7.5), 16
    inside = (np.abs(np.indices((count,) * 3).T + origin - shift) < [2.0, 3.0, 4.0]).all(axis=-1).T.astype(np.int64)
    for axis, gains in enumerate(signed_piercings(mesh.triangles, origin, 1.0, (count,) * 3)):
        counted = np.cumsum(gains, axis=axis, dtype=np.int64)
        assert np.array_equal(np.delete(counted, -1, axis=axis), np.delete(inside, 0, axis=axis))


def test_pieces_are_told_apart_with_their_volumes() -> None:
    one, other = ball(1.0), ball(0.5, (3.0, 0.0, 0.0))
    both = Mesh(
        np.vstack([one.vertices, other.vertices]), np.vstack([other.faces[:, ::-1] + len(one.vertices), one.faces])
    )
    ids, count = component_ids(both)
    volumes = component_volumes(both, ids, count)
    assert sorted(volumes) == pytest.approx([-other.volume, one.volume])
    assert component(both, ids == np.argmax(volumes)).volume == pytest.approx(one.volume)


def test_a_soup_is_welded_and_loses_what_is_no_face() -> None:
    mesh = ball(1.0)
    corners = mesh.triangles.reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    bad = np.array([[0, 1, 1], [2, 0, 1], [0, 2, 1], [0, len(corners), 1]])
    on_edge = 0.5 * (corners[:1] + corners[1:2])
    welded = weld(Mesh(np.vstack([corners, on_edge]), np.vstack([faces, bad])))
    assert len(welded.vertices) == len(mesh.vertices) and len(welded.faces) == len(mesh.faces)
    assert welded.to_trimesh().is_watertight
    assert welded.volume == pytest.approx(mesh.volume)
