from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.report.viewer_model import PORTAL_COLOUR, WALL_COLOUR, transfer_colours, write_glb
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import Mesh

LENGTH = 6.0
ONE_STEP = 1
"""Colours are stored as linear light in 16 bits."""


def read(path: Path) -> trimesh.Trimesh:
    (mesh,) = trimesh.load(path, process=False).geometry.values()
    return mesh


def srgb(mesh: trimesh.Trimesh) -> np.ndarray:
    """(V, 3) in 0 to 255, from the linear light that glTF stores."""
    linear = np.asarray(mesh.visual.vertex_attributes["color"], dtype=np.float64)[:, :3] / 65535.0
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def farthest(truth: Mesh, level: trimesh.Trimesh) -> float:
    """How far a level's vertices, z up again, are from the truth at most."""
    x, y, z = level.vertices.T
    squared = igl.point_mesh_squared_distance(np.stack([x, -z, y], axis=1), truth.vertices, truth.faces)[0]
    return float(np.sqrt(squared.max()))


@pytest.fixture
def cavity() -> Cavity:
    mesh = tube(1.0, LENGTH, 64, 97).truth
    labels = np.full(len(mesh.faces), WALL, dtype=np.int64)
    for label, end in ((1, 0.0), (2, LENGTH)):
        labels[np.all(np.abs(mesh.triangles[..., 0] - end) < 1e-9, axis=1)] = label
    return Cavity(mesh, labels, mesh.triangles[..., 0].mean(axis=1) < 4.0, ())


def test_the_full_level_is_the_cavity_with_y_up(cavity: Cavity, tmp_path: Path) -> None:
    (level,) = write_glb(cavity, cavity.mesh, tmp_path / "cave.glb", levels=(1.0,))
    mesh = read(level.path)
    assert level.num_triangles == len(mesh.faces) == len(cavity.mesh.faces)
    x, y, z = cavity.mesh.triangles.reshape(-1, 3).T
    expected = np.stack([x, z, -y], axis=1).reshape(-1, 3, 3)
    assert mesh.triangles == pytest.approx(expected, abs=1e-6)  # 32-bit floats
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    assert mesh.is_volume  # closed, and not inside out
    assert mesh.volume == pytest.approx(cavity.volume, rel=1e-5)


def test_wall_unseen_wall_and_portals_are_told_apart(cavity: Cavity, tmp_path: Path) -> None:
    write_glb(cavity, cavity.mesh, tmp_path / "cave.glb", levels=(1.0,))
    mesh = read(tmp_path / "cave.glb")
    faces = srgb(mesh)[mesh.faces]
    assert faces == pytest.approx(np.repeat(faces[:, :1], 3, axis=1))  # no colour bleeds into its neighbours
    seen = (cavity.labels == WALL) & cavity.observed
    unseen = (cavity.labels == WALL) & ~cavity.observed
    assert np.abs(faces[seen] - WALL_COLOUR).max() <= ONE_STEP
    assert np.abs(faces[cavity.labels != WALL] - PORTAL_COLOUR).max() <= ONE_STEP
    assert np.all(faces[unseen][..., 0] > WALL_COLOUR[0] + 30)


def test_the_scans_colours_reach_the_file(cavity: Cavity, tmp_path: Path, rng: np.random.Generator) -> None:
    points = rng.uniform([0, -1, -1], [LENGTH, 1, 1], (20_000, 3))
    red = (40 * points[:, 0]).astype(np.uint8)
    colours = transfer_colours(cavity.mesh, points, np.stack([red, 200 - red // 2, red], axis=1))
    write_glb(cavity, cavity.mesh, tmp_path / "cave.glb", colours, (1.0,))
    mesh = read(tmp_path / "cave.glb")
    is_wall = np.zeros(len(mesh.vertices), dtype=bool)
    is_wall[mesh.faces[(cavity.labels == WALL) & cavity.observed]] = True
    # The nearest of 20,000 points is within 0.25 m, or ten steps of red.
    assert srgb(mesh)[is_wall, 0] == pytest.approx(40 * mesh.vertices[is_wall, 0], abs=12)


def test_coarser_levels_come_from_the_simplified_surface_with_the_colours_of_the_cavity(
    cavity: Cavity, tmp_path: Path
) -> None:
    simplified = tube(1.0, LENGTH, 64, 25).truth  # rings where every fourth of the cavity's is: unseen beyond x = 4
    _, level = write_glb(cavity, simplified, tmp_path / "cave.glb", levels=(1.0, 0.5))
    mesh = read(level.path)
    assert level.num_triangles == len(mesh.faces) == len(simplified.faces)
    middles = mesh.triangles[..., 0].mean(axis=1)
    is_wall = np.abs(middles - LENGTH / 2) < LENGTH / 2 - 0.01
    red = srgb(mesh)[mesh.faces][:, 0, 0]
    assert np.abs(red[is_wall & (middles < 3.9)] - WALL_COLOUR[0]).max() <= ONE_STEP
    assert red[is_wall & (middles > 4.1)].min() > WALL_COLOUR[0] + 30


def test_levels_have_fewer_triangles_and_stay_near_the_cave(cavity: Cavity, tmp_path: Path) -> None:
    bumpy = Mesh(
        cavity.mesh.vertices * (1 + 0.03 * np.sin(5 * cavity.mesh.vertices[:, :1]) * [0, 1, 1]), cavity.mesh.faces
    )
    levels = write_glb(Cavity(bumpy, cavity.labels, cavity.observed, ()), bumpy, tmp_path / "cave.glb")
    assert [level.path.name for level in levels] == ["cave.glb", "cave-lod1.glb", "cave-lod2.glb"]
    full = levels[0].num_triangles
    assert levels[1].num_triangles == pytest.approx(full / 4, rel=0.15)
    assert levels[2].num_triangles == pytest.approx(full / 16, rel=0.3)
    for level, bound in zip(levels, (1e-6, 0.1, 0.3), strict=True):
        mesh = read(level.path)
        mesh.merge_vertices(merge_norm=True, merge_tex=True)
        assert len(mesh.faces) == level.num_triangles
        assert mesh.is_volume
        assert farthest(bumpy, mesh) < bound
