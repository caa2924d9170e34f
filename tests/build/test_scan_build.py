"""The command aquanav-build-cave on scans: its main function, and as a process where that matters."""

from __future__ import annotations

import functools
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from aquanav_tools.build import scenario_folder
from aquanav_tools.cli.build_cave import main
from aquanav_tools.cli.info import main as aquanav_command
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.synthetic.damage import add_noise, intact
from aquanav_tools.values import kept_value
from tests.commands import run_here
from tests.conftest import REPOSITORY
from tests.disks import fill, small_disk
from tests.lighter import lighten_builds

LENGTH = 6.0
"""Of the tube, m."""
OUTPUTS = {
    "scenario.toml", "cave.ply", "cave.glb", "collision.obj", "field.npz", "flow.npz", "guide.json", "starts.json",
    "vehicle.toml", "report.html", "report.json", "build.rrd", "build.json", "cave.png", "cave-lod1.glb",
    "cave-lod2.glb", "view.glb", "drawings", "work",
}  # fmt: skip


run = functools.partial(run_here, main)


BUILD = "from aquanav_tools.cli.build_cave import main; main()"
WITHOUT_PICTURES = "import pytest; from tests import lighter; lighter.leave_out_pictures(pytest.MonkeyPatch())"


def run_as_a_process(*arguments: object, code: str = BUILD) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "tube.stl"
    tube(1.0, LENGTH, sections=32, rings=31).mesh.to_trimesh().export(path)
    return path


@pytest.fixture(scope="module")
def built(scan: Path) -> Path:
    folder = scan.parent / "built"
    result = run(scan, "-o", folder, "--name", "tube", "--starts.count", 20)
    assert result.returncode == 0, result.stderr
    assert "watertight; 2 portals" in result.stdout
    return folder


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only `built` has them, which is made before any fixture of a single test."""
    lighten_builds(monkeypatch)


def test_the_halves_of_a_scan_in_two_files_become_one_cave(built: Path, scan: Path, tmp_path: Path) -> None:
    whole = trimesh.load(scan)
    is_first = whole.triangles_center[:, 0] < 0.5 * LENGTH
    for name, faces in (("a.stl", is_first), ("b.stl", ~is_first)):
        whole.submesh([np.flatnonzero(faces)], append=True).export(tmp_path / name)
    result = run(tmp_path / "a.stl", tmp_path / "b.stl", "-o", tmp_path / "cave", "--starts.count", 5)
    assert result.returncode == 0, result.stderr
    assert "watertight; 2 portals" in result.stdout
    volumes = [read_scenario(folder).cavity.mesh.volume for folder in (tmp_path / "cave", built)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-6)
    assert set(json.loads((tmp_path / "cave" / "build.json").read_text())["inputs"]) == {"a.stl", "b.stl"}


def test_a_folder_among_several_scans_is_told_apart_from_what_is_missing(scan: Path, tmp_path: Path) -> None:
    for name, told in (("folder", "is a folder. Name the scans in it"), ("none", "There is no file")):
        (tmp_path / "folder").mkdir(exist_ok=True)
        result = run(scan, tmp_path / name, "-o", tmp_path / "cave")
        assert (result.returncode, told in result.stderr) == (2, True)


def test_only_scans_are_built_together(scan: Path, tmp_path: Path) -> None:
    result = run(tmp_path, scan, "-o", tmp_path / "cave")
    assert result.returncode == 2
    assert "is of photos, and 1 more files are given with it" in result.stderr


def test_a_build_leaves_a_complete_scenario_folder(built: Path) -> None:
    assert {path.name for path in built.iterdir()} == OUTPUTS
    scenario = read_scenario(built)
    assert scenario.name == "tube"
    assert len(scenario.starts) == 20
    assert scenario.cavity.volume == pytest.approx(0.5 * 32 * np.sin(2 * np.pi / 32) * LENGTH, rel=1e-4)
    with Image.open(built / "cave.png") as picture:
        assert min(picture.size) > 300


def test_noise_that_a_first_surface_shows_makes_the_voxel_larger(tmp_path: Path) -> None:
    noisy = add_noise(intact(tube(1.2, 6.0, sections=48, rings=46)), 0.05, seed=2).mesh
    noisy.to_trimesh().export(tmp_path / "noisy.ply")
    assert run(tmp_path / "noisy.ply", "-o", tmp_path / "cave", "--starts.count", 5).returncode == 0
    report = json.loads((tmp_path / "cave" / "report.json").read_text())
    # Noise of 5 cm along the normal alone puts half of the points 3.4 cm and more from the wall.
    assert report["voxel"] > 4.0 * 0.025
    assert report["fit"]["median"] <= 0.25 * report["voxel"]
    assert report["fit"]["percentile_95"] <= report["voxel"]


def test_the_same_scan_and_seed_give_the_same_bytes(scan: Path, built: Path, tmp_path: Path) -> None:
    words = (scan, "-o", tmp_path / "again", "--name", "tube", "--starts.count", 20)
    again = run_as_a_process(*words, code=f"{WITHOUT_PICTURES}; {BUILD}")
    assert again.returncode == 0, again.stderr
    assert read_scenario(tmp_path / "again").content_hash == read_scenario(built).content_hash


def test_the_record_names_versions_options_and_input_hash(built: Path, scan: Path) -> None:
    import hashlib

    record = json.loads((built / "build.json").read_text())
    assert record["inputs"] == {"tube.stl": hashlib.sha256(scan.read_bytes()).hexdigest()}
    assert record["options"]["starts"]["count"] == 20
    assert record["libraries"]["trimesh"] == trimesh.__version__
    assert [stage["title"] for stage in record["stages"]][:4] == [
        "Reading the scan",
        "Choosing the resolution",
        "Preparing the surface",
        "Closing the cavity",
    ]


def test_unit_up_axis_and_recipe_are_applied_and_flags_win(built: Path, scan: Path, tmp_path: Path) -> None:
    mesh = trimesh.load(scan)
    mesh.vertices = 100.0 * mesh.vertices[:, [1, 2, 0]]  # world x, y, z from the file's z, x, y: up is y
    mesh.export(tmp_path / "tube.ply")
    (tmp_path / "mine.toml").write_text(
        '[scan]\nunit = "cm"\n[panels]\nspacing = 0.5\nmin_spacing = 0.5\n[starts]\ncount = 7\n'
    )
    flags = ("--up", "y", "--recipe", tmp_path / "mine.toml", "--starts.count", 5)
    result = run(tmp_path / "tube.ply", "-o", tmp_path / "out", *flags)
    assert result.returncode == 0, result.stderr
    scenario = read_scenario(tmp_path / "out")
    assert scenario.cavity.volume == pytest.approx(read_scenario(built).cavity.volume, rel=1e-4)
    assert len(scenario.starts) == 5
    assert np.diff(scenario.guide.arc_lengths).max() < 0.6


def test_a_finished_scenario_is_only_replaced_when_told_so(scan: Path, built: Path) -> None:
    before = (built / "scenario.toml").read_bytes()
    result = run(scan, "-o", built)
    assert result.returncode == 2
    assert "already holds a scenario" in result.stderr
    assert (built / "scenario.toml").read_bytes() == before


def content(folder: Path) -> dict[str, str]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): file_hash(path) for path in files if "work" not in path.parts}


def test_a_build_that_fails_leaves_the_scenario_it_was_to_replace_as_it_was(
    scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # "." is a folder, too
    assert run(scan, "-o", ".", "--starts.count", 5).returncode == 0
    before = content(tmp_path)
    result = run(scan, "-o", ".", "--overwrite", "--cut", *"4 9 0 1 0 0".split())
    assert result.returncode == 4
    assert "misses the cave" in result.stderr
    assert "Kept in failed: report.html. The scenario in . is as it was." in result.stderr
    found = content(tmp_path)
    assert {name: found[name] for name in before} == before
    assert {name.split("/")[0] for name in found.keys() - before.keys()} == {"failed"}
    assert "misses the cave" in json.loads((tmp_path / "failed" / "report.json").read_text())["error"]
    assert run(scan, "-o", ".", "--overwrite", "--starts.count", 4).returncode == 0
    assert not (tmp_path / "failed").exists()
    assert len(read_scenario(tmp_path).starts) == 4
    stages = {stage["title"] for stage in json.loads((tmp_path / "build.json").read_text())["stages"]}
    assert "Closing the cavity" not in stages  # the walls are the same: only what depends on the starts is made again


def test_a_disk_that_fills_up_leaves_the_scenario_it_was_to_replace_as_it_was(
    scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with small_disk(tmp_path / "disk", 300) as disk:
        assert run(scan, "-o", disk / "mine", "--starts.count", 5).returncode == 0
        before = content(disk / "mine")

        record_cave = scenario_folder.record_cave

        def fill_and_record(*arguments: Any) -> None:
            fill(disk, leave_megabytes=0)
            record_cave(*arguments)

        monkeypatch.setattr(scenario_folder, "record_cave", fill_and_record)
        result = run(scan, "-o", disk / "mine", "--starts.count", 4, "--overwrite")
        assert result.returncode == 6
        assert f"disk under {disk}" in result.stderr
        assert content(disk / "mine") == before
        assert read_scenario(disk / "mine").starts
        result = run(scan, "-o", disk / "mine", "--starts.count", 4, "--overwrite")
        assert re.search(r"is full: \d MB are free", result.stderr)
        assert "Reading the scan" not in result.stderr  # said before the work
        assert content(disk / "mine") == before


def test_a_cut_ends_the_cave_and_the_route_goes_where_it_is_told(scan: Path, tmp_path: Path) -> None:
    flags = ("--cut", 5.5, 0, 0, 1, 0, 0, "--entrance", "5.5,0,0", "--goal", "0.1,0,0", "--starts.count", 4)
    result = run(scan, "-o", tmp_path / "out", *flags)
    assert result.returncode == 0, result.stderr
    scenario = read_scenario(tmp_path / "out")
    ends = sorted(portal.centre[0] for portal in scenario.cavity.portals)
    assert ends == pytest.approx([0.0, 5.5], abs=1e-3)
    assert scenario.cavity.volume == pytest.approx(0.5 * 32 * np.sin(2 * np.pi / 32) * 5.5, rel=1e-3)
    assert scenario.guide.centres[0][0] > scenario.guide.centres[-1][0]
    fit = json.loads((tmp_path / "out" / "report.json").read_text())["fit"]
    assert fit["percentile_95"] < 1e-4  # a twelfth of the points lies in the part that was cut off


def test_a_report_is_drawn_anew_without_closing_or_measuring_again(
    scan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    assert run(scan, "-o", out, "--starts.count", 4).returncode == 0
    before = {name: (out / name).read_bytes() for name in ("cave.ply", "field.npz", "guide.json", "starts.json")}
    (out / "report.html").unlink()

    def never(*arguments: object) -> None:
        raise AssertionError("made again")

    with monkeypatch.context() as patched:
        patched.setattr("aquanav_tools.build.kept_cave.kept_value", functools.partial(_read_alone, never))
        done = run_here(aquanav_command, "report", out)
    assert done.returncode == 0, done.stderr
    assert "report.html" in done.stdout and (out / "report.html").is_file()
    assert {name: (out / name).read_bytes() for name in before} == before
    shutil.rmtree(out / "work")
    gone = run_here(aquanav_command, "report", out)
    assert gone.returncode == 2 and "Nothing is kept in" in gone.stderr
    assert "no build.json" in run_here(aquanav_command, "report", tmp_path / "none").stderr


def _read_alone(make: Callable[[], None], kind: type, path: Path, _make: object) -> object:
    """Return a kept value as the build reads it; one that is not there is not made."""
    return kept_value(kind, path, make)


def test_a_cut_in_metres_along_the_route_ends_the_cave_there(built: Path, scan: Path, tmp_path: Path) -> None:
    route = read_scenario(built).guide.centreline
    step = np.sign(route[-1, 0] - route[0, 0])
    flags = ("--cut-at", 0.1, "--route-of", built, "--starts.count", 4, "--panels.min-spacing", 0.1)
    result = run(scan, "-o", tmp_path / "out", *flags)
    assert result.returncode == 0, result.stderr
    place = route[0, 0] + step * 0.1  # in a straight tube, a metre of route is one along x
    ends = sorted(portal.centre[0] for portal in read_scenario(tmp_path / "out").cavity.portals)
    assert ends == pytest.approx(sorted([place, LENGTH if step > 0 else 0.0]), abs=0.02)  # the route sways by a sample
    planes = json.loads((tmp_path / "out" / "build.json").read_text())["options"]["closing"]["cut"]
    assert len(planes) == 1 and f"--cut {planes[0][0]:.3f}" in result.stderr  # as planes, for once more
    again = run(scan, "-o", tmp_path / "out", "--overwrite", "--cut-at", 1.0)
    assert again.returncode == 2 and "was cut itself" in again.stderr and f"--cut {planes[0][0]:.3f}" in again.stderr


def test_a_cut_along_a_route_that_there_is_not_is_refused(built: Path, scan: Path, tmp_path: Path) -> None:
    other = scan.with_name("other.stl")
    other.write_bytes(scan.read_bytes())
    for flags, sentence in (
        ((scan, "--cut-at", 1.0), "There is no scenario in"),
        ((scan, "--cut-at", 99.0, "--route-of", built), "--cut-at is 99 m, and the route in"),
        ((other, "--cut-at", 1.0, "--route-of", built), "was built from tube.stl, not from other.stl"),
    ):
        result = run(*flags, "-o", tmp_path / "out")
        assert result.returncode == 2 and sentence in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_cut_that_takes_most_of_the_cave_is_told_with_its_share(scan: Path, tmp_path: Path) -> None:
    result = run(scan, "-o", tmp_path / "out", "--cut", *"1.5 0 0 1 0 0".split())
    assert result.returncode == 4  # what is left is too short for a route
    assert "Look (large-cut): The cuts take away 75% of the water" in result.stderr


def test_a_gallery_on_its_end_is_told_before_the_work_and_in_the_report(scan: Path, tmp_path: Path) -> None:
    result = run(scan, "-o", tmp_path / "out", "--up", "x", "--cut", *"4 9 0 1 0 0".split())
    assert "Look (stands-on-end): With --up x the cave is a shaft: 6 high and 2 by 2 wide" in result.stderr
    warnings = json.loads((tmp_path / "out" / "report.json").read_text())["warnings"]
    assert [warning["code"] for warning in warnings] == ["stands-on-end"]


def test_an_unknown_portal_is_answered_with_those_there_are(scan: Path, tmp_path: Path) -> None:
    result = run(scan, "-o", tmp_path / "out", "--goal", "7")
    assert result.returncode == 2
    assert "There is no portal 7. There are: 1 at" in result.stderr


def test_an_unknown_key_in_a_recipe_is_refused_with_the_closest_match(scan: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[panels]\nspacng = 2.0\n")
    result = run(scan, "-o", tmp_path / "out", "--recipe", tmp_path / "mine.toml")
    assert result.returncode == 2
    assert "unknown key 'spacng'. Did you mean 'spacing'?" in result.stderr


def test_a_folder_with_other_files_is_left_alone(scan: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    result = run(scan, "-o", tmp_path)
    assert result.returncode == 2
    assert "holds other files (thesis.tex)" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
