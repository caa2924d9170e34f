"""Training on the batch: the same run as on PyBullet, but for where the vehicles swim."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.folder import read_scenario, write_scenario
from aquanav_tools.scenario.schema import LimitSettings
from aquanav_tools.train import training
from aquanav_tools.train.batched import BatchedEnvs
from aquanav_tools.train.episodes import SUMMARY
from aquanav_tools.train.pipeline import read_pipeline
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from tests.evaluate.winding import winding_scenario
from tests.sim.test_water import flowing
from tests.train.runs import TINY, assert_stopped_run_ends_alike, tiny_pipeline, tiny_tube

ON_BATCH = RunSettings(backend="batch", checkpoint_every=128, final_episodes=0)


@pytest.fixture(scope="module")
def tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tube with its flow and episodes of 40 decisions."""
    settings = dataclasses.replace(flowing().settings, limits=LimitSettings(decisions=40))
    folder = tmp_path_factory.mktemp("scenario") / "tube"
    write_scenario(dataclasses.replace(flowing(), settings=settings), folder)
    return folder


@pytest.fixture(scope="module")
def still_tube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another cave: the tube without flow, and episodes of 25 decisions."""
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "still", decisions=25)


@pytest.fixture(autouse=True)
def no_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Spare a second for each run."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)


@pytest.mark.parametrize(("algorithm", "checkpoint"), [("ppo", 1), ("ppo", 2), ("sac", 1)])
def test_stopped_run_ends_as_one_that_never_stopped(
    algorithm: str, checkpoint: int, tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    action = "continuous" if algorithm == "sac" else "multidiscrete"
    choices = {"action": action, "current": "full", "current_range": (0.5, 1.0), "steps": 256}
    # Each lesson writes two checkpoints: the second is at its end.
    pipeline = tiny_pipeline(tube, 2, ON_BATCH, algorithm=algorithm, **choices)
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch, checkpoint)


def test_curve_tells_of_the_batchs_episodes_and_trials_are_the_batchs_too(tube: Path, tmp_path: Path) -> None:
    run = dataclasses.replace(ON_BATCH, validation=(str(tube),), validation_episodes=2, validate_every=256)
    trained = train(tiny_pipeline(tube, run=run, steps=256), 0, tmp_path)
    # 4 vehicles of 64 decisions each; none reaches the goal in 40, and the first episode of each is shorter.
    assert 4 <= trained.point.episodes <= 8
    assert 1.0 <= trained.point.mean_length < 40.0
    assert trained.best is not None and trained.best.steps == 256
    assert (tmp_path / "best.zip").is_file()


def test_ended_episodes_are_summed_up(tube: Path) -> None:
    envs = BatchedEnvs([flowing()], dataclasses.replace(TINY, current="half", num_envs=4))
    envs.seed(0)
    envs.reset()
    total = np.zeros(4)
    for _ in range(2400):
        _, rewards, dones, infos = envs.step(np.tile([1, 1, 2], (4, 1)))
        total += rewards
        for n in np.flatnonzero(dones):
            summary = infos[n][SUMMARY]
            assert summary.reward == pytest.approx(total[n], rel=1e-4)
            assert summary.is_success == (infos[n]["outcome"] == "success")
            assert summary.length == infos[n]["episode"]["l"]
        if dones.any():
            break
    assert dones.any()
    envs.close()


def test_a_lesson_shows_the_route_in_place_of_the_waypoint() -> None:
    cave, settings = winding_scenario(), dataclasses.replace(TINY, sensors=("waypoint",))
    shown = {}
    for choice in ("map", "route"):
        envs = BatchedEnvs([cave], dataclasses.replace(settings, waypoint=choice))
        envs.seed(0)
        shown[choice] = envs.reset()[:, -4:]
        envs.close()
    envs = BatchedVecEnv([cave], TINY.num_envs, observation=TINY.observation, sensors=("route",))
    envs.seed(0)
    of_route = envs.reset()[:, -4:]
    # The share that is unknown is drawn by the sensor's name.
    np.testing.assert_array_equal(shown["route"], of_route)
    assert not np.array_equal(shown["map"][:, :3], of_route[:, :3])
    envs.close()


def test_the_route_is_shown_on_the_batch_alone_and_where_there_is_a_waypoint(tube: Path, tmp_path: Path) -> None:
    pipeline = tiny_pipeline(tube, sensors=("waypoint",), waypoint="route")
    with pytest.raises(InputError, match=r"waypoint = route needs the batch, and this is"):
        train(dataclasses.replace(pipeline, run=RunSettings(backend="own")), 0, tmp_path)
    with pytest.raises(ValueError, match=r"waypoint is route, .* and the sensors are \(\)"):
        tiny_pipeline(tube, waypoint="route")


def test_first_episodes_that_run_out_of_time_are_told_as_cut_short(tube: Path) -> None:
    # Of 40 decisions each at most: without thrust none reaches the goal, and each vehicle's first is shorter by chance.
    envs = BatchedEnvs([read_scenario(tube)], dataclasses.replace(TINY, num_envs=4))
    envs.seed(0)
    envs.reset()
    told: list[list[tuple[bool, int]]] = [[] for _ in range(4)]
    for _ in range(120):
        _, _, dones, infos = envs.step(np.tile([1, 1, 1], (4, 1)))
        for n in np.flatnonzero(dones):
            told[n].append((infos[n][SUMMARY].is_cut_short, infos[n][SUMMARY].length))
    assert all(own[0][0] and own[0][1] <= 40 for own in told)
    assert all(own[1:] and set(own[1:]) == {(False, 40)} for own in told)
    envs.close()


def test_vehicles_in_two_caves_swim_as_in_a_batch_for_each(tube: Path, still_tube: Path) -> None:
    caves = [read_scenario(tube), read_scenario(still_tube)]
    settings = dataclasses.replace(TINY, current_range=(0.5, 1.0), num_envs=5)
    both = BatchedEnvs(caves, settings)
    sizes = (dataclasses.replace(settings, num_envs=n) for n in (2, 3))
    alone = [BatchedEnvs([cave], own) for cave, own in zip(caves, sizes, strict=True)]
    for envs, seeds in ((both, range(5)), (alone[0], range(2)), (alone[1], range(2, 5))):
        envs._task.reset(seeds)
    first = [envs._task.copy_of("observations") for envs in (both, *alone)]
    assert np.array_equal(first[0], np.concatenate(first[1:]))
    for _ in range(45):  # episodes end after 40 and 25
        actions = np.tile([0, 0, 2], (5, 1))
        together = both.step(actions)
        parts = [alone[0].step(actions[:2]), alone[1].step(actions[2:])]
        for n in range(3):
            assert np.array_equal(together[n], np.concatenate([part[n] for part in parts]))
        assert [info[SUMMARY] for info in together[3] if info] == [
            info[SUMMARY] for part in parts for info in part[3] if info
        ]
    for envs in (both, *alone):
        envs.close()


def test_stopped_run_in_two_caves_ends_as_one_that_never_stopped(
    tube: Path, still_tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = tiny_pipeline(tube, 1, ON_BATCH, scenarios=(str(still_tube),), steps=256)
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch)


@pytest.mark.parametrize("progress", ["geodesic", "original"])
def test_stopped_run_with_all_that_errs_and_is_late_ends_as_one_that_never_stopped(
    progress: str, tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"progress": progress, "starts": "anywhere", "sensor_noise": 0.1, "sensor_dropout": 0.1}
    pipeline = tiny_pipeline(tube, 1, ON_BATCH, action_delay=2, observation_delay=2, steps=256, **options)
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch)


def test_workers_are_refused_beside_the_batch() -> None:
    with pytest.raises(InputError, match="workers is 2, and the batch runs in threads of its own"):
        read_pipeline(None, {"scenario": "cave-train-1", "backend": "batch", "workers": 2})


def test_the_papers_curriculum_is_shipped_for_the_batch() -> None:
    pipeline, paper = read_pipeline("paper-batch", {}), read_pipeline("paper", {})
    assert pipeline.run == dataclasses.replace(paper.run, backend="batch")
    as_paper = [dataclasses.replace(lesson, num_envs=16, n_steps=1280) for lesson in pipeline.lessons]
    assert as_paper == list(paper.lessons)  # a rollout of the original's 20,480 decisions


@pytest.mark.parametrize("sensor", ["sonar3d", "track", "waypoint"])  # new readings at every second decision; memories
def test_stopped_run_goes_on_with_what_sensors_remember(
    sensor: str, tube: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = tiny_pipeline(tube, 1, ON_BATCH, sensors=(sensor,), steps=256)
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch)
