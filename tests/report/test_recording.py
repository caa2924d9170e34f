from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.report.recording.cave import CaveModel, record_cave, thin
from aquanav_tools.report.recording.episode import DiveScene, record_episode
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.solids import box
from aquanav_tools.types import Mesh
from tests.report.trajectories import RAYS, straight_trajectory

RERUN = Path(sys.executable).with_name("rerun")
HULL = box((0.46, 0.34, 0.25), (0.0, 0.0, 0.0), (255, 200, 40))


def rerun(*arguments: str | Path) -> str:
    result = subprocess.run([RERUN, "rrd", *arguments], capture_output=True, text=True, check=True, timeout=60)
    return result.stdout + result.stderr


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    path = tmp_path_factory.mktemp("recording") / "episode.rrd"
    flowing = straight_trajectory(currents=np.tile([0.0, 0.3, 0.0], (101, 1)))
    record_episode(DiveScene(CaveModel(tube), HULL, RAYS), flowing, path)
    return path


@pytest.fixture(scope="module")
def listing(recording: Path) -> str:
    return rerun("print", "-v", recording)


def test_rerun_accepts_the_recordings(recording: Path, tmp_path: Path, tube: Scenario) -> None:
    record_cave(CaveModel(tube), tmp_path / "cave.rrd")
    assert "verified without error" in rerun("verify", recording, tmp_path / "cave.rrd")


SCENE = (
    "/cave",
    "/route/centreline",
    "/route/panels",
    "/route/goal",
    "/vehicle",
    "/vehicle/hull",
    "/vehicle/rays",
    "/trail",
    "/current",
    "/contacts",
)
PLOTS = ("clearance", "progress", "cost", "reward/movement", "reward/time", "command/steer", "command/thrust")


@pytest.mark.parametrize("entity", [*SCENE, "/state", *(f"/plots/{plot}" for plot in PLOTS)])
def test_recording_shows(listing: str, entity: str) -> None:
    assert re.search(rf"{entity}\b", listing)


def test_recording_carries_its_blueprint_and_properties(listing: str) -> None:
    assert "Blueprint" in listing
    assert "/__properties/episode" in listing


def test_properties_name_seed_and_outcome(recording: Path) -> None:
    text = rerun("print", "-vvv", "--entity", "/__properties/episode", recording)
    for value in ("seed", "outcome", "success", "collisions"):
        assert value in text


def test_every_state_is_recorded_once(recording: Path) -> None:
    rows = {entity: rerun("print", "--entity", entity, recording) for entity in ("/vehicle", "/plots/reward/time")}
    assert "101 rows" in rows["/vehicle"]
    assert "100 rows" in rows["/plots/reward/time"]


def columns(path: Path, entity: str) -> Any:
    """Return what a recording holds of an entity, as rerun's own reader tells it."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    (store,) = reader.recordings()
    (chunk,) = [item for item in reader.stream(store=store).to_chunks() if item.entity_path == entity]
    return chunk.to_record_batch()


def test_rays_reach_from_the_vehicle_as_far_as_measured(tmp_path: Path, tube: Scenario) -> None:
    ranges = np.linspace(0.5, 4.0, 101 * 28).reshape(101, 28)
    path = tmp_path / "rays.rrd"
    record_episode(DiveScene(CaveModel(tube), HULL, RAYS), straight_trajectory(rays=ranges), path)
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    chunks = [c for c in reader.stream(store=reader.recordings()[0]).to_chunks() if c.entity_path == "/vehicle/rays"]
    (moving,) = [chunk.to_record_batch() for chunk in chunks if not chunk.is_static]
    strips = np.array(moving.column("LineStrips3D:strips").to_pylist())
    assert strips.shape == (101, 28, 2, 3)
    np.testing.assert_allclose(strips[:, :, 0], 0.0)
    np.testing.assert_allclose(np.linalg.norm(strips[:, :, 1], axis=2), ranges, rtol=1e-6)


def test_contacts_lie_where_the_hull_came_to_touch_the_wall(recording: Path) -> None:
    places = np.array(columns(recording, "/contacts").column("Points3D:positions").to_pylist()[0])
    np.testing.assert_allclose(places, [[10.0, 0.0, 0.0]], atol=1e-6)  # half way from x = 1 to x = 19


def test_the_currents_arrow_is_the_way_of_the_water_in_two_seconds(recording: Path) -> None:
    arrows = np.array(columns(recording, "/current").column("Arrows3D:vectors").to_pylist())
    np.testing.assert_allclose(arrows, np.tile([0.0, 0.6, 0.0], (101, 1, 1)), rtol=1e-6)


def test_still_water_has_no_arrows(tmp_path: Path, tube: Scenario) -> None:
    record_episode(DiveScene(CaveModel(tube), HULL, RAYS), straight_trajectory(), tmp_path / "still.rrd")
    assert not re.search(r"/current\b", rerun("print", "-v", tmp_path / "still.rrd"))


def test_a_second_recording_of_a_scene_is_as_whole_as_the_first(tmp_path: Path, tube: Scenario) -> None:
    scene = DiveScene(CaveModel(tube), HULL, RAYS)
    paths = [tmp_path / f"{seed}.rrd" for seed in range(2)]
    for seed, path in enumerate(paths):
        record_episode(scene, straight_trajectory(seed=seed), path)
    entities = [sorted(re.findall(r"/[\w/]+\b", rerun("print", path))) for path in paths]
    assert entities[0] == entities[1]
    assert "verified without error" in rerun("verify", *paths)


def test_long_episode_stays_small(tmp_path: Path, tube: Scenario, rng: np.random.Generator) -> None:
    trajectory = straight_trajectory(2400, rays=rng.uniform(0.5, 5.0, (2401, 28)))
    record_episode(DiveScene(CaveModel(tube), HULL, RAYS), trajectory, tmp_path / "long.rrd")
    assert (tmp_path / "long.rrd").stat().st_size < 1_500_000


def test_repeated_run_keeps_the_recording_id(recording: Path, tmp_path: Path, tube: Scenario) -> None:
    record_episode(DiveScene(CaveModel(tube), HULL, RAYS), straight_trajectory(), tmp_path / "again.rrd")

    def recording_id(path: Path) -> str:
        found = re.search(r'Recording, "aquanav", "([^"]+)"', rerun("stats", path))
        assert found
        return found.group(1)

    assert recording_id(recording) == recording_id(tmp_path / "again.rrd")


def test_large_cave_is_thinned_and_stays_closed() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=3.0)
    mesh = Mesh(np.array(sphere.vertices), np.array(sphere.faces, dtype=np.int64))
    thinned = thin(mesh, 4000)
    assert len(thinned.faces) <= 4000 < len(mesh.faces)
    prove_watertight(thinned)
    np.testing.assert_allclose(np.linalg.norm(thinned.vertices, axis=1), 3.0, atol=0.05)  # 1 % of its size


def test_small_cave_is_kept_as_it_is(tube: Scenario) -> None:
    assert thin(tube.cavity.mesh, 1000) is tube.cavity.mesh
