"""A scenario for each pair of ends: a passage that parts into two has three ends, and three pairs of them."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cli.build_cave import main
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.synthetic.networks import Network, fork, straight
from tests.commands import run_here
from tests.lighter import lighten_builds

run = functools.partial(run_here, main)
LENGTH = 5.0
"""Of each of the fork's three arms, m."""
BEFORE_ENDS = 1.5
"""A route ends less than this before a lid, m: the vehicle must reach the goal without touching it."""


@pytest.fixture(scope="module", autouse=True)
def _no_pictures() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        lighten_builds(patch)
        yield


def scan_of(network: Network, folder: Path) -> Path:
    network.scan().to_trimesh().export(folder / "scan.ply")
    return folder / "scan.ply"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fork")
    scan = scan_of(fork(0.8, LENGTH), folder)
    done = run(scan, "-o", folder / "mine", "--routes", "all", "--starts.count", 3)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Another route: ") == 2
    return folder / "mine"


def routes_in(built: Path) -> list[Path]:
    return [built, *sorted((built / "routes").iterdir())]


def ends_of(scenario: Scenario) -> tuple[int, int]:
    """Return the labels of the portals that the route begins and ends at: these are the nearest by far."""
    centres = np.array([portal.centre for portal in scenario.cavity.portals])
    distances = np.linalg.norm(scenario.guide.centreline[[0, -1], None] - centres, axis=2)
    assert (distances.min(axis=1) < BEFORE_ENDS).all()
    first, last = (scenario.cavity.portals[n].label for n in distances.argmin(axis=1))
    return first, last


def test_each_pair_of_ends_has_a_route_of_its_own(built: Path) -> None:
    scenarios = [read_scenario(place) for place in routes_in(built)]
    assert {tuple(sorted(ends_of(one))) for one in scenarios} == {(1, 2), (1, 3), (2, 3)}
    assert len({one.content_hash for one in scenarios}) == 3
    assert len({one.name for one in scenarios}) == 3
    for one in scenarios:
        first, last = (next(p.centre for p in one.cavity.portals if p.label == label) for label in ends_of(one))
        # No way is shorter than the straight line, none longer than along both arms to where they meet.
        assert np.linalg.norm(first - last) - 2.0 * BEFORE_ENDS < one.guide.length < 2.0 * LENGTH


def test_all_routes_lie_in_one_cave_and_each_ends_at_its_goal(built: Path) -> None:
    first, *others = (read_scenario(place) for place in routes_in(built))
    for other in others:
        assert np.array_equal(other.cavity.mesh.vertices, first.cavity.mesh.vertices)
        assert np.allclose(other.settings.goal.position, other.guide.centres[-1])
        assert len(other.starts) == 3


def test_a_route_is_a_whole_folder_and_the_record_lists_its_files(built: Path) -> None:
    listed = json.loads((built / "build.json").read_text())["outputs"]
    for place in routes_in(built)[1:]:
        name = place.relative_to(built).as_posix()
        for file in ("scenario.toml", "report.html", "build.json", "cave.png"):
            assert (place / file).is_file()
            assert f"{name}/{file}" in listed
        assert f"{name}</td>" in (built / "report.html").read_text()


def test_a_later_build_without_them_leaves_none(built: Path) -> None:
    scan = built.parent / "scan.ply"
    done = run(scan, "-o", built, "--overwrite", "--starts.count", 3)
    assert done.returncode == 0, done.stderr
    assert not (built / "routes").exists()


def test_a_cave_with_two_ends_has_no_other_route_and_says_so(tmp_path: Path) -> None:
    done = run(scan_of(straight(0.8, 5.0), tmp_path), "-o", tmp_path / "mine", "--routes", "all")
    assert done.returncode == 0, done.stderr
    assert "warning (no-other-routes): The cave has 2 open ends" in done.stderr
    assert not (tmp_path / "mine" / "routes").exists()


def test_ends_too_tight_for_the_vehicle_are_told_and_the_others_are_written(tmp_path: Path) -> None:
    """One arm, the shortest, is narrower than the vehicle: two pairs cannot be dived, and are named with the reason."""
    wide = fork(0.8, LENGTH)
    narrow = replace(wide.passages[2], axis=wide.passages[2].axis[: len(wide.passages[2].axis) // 2], radius=0.12)
    scan = scan_of(replace(wide, passages=(*wide.passages[:2], narrow)), tmp_path)
    done = run(scan, "-o", tmp_path / "mine", "--routes", "all", "--starts.count", 3, "--min-portal", 0.15)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("warning (route-too-tight)") == 2
    assert not (tmp_path / "mine" / "routes").exists()
