from __future__ import annotations

import numpy as np
import pytest
import trimesh

from aquanav_tools.geometry.mesh.rays import NOTHING, RayScene
from aquanav_tools.types import Array, Mesh

FAR_OFF = np.array([4.0e5, 5.3e6, 0.0])
"""As of a national grid, m: float32 resolves half a metre there."""


def box(offset: Array) -> Mesh:
    """A cube with edges of 2 m around a place."""
    cube = trimesh.creation.box((2.0, 2.0, 2.0))
    return Mesh(np.array(cube.vertices) + offset, np.array(cube.faces, dtype=np.int64))


@pytest.mark.parametrize("offset", [np.zeros(3), FAR_OFF], ids=["at the origin", "far off"])
def test_rays_from_the_middle_of_a_cube_meet_its_walls(offset: Array, rng: np.random.Generator) -> None:
    ways = rng.normal(size=(500, 3))
    scene, mesh = RayScene(box(offset)), box(offset)
    met = scene.hits(offset, ways)
    exact = 1.0 / np.abs(ways).max(axis=1)  # in lengths of the ways
    assert np.allclose(met.lengths, exact, rtol=1e-5)
    assert np.array_equal(scene.lengths(offset, ways), met.lengths)
    assert np.array_equal(scene.faces(np.tile(offset, (500, 1)), ways), met.faces)
    places = np.einsum("nk,nkd->nd", met.weights, mesh.triangles[met.faces])
    assert np.allclose(places, offset + met.lengths[:, None] * ways, atol=1e-5)


def test_what_meets_nothing_says_so() -> None:
    scene, ways = RayScene(box(np.zeros(3))), np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    met = scene.hits(np.array([3.0, 0.0, 0.0]), ways)
    assert met.faces[0] == NOTHING and np.isinf(met.lengths[0]) and met.is_hit.tolist() == [False, True]
    assert scene.lengths(np.array([3.0, 0.0, 0.0]), ways).tolist() == [np.inf, 2.0]


def test_a_way_is_clear_up_to_its_end() -> None:
    scene = RayScene(box(np.zeros(3)))
    starts = np.zeros((3, 3))
    assert scene.is_clear(starts, np.array([[0.9, 0, 0], [1.1, 0, 0], [0, -0.5, 0]])).tolist() == [True, False, True]
    assert scene.is_clear(np.zeros(3), np.zeros((0, 3))).shape == (0,)
