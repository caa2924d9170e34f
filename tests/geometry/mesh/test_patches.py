from __future__ import annotations

import numpy as np
import trimesh

from aquanav_tools.geometry.mesh.patches import boundary_loops, crowded_faces, find_patches, split_touching
from aquanav_tools.types import Mesh
from tests.cave.open_caves import SECTIONS, straight, wavy_sheet


def test_faces_turned_at_random_are_wound_one_way_again(rng: np.random.Generator) -> None:
    tube = straight()
    is_turned = rng.random(len(tube.faces)) < 0.5
    patches = find_patches(Mesh(tube.vertices, np.where(is_turned[:, None], tube.faces[:, ::-1], tube.faces)))
    assert patches.count == 1
    assert patches.mesh.to_trimesh().is_winding_consistent
    assert np.array_equal(np.sort(patches.mesh.faces, axis=1), np.sort(tube.faces, axis=1))


def test_separate_pieces_are_separate_patches() -> None:
    tube = straight()
    twice = Mesh(
        np.vstack([tube.vertices, tube.vertices + 10.0]), np.vstack([tube.faces, tube.faces + len(tube.vertices)])
    )
    patches = find_patches(twice)
    assert patches.count == 2
    assert np.bincount(patches.ids).tolist() == [len(tube.faces)] * 2


def test_a_patch_ends_where_three_faces_share_an_edge() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], dtype=float)
    book = Mesh(vertices, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    assert find_patches(book).count == 3
    assert crowded_faces(book.faces).all()
    assert not crowded_faces(wavy_sheet().faces).any()


def test_a_tube_has_a_loop_at_either_end_that_closes_it() -> None:
    tube = straight()
    loops = boundary_loops(split_touching(tube))
    assert sorted(len(loop) for loop in loops) == [SECTIONS, SECTIONS]
    closed = split_touching(tube)
    fans = [np.stack([loop[1:-1], loop[2:], np.full(len(loop) - 2, loop[0])], axis=1) for loop in loops]
    solid = trimesh.Trimesh(closed.vertices, np.concatenate([closed.faces, *fans]), process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent


def test_parts_that_touch_in_a_vertex_get_a_vertex_each() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [-1, -1, 0]], dtype=float)
    bow_tie = Mesh(vertices, np.array([[0, 1, 2], [0, 3, 4]]))
    split = split_touching(bow_tie)
    assert len(split.vertices) == 6
    assert np.array_equal(split.triangles, bow_tie.triangles)
    assert sorted(len(loop) for loop in boundary_loops(split)) == [3, 3]


def test_a_sound_mesh_keeps_its_vertices() -> None:
    tube = straight()
    assert len(split_touching(tube).vertices) == len(tube.vertices)
