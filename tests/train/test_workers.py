"""Environments in workers: the same policy, and a worker's end, error or silence is told and costs nothing learned."""

from __future__ import annotations

import dataclasses
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.errors import AquanavError, ResourceError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.train import environments, training
from aquanav_tools.train.environments import TrainingEnvs
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from aquanav_tools.workers import pool as pool_module
from aquanav_tools.workers.pipe import PipeWorker
from aquanav_tools.workers.ray_cluster import RayWorker
from aquanav_tools.workers.worker import WorkerError
from tests.clusters import two_nodes
from tests.train.runs import TINY, learned, tiny_pipeline, tiny_tube
from tests.train.test_resume import after_checkpoint

RUN = RunSettings(checkpoint_every=128, workers=2, final_episodes=0)


@pytest.fixture(scope="module")
def tube_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_tube(tmp_path_factory.mktemp("scenario") / "tube")


@pytest.fixture(scope="module")
def whole(tube_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What a run without workers learns."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "write_artifacts", lambda *_: None)
        train(tiny_pipeline(tube_folder, run=dataclasses.replace(RUN, workers=0)), 0, folder)
    return learned(folder)


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[TrainingEnvs]:
    """Environments of runs, the last ones last; the runs write no reports."""
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)
    found: list[TrainingEnvs] = []
    begin = TrainingEnvs.__init__

    def begin_and_keep(self: TrainingEnvs, *args: Any) -> None:
        begin(self, *args)
        found.append(self)

    monkeypatch.setattr(TrainingEnvs, "__init__", begin_and_keep)
    return found


def second_of(begun: list[TrainingEnvs]) -> Any:
    assert begun[-1].pool is not None
    return begun[-1].pool.workers[1]


def test_killed_worker_costs_nothing_and_workers_change_nothing(
    begun: list[TrainingEnvs], tube_folder: Path, tmp_path: Path, whole: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def kill_worker() -> None:
        worker = second_of(begun)
        assert isinstance(worker, PipeWorker) and worker.pid is not None
        os.kill(worker.pid, signal.SIGKILL)

    told = r"^The training worker 2 of 2 \(process \d+\) was ended by SIGKILL while environments ran in it\..*is kept"
    with monkeypatch.context() as patch, pytest.raises(ResourceError, match=told):
        after_checkpoint(patch, 1, kill_worker)
        train(tiny_pipeline(tube_folder, run=RUN), 0, tmp_path)
    train(tiny_pipeline(tube_folder, run=RUN), 0, tmp_path)
    assert learned(tmp_path) == whole


def test_worker_that_is_stopped_in_its_tracks_is_ended_and_told(
    begun: list[TrainingEnvs], tube_folder: Path, tmp_path: Path, whole: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop_worker() -> None:
        os.kill(second_of(begun).pid, signal.SIGSTOP)

    with monkeypatch.context() as patch:
        patch.setattr(environments, "CALL_LIMIT", 3.0)
        patch.setattr(pool_module, "LOOK_EVERY", 0.1)
        after_checkpoint(patch, 1, stop_worker)
        with pytest.raises(WorkerError, match=r"training worker 2 of 2 .* gave no answer to 'step' within 3 s"):
            train(tiny_pipeline(tube_folder, run=RUN), 0, tmp_path)
    train(tiny_pipeline(tube_folder, run=dataclasses.replace(RUN, workers=0)), 0, tmp_path)
    assert learned(tmp_path) == whole


@pytest.mark.parametrize(
    ("action", "told"), [(np.full((4, 3), 7), "action"), (np.full((4, 2), 1), "action")], ids=["values", "shape"]
)
def test_what_an_environment_refuses_is_told_alike_with_and_without_workers(
    action: Any, told: str, tube: Scenario
) -> None:
    said = []
    for num_workers in (0, 1):
        envs = TrainingEnvs([tube], TINY, num_workers)
        envs.seed(0)
        envs.reset()
        with pytest.raises(AquanavError, match=told) as error:
            envs.step(action)
        said.append(str(error.value))
        envs.close()
    assert said[0] == said[1]


def test_error_in_an_environment_is_told_with_its_worker(tube: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    envs = TrainingEnvs([tube], TINY, 2)
    try:
        assert envs.pool is not None
        with pytest.raises(WorkerError, match=r"training worker 1 of 2 \(process \d+\) raised TypeError: .* while env"):
            envs.pool.call("step")
            envs.pool.answers()
    finally:
        envs.close()


def test_run_on_a_ray_cluster_that_loses_an_actor_ends_as_one_in_this_process(
    begun: list[TrainingEnvs], tube_folder: Path, tmp_path: Path, whole: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_nodes(monkeypatch) as cluster:
        import ray

        def kill_actor() -> None:
            worker = second_of(begun)
            assert isinstance(worker, RayWorker)
            ray.kill(worker.actor)

        run = dataclasses.replace(RUN, ray=cluster.address)
        told = r"^The training worker 2 of 2 \(an actor of the Ray cluster\) was lost .* while environments ran in it\."
        with monkeypatch.context() as patch, pytest.raises(ResourceError, match=told):
            after_checkpoint(patch, 1, kill_actor)
            train(tiny_pipeline(tube_folder, run=run), 0, tmp_path)
        train(tiny_pipeline(tube_folder, run=run), 0, tmp_path)
    assert learned(tmp_path) == whole
