"""The user's own cuts: each makes a portal, whatever open ends are near, or an error says which did not and why."""

from __future__ import annotations

import re

import numpy as np
import pytest

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.closing.portals import Cut, cut_portals
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_scan
from aquanav_tools.cave.closing.solid import ClosedSurface
from aquanav_tools.cave.measure.statistics import measure_fit
from aquanav_tools.cave.scan.surface import NO_LAMPS, surface_from_mesh
from aquanav_tools.errors import MeshError
from aquanav_tools.synthetic.caves import SyntheticCave, sweep, without
from aquanav_tools.types import Array, Mesh

VOXEL = 0.085
LENGTH = 109.0
"""Of the gallery along x, m; it winds, so that its own length is more."""


def gallery(radius: float) -> SyntheticCave:
    along = np.linspace(0.0, LENGTH, 220)
    return sweep(np.stack([along, 6.0 * np.sin(along / 15.0), 2.0 * np.sin(along / 20.0)], axis=1), radius, 24)


def cut_across(cave: SyntheticCave, x: float, sign: float) -> Cut:
    """Return a cut in the middle of a gallery; what lies towards sign * x goes."""
    place = int(np.searchsorted(cave.centreline[:, 0], x))
    ahead = sign * (cave.centreline[place + 1] - cave.centreline[place - 1])
    return Cut(cave.centreline[place], ahead / np.linalg.norm(ahead))


def closed_with(cave: SyntheticCave, cuts: tuple[Cut, ...], shift: Array | float = 0.0, voxel: float = VOXEL) -> Cavity:
    mesh = Mesh(cave.truth.vertices + shift, cave.truth.faces)
    closed = ClosedSurface(mesh, np.ones(len(mesh.faces), dtype=bool), "made-up")
    return cut_portals(closed, mesh, (), voxel, tuple(Cut(cut.point + shift, cut.normal) for cut in cuts))


@pytest.mark.parametrize("slant", [0.0, 0.6])
def test_cuts_near_both_ends_of_a_long_wide_gallery_make_its_two_portals(slant: float) -> None:
    cave = gallery(4.5)
    middles = cave.mesh.triangles.mean(axis=1)
    before = slant * (middles[:, 1] + 4.5)  # the scan ends slantwise: to the right it begins later
    beyond = LENGTH - slant * np.abs(middles[:, 2] + 4.5)
    scan = without(cave.mesh, (middles[:, 0] < before) | (middles[:, 0] > beyond))
    cuts = cut_across(cave, 4.5 * slant + 4.0, -1.0), cut_across(cave, LENGTH - 4.5 * slant - 9.0, 1.0)
    surface = surface_from_mesh(scan, VOXEL, NO_LAMPS)
    cavity = close_scan(surface, ReconstructionOptions(VOXEL, 1.4, cuts=cuts)).cavity
    assert len(cavity.portals) == 2
    for portal, cut in zip(cavity.portals, cuts, strict=True):
        assert np.abs((portal.centre - cut.point) @ cut.normal) < VOXEL  # a cut moves inwards by a voxel at most
        assert portal.normal @ cut.normal == pytest.approx(1.0)


def test_a_cut_that_another_one_takes_away_is_named_with_the_reason() -> None:
    cave = gallery(1.6)
    first, wrong_way = cut_across(cave, 100.0, 1.0), cut_across(cave, 4.0, 1.0)
    named = [re.escape(f"cut at {cut.point.round(2)} m across {cut.normal.round(2)}") for cut in (first, wrong_way)]
    with pytest.raises(MeshError, match=rf"The {named[0]} makes no portal: the {named[1]} takes it away.* turn them"):
        closed_with(cave, (first, wrong_way))
    with pytest.raises(MeshError, match=rf"The {named[0]} misses the cave.*Or the {named[1]} takes that place away"):
        closed_with(cave, (wrong_way, first))


@pytest.mark.parametrize("shift", [0.0, 900.0])
def test_the_portal_of_a_cut_is_the_whole_section_also_far_from_the_origin(shift: float) -> None:
    cave = gallery(1.6)
    cuts = cut_across(cave, 4.0, -1.0), cut_across(cave, 100.0, 1.0)
    cavity = closed_with(cave, cuts, shift, voxel=0.03)
    section = 0.5 * 24 * np.sin(2.0 * np.pi / 24) * 1.6**2  # a prism over 24 sides, cut straight across
    assert [portal.area for portal in cavity.portals] == pytest.approx([section, section], rel=0.05)


def test_the_fit_counts_no_part_that_was_cut_off() -> None:
    cave = gallery(1.6)
    cavity = closed_with(cave, (cut_across(cave, 30.0, 1.0),))
    points = cave.truth.vertices
    fit = measure_fit(cavity, points, VOXEL, cave.truth)
    assert fit.percentile_95 < 1e-4  # three quarters of the points lie up to 80 m from what is left
    assert fit.within_voxel == 1.0
    off = points + 0.2 * cave.truth.to_trimesh().vertex_normals
    assert measure_fit(cavity, off, VOXEL, cave.truth).median == pytest.approx(0.2, rel=0.05)
