"""Sizes that no cave has are refused with the unit that fits, and a gallery that was stood on its end is noticed."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan.plausibility import METRES_PER_UNIT, check_size, upright_cautions
from aquanav_tools.cave.scan.read import read_scan
from aquanav_tools.cave.scan.resolution import choose_resolution
from aquanav_tools.cave.scan.wall_samples import passage_widths, sample_wall
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.synthetic.caves import sweep, tube
from aquanav_tools.synthetic.damage import duplicate_shell, intact
from aquanav_tools.types import Array, Mesh, PointCloud

RADIUS, LENGTH = 1.5, 109.0
DATA = Path(os.environ.get("AQUANAV_DATA", "nowhere"))
SCANS = {"finnish": DATA / "scan_finnish_cave1" / "cave1.stl", "han": DATA / "scan_han_sur_lesse" / "cave.stl"}
needs_scans = pytest.mark.skipif(not SCANS["han"].is_file(), reason="needs the shared data")


def gallery(turn: Array | None = None) -> Mesh:
    """A winding gallery along x, wider than high; its axes turned to others where asked."""
    along = np.linspace(0.0, LENGTH, 220)
    line = np.stack([along, 6.0 * np.sin(along / 15.0), 1.0 * np.sin(along / 20.0)], axis=1)
    mesh = sweep(line, RADIUS, 24).mesh
    return mesh if turn is None else Mesh(mesh.vertices[:, turn], mesh.faces)


def scaled(surface: Mesh | PointCloud, factor: float) -> Mesh | PointCloud:
    if isinstance(surface, Mesh):
        return Mesh(factor * surface.vertices, surface.faces)
    return PointCloud(factor * surface.points)


@pytest.fixture(scope="module", params=["mesh", "cloud"])
def scan(request: pytest.FixtureRequest) -> Mesh | PointCloud:
    wall = sample_wall(gallery())
    assert wall is not None
    return gallery() if request.param == "mesh" else PointCloud(wall.length * wall.points)


def refusal(surface: Mesh | PointCloud, unit: str | None) -> str:
    with pytest.raises(InputError) as told:
        check_size(surface, sample_wall(surface), unit)
    return str(told.value)


def test_every_unit_that_can_be_given_has_its_length() -> None:
    unit = get_args(get_type_hints(ScanOptions)["unit"])
    assert set(get_args(unit[0])) == set(METRES_PER_UNIT)


def test_passages_are_as_wide_as_from_wall_to_wall(scan: Mesh | PointCloud) -> None:
    wall = sample_wall(scan)
    assert wall is not None
    # Steps of 15 %, and wall is met 13 % before it is reached.
    assert np.median(passage_widths(wall)) == pytest.approx(2.0 * RADIUS, rel=0.2)


def test_a_wall_that_was_scanned_twice_is_no_passage() -> None:
    twice = duplicate_shell(intact(tube(1.2, 10.0, sections=48, rings=81)), 0.03, 0.5, 1).mesh
    check_size(twice, sample_wall(twice), "m")


@pytest.mark.parametrize(("unit", "metres"), [("cm", r"1\.1"), ("mm", r"0\.11"), ("km", r"10[78],\d{3}")])
def test_a_wrong_unit_is_refused_with_numbers_and_the_right_one(
    unit: str, metres: str, scan: Mesh | PointCloud
) -> None:
    told = refusal(scan, unit)
    assert re.match(rf"With --unit {unit} the cave is {metres} m long, and its passages are about \S+ m wide\.", told)
    assert re.search(r"in metres, in which it is 10[78] m long with passages (2\.\d|3) m wide: give --unit m\.$", told)


@pytest.mark.parametrize("unit", ["cm", "mm"])
def test_without_a_unit_the_one_that_fits_is_proposed(unit: str, scan: Mesh | PointCloud) -> None:
    surface = scaled(scan, 1.0 / METRES_PER_UNIT[unit])
    assert f"Then give --unit {unit}." in refusal(surface, None)
    check_size(surface, sample_wall(surface), unit)


@pytest.mark.parametrize("factor", [1e-300, 1e-12, 1e12, 1e300])
@pytest.mark.parametrize("unit", [None, *METRES_PER_UNIT])
def test_sizes_beyond_all_measure_are_refused_in_any_unit(factor: float, unit: str | None) -> None:
    assert "No cave is of that size, and no other unit makes it one" in refusal(scaled(gallery(), factor), unit)


def test_a_cave_too_large_for_the_memory_is_refused_before_the_work() -> None:
    with pytest.raises(ResourceError, match=r"m2 of wall\. Within 4\.0 GB .* times the vehicle's radius.*--unit"):
        choose_resolution(scaled(gallery(), 100.0), 0.17, 4.0)


def cautions(surface: Mesh, up: str, name: str = "cave.stl") -> str:
    found = upright_cautions(surface, sample_wall(surface), ScanOptions(up=up), Path(name))  # type: ignore[arg-type]
    return "".join(sentence for code, sentence in found if code == "stands-on-end")


@pytest.mark.parametrize("up", ["y", "-y", "x"])
def test_a_level_gallery_that_an_option_stood_on_its_end_is_noticed(up: str) -> None:
    axis = "xyz".index(up[-1])
    along = np.array([0, 1, 2]) if axis == 0 else np.array([1, 0, 2])  # the gallery runs along that axis
    told = cautions(gallery(along), up)
    assert f"With --up {up} the cave is a shaft: 108 high" in told
    assert f"longest axis is the file's {up[-1]}" in told
    assert "--up z (the default) fits" in told
    assert not cautions(gallery(along), "z")


def test_a_shaft_in_the_file_s_own_axes_is_a_shaft() -> None:
    shaft = gallery(np.array([1, 2, 0]))
    assert not cautions(shaft, "z")
    assert not cautions(shaft, "x")
    assert "--up y fits" in cautions(shaft, "z", "cave.glb")  # of a format that has y up
    assert not cautions(gallery(), "y", "cave.glb")


@needs_scans
@pytest.mark.parametrize("name", SCANS)
def test_real_scans_are_taken_as_they_are_and_refused_in_other_units(name: str) -> None:
    assert not read_scan(SCANS[name], ScanOptions()).cautions
    assert not read_scan(SCANS[name], ScanOptions(unit="m")).cautions
    for unit in ("cm", "mm", "km"):
        with pytest.raises(InputError, match="give --unit m"):
            read_scan(SCANS[name], ScanOptions(unit=unit))  # type: ignore[arg-type]


@needs_scans
@pytest.mark.parametrize(("name", "up"), [("han", "y"), ("finnish", "x"), ("finnish", "-x")])
def test_real_galleries_on_their_end_are_noticed(name: str, up: str) -> None:
    (found,) = read_scan(SCANS[name], ScanOptions(up=up)).cautions  # type: ignore[arg-type]
    assert found[0] == "stands-on-end"
    assert "--up z (the default) fits" in found[1]
    print(found[1])
