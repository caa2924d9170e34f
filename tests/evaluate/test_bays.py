"""Evaluations in bays: the same files and figures as in caves, held against the bays themselves."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from shapely.geometry import LineString, Point

from aquanav_tools.cli.evaluate import main
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.evaluation import Evaluation, evaluate
from aquanav_tools.evaluate.options import EvaluateOptions, StressOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.results import read_results
from aquanav_tools.evaluate.stress import stress
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sim.boat import load_boat
from aquanav_tools.sim.boat_trial import boat_speed
from aquanav_tools.sim.trial import try_out
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Progress, ignore_progress
from tests.report.test_recording import rerun

SMALL = MapSettings(length=70.0, width=40.0, boat_width=1.1)
BAY = "format = 1\n[rocks]\nlength = 70.0\nwidth = 40.0\nboat_width = 1.1\n"
NUM_EPISODES = 6
Capture = pytest.CaptureFixture[str]


def evaluated(policy: str, place: Path | str, output: Path, **options: object) -> Evaluation:
    chosen: dict[str, object] = {"episodes": NUM_EPISODES, "record": "none", "workers": 1, **options}
    progress: Progress = ignore_progress
    return evaluate(EvaluateOptions((policy,), (Path(place),), output, **chosen), progress)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def bay(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bay") / "small.toml"
    path.write_text(BAY)
    return path


@pytest.fixture(scope="module")
def oracle(bay: Path, tmp_path_factory: pytest.TempPathFactory) -> Evaluation:
    return evaluated("baseline:oracle", bay, tmp_path_factory.mktemp("oracle"), record="worst", max_recordings=1)


def test_the_oracle_crosses_every_bay_without_a_collision(oracle: Evaluation) -> None:
    assert [episode.is_collision_free_success for episode in oracle.episodes] == [True] * NUM_EPISODES


def test_every_episode_has_its_own_bay_and_way(oracle: Evaluation) -> None:
    env = SurfaceEnv(SMALL)
    for episode in oracle.episodes:
        env.reset(seed=episode.seed)
        assert episode.geodesic == pytest.approx(LineString(env.route.points).length, rel=1e-3)
        rocks = [LineString(np.vstack([rock.outline, rock.outline[:1]])) for rock in env.sea_map.rocks]
        room = min(LineString(env.route.points).distance(rock) for rock in rocks)
        assert room >= SMALL.room - 1e-3


def test_spl_is_that_of_the_ways_lengths(oracle: Evaluation) -> None:
    for episode in oracle.episodes:
        assert episode.spl == pytest.approx(episode.geodesic / max(episode.geodesic, episode.path_length))
        assert episode.path_length > 0.95 * episode.geodesic  # the goal is reached within its tolerance


def test_no_entity_of_a_recording_has_a_blank_in_its_path(oracle: Evaluation) -> None:
    reader = RrdReader(oracle.recordings[0])
    (data,) = reader.recordings()
    paths = {chunk.entity_path for chunk in reader.stream(store=data).to_chunks()}
    assert any("route" in path for path in paths)
    assert not [path for path in paths if " " in path]  # rerun warns of each on stderr


def test_results_follow_the_schema_and_charts_are_drawn(oracle: Evaluation) -> None:
    table = read_results(oracle.results)
    assert {episode["energy"] for episode in table["episodes"]} == {None}
    assert "energy" not in table["summary"]["means"]
    charts = sorted(path.name for path in (oracle.report.parent / "pictures").glob("small-*.png"))
    assert charts == [f"small-{n:05d}.png" for n in range(NUM_EPISODES)]


def test_an_episode_repeats_to_the_bit(oracle: Evaluation, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["replay", str(oracle.results), "--episode", "2", "-o", str(tmp_path / "again.rrd")])
    assert "repeats to the bit" in capsys.readouterr().out
    assert (tmp_path / "again.rrd").stat().st_size > 10_000


def test_a_recording_shows_the_sea_and_the_commands_that_a_boat_obeys(oracle: Evaluation) -> None:
    (recording,) = oracle.recordings
    listing = rerun("print", "-v", recording)
    shown = {name: re.search(rf"/{name}\b", listing) is not None for name in ("sea", "rocks", "vehicle/rays", "trail")}
    assert all(shown.values()), shown
    assert sorted(set(re.findall(r"/plots/command/(\w+)", listing))) == ["steer", "thrust"]


def test_policies_of_the_other_task_are_refused(bay: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="was made for the cave task, and small is of the surface task"):
        evaluated("baseline:reactive", bay, tmp_path)


def test_a_batch_comes_to_the_results_of_boats_alone(bay: Path, tmp_path: Path) -> None:
    options = {"on_collision": "end", "max_decisions": 200, "current": 0.2, "current_range": (0.5, 1.0)}
    alone = evaluated("baseline:random", bay, tmp_path / "alone", **options)
    batch = evaluated("baseline:random", bay, tmp_path / "batch", backend="batch", workers=None, **options)
    for ours, theirs in zip(batch.episodes, alone.episodes, strict=True):
        assert (ours.outcome, ours.collisions, ours.start) == (theirs.outcome, theirs.collisions, theirs.start)
        for name in ("time", "path_length", "geodesic", "progress", "min_clearance", "reward"):
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), rel=1e-5, abs=1e-5), name


def test_an_episode_of_a_batch_repeats_to_the_bit(bay: Path, tmp_path: Path, capsys: Capture) -> None:
    evaluated("baseline:random", bay, tmp_path / "eval", backend="batch", workers=None, max_decisions=20)
    main(["replay", str(tmp_path / "eval"), "--episode", "2", "-o", str(tmp_path / "again.rrd")])
    assert "repeats to the bit" in capsys.readouterr().out


def test_what_takes_only_caves_says_so(bay: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="aquanav-eval stress takes caves only, and small is a bay"):
        stress(StressOptions(policy="baseline:random", scenario=bay, output=tmp_path), ignore_progress)


def test_starts_of_drawn_bays_have_no_regions(bay: Path, tmp_path: Path) -> None:
    from aquanav_tools.evaluate.options import Grid

    with pytest.raises(InputError, match="None of the 0 listed starts of small"):
        evaluated("baseline:random", bay, tmp_path, grid=Grid(region=("first third",)))


def test_the_originals_boat_reaches_its_goal(data_dir: Path, tmp_path: Path) -> None:
    shared = data_dir / "saferlauv"
    policy, scene = shared / "policies" / "Boat_Standard.onnx", shared / "surface" / "train.json"
    found = evaluated(str(policy), scene, tmp_path, episodes=5)
    assert [episode.outcome for episode in found.episodes] == ["success"] * 5
    for episode in found.episodes:
        assert episode.energy is not None and episode.energy > 0.0
        assert episode.path_length > 0.95 * episode.geodesic


def test_the_originals_boat_policy_was_made_for_bays(data_dir: Path) -> None:
    loaded = load_policy(str(data_dir / "saferlauv" / "policies" / "Boat_Standard.onnx"))
    assert (loaded.task, loaded.observation, loaded.action) == ("surface", "original", "multidiscrete")


def test_speed_ahead_is_that_of_open_water() -> None:
    original = load_vehicle("boat")
    assert boat_speed(original) == pytest.approx(try_out(original).ahead, rel=0.01)  # type: ignore[arg-type]
    otter = load_boat("otter")
    assert 0.0 < boat_speed(otter) < otter.surge_force / otter.linear_damping[0]


def test_progress_of_the_goal_is_where_the_boat_is(oracle: Evaluation) -> None:
    env = SurfaceEnv(SMALL)
    for episode in oracle.episodes:
        env.reset(seed=episode.seed)
        start, goal = env.state[:2], env.sea_map.goal
        assert episode.progress >= Point(start).distance(Point(goal.centre)) - goal.tolerance - 1e-6
