from __future__ import annotations

import manifold3d
import numpy as np
import pytest
import trimesh
from skimage.measure import marching_cubes

from aquanav_tools.cave.cavity import from_manifold, to_manifold
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.half_edges import cut_and_cap, half_edges
from aquanav_tools.geometry.mesh.handles import find_handles, genus
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.synthetic.mines import MineOptions, mine
from aquanav_tools.types import Mesh

EDGE_PATHS = 1.15
"""A loop along the edges of a triangulation of slivers is about this much longer than the curve it follows."""


def torus(major: float, minor: float) -> Mesh:
    solid = trimesh.creation.torus(major, minor, major_sections=96, minor_sections=48)
    return Mesh(np.array(solid.vertices), np.array(solid.faces, dtype=np.int64))


def test_a_sphere_has_no_handle() -> None:
    sphere = trimesh.creation.icosphere(3)
    mesh = Mesh(np.array(sphere.vertices), np.array(sphere.faces, dtype=np.int64))
    assert genus(mesh) == 0
    assert find_handles(mesh) == ()


@pytest.mark.parametrize(
    ("major", "minor", "radius", "is_pillar"),
    [(3.0, 1.0, 1.0, False), (2.0, 1.5, 0.5, True)],  # around the tube, or around the hole in its middle
)
def test_the_loop_of_a_torus_is_its_shorter_circle(major: float, minor: float, radius: float, is_pillar: bool) -> None:
    mesh = torus(major, minor)
    (handle,) = find_handles(mesh)
    assert genus(mesh) == 1
    assert handle.diameter == pytest.approx(2.0 * radius, rel=0.005)  # a polygon of 48 sides is 0.1 % shorter
    assert handle.is_pillar == is_pillar
    assert np.allclose(np.linalg.norm(handle.points - handle.centre, axis=1), radius, atol=0.01)


def test_two_joined_rings_have_one_handle_each() -> None:
    rings = to_manifold(torus(3.0, 1.0)) + to_manifold(torus(2.0, 0.5)).translate([5.0, 0.0, 0.0])
    handles = find_handles(from_manifold(rings))
    assert [handle.is_pillar for handle in handles] == [False, False]
    assert handles[0].diameter == pytest.approx(1.0, rel=0.02)
    assert handles[1].diameter == pytest.approx(2.0, rel=0.02)
    assert handles[0].centre[0] > handles[1].centre[0]


def test_a_pillar_in_a_passage_is_found_where_it_stands() -> None:
    water = to_manifold(tube(2.0, 12.0, 64, 49).truth)
    pillar = manifold3d.Manifold.cylinder(8.0, 0.4, circular_segments=32, center=True).translate([7.0, 0.5, 0.0])
    mesh = from_manifold((water - pillar).refine_to_length(0.3))
    (handle,) = find_handles(mesh)
    assert handle.is_pillar
    assert 0.8 * 0.99 < handle.diameter < 0.8 * EDGE_PATHS
    assert handle.centre[:2] == pytest.approx([7.0, 0.5], abs=0.05)


def test_a_window_between_two_chambers_is_the_narrowest_way_around() -> None:
    # Two passages side by side, joined by two cross passages: one ring; its thinnest place is the narrower of these.
    solid = manifold3d.Manifold.cube([10.0, 2.0, 2.0])
    solid += manifold3d.Manifold.cube([10.0, 2.0, 2.0]).translate([0.0, 4.0, 0.0])
    for x, width in ((2.0, 1.2), (7.0, 0.8)):
        solid += manifold3d.Manifold.cube([width, 4.0, width]).translate([x, 1.0, 0.5])
    (handle,) = find_handles(from_manifold(solid.refine_to_length(0.2)))
    assert not handle.is_pillar
    assert handle.length == pytest.approx(3.2, rel=0.05)
    assert 7.0 <= handle.centre[0] <= 7.8


def test_every_pillar_of_a_mine_is_a_handle_of_its_own() -> None:
    rooms = (5, 9)
    solid = mine(MineOptions(rooms=rooms)).truth.solid
    assert solid is not None
    handles = find_handles(from_manifold(to_manifold(solid).refine_to_length(2.0)))
    assert len(handles) == rooms[0] * rooms[1]
    # The way around the water between two pillars, and around the largest pillar.
    shortest, longest = 2.0 * (6.0 + 6.0), 4.0 * 9.0
    assert shortest * 0.999 < handles[0].length < shortest * EDGE_PATHS
    assert handles[-1].length < longest * EDGE_PATHS


def test_noise_handles_on_a_rough_surface_are_all_listed_and_small(rng: np.random.Generator) -> None:
    axes = np.meshgrid(*[np.linspace(-1.5, 1.5, 41)] * 3, indexing="ij")
    field = np.linalg.norm(axes, axis=0) - 1.0 + 0.09 * rng.normal(size=axes[0].shape)
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(0.075,) * 3, gradient_direction="descent")
    noisy = from_manifold(
        max(to_manifold(Mesh(vertices, faces.astype(np.int64))).decompose(), key=lambda p: p.volume())
    )
    handles = find_handles(noisy)
    assert len(handles) == genus(noisy) == _genus_by_euler(noisy) > 10
    assert max(handle.diameter for handle in handles) < 0.5  # a few voxels, nothing around the whole ball


def _genus_by_euler(mesh: Mesh) -> int:
    return 1 - (len(np.unique(mesh.faces)) - len(mesh.faces) // 2) // 2


def test_cutting_along_a_loop_leaves_a_closed_surface_with_one_handle_less() -> None:
    surface = half_edges(torus(3.0, 1.0))
    start = int(np.argmax(surface.points[surface.tail][:, 0]))
    loop = [start]
    while (edge := _straight_on(surface, loop[-1])) != start:
        loop.append(edge)
    cut = cut_and_cap(surface, np.array(loop))
    assert np.array_equal(cut.twin[cut.twin], np.arange(len(cut.twin)))
    assert np.array_equal(cut.tail[cut.first], np.arange(len(cut.first)))
    following = np.arange(len(cut.tail)).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    assert np.array_equal(cut.tail[following], cut.tail[cut.twin])
    assert len(cut.first) - len(cut.tail) // 6 == 2  # Euler: a sphere


def _straight_on(surface: object, edge: int) -> int:
    """The half-edge that continues best in the same direction and at the same angle around the torus' axis."""
    head = surface.tail[surface.twin[edge]]  # type: ignore[attr-defined]
    points = surface.points  # type: ignore[attr-defined]
    leaving = np.flatnonzero(surface.tail == head)  # type: ignore[attr-defined]
    along = points[head] - points[surface.tail[edge]]  # type: ignore[attr-defined]
    steps = points[surface.tail[surface.twin[leaving]]] - points[head]  # type: ignore[attr-defined]
    return int(leaving[np.argmax(steps @ along / np.linalg.norm(steps, axis=1))])


def test_an_open_surface_is_refused() -> None:
    with pytest.raises(MeshError, match=r"edges of the .* Close the surface first"):
        genus(tube(1.0, 4.0, 16, 9).mesh)
