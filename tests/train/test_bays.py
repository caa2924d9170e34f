"""Training in bays: a boat's network learns, is saved and scored as a vehicle's in a cave."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.contacts import Backend, default_backend
from aquanav_tools.train import training
from aquanav_tools.train.pipeline import Pipeline, read_pipeline
from aquanav_tools.train.settings import RunSettings, TrainSettings
from aquanav_tools.train.training import train
from tests.own_modules import WriteModule, own_module
from tests.train.runs import assert_stopped_run_ends_alike

__all__ = ["own_module"]


BAY = "format = 1\ndecisions = 60\n[rocks]\nlength = 70.0\nwidth = 40.0\nboat_width = 1.1\n"

OWN = """
class Price:
    base = "safe"

    def terms(self, batch):
        return {"price": -0.1 * np.abs(batch.commands - batch.last_commands).sum(axis=1)}

class Where:
    def spec(self, scenario, vehicle):
        return Box(-np.inf, np.inf, (3,))

    def measure(self, batch):
        return batch.positions + 0.01 * batch.normals(3)
"""


@pytest.fixture
def bay(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(BAY)
    return path


def pipeline_in(*places: str, backend: Backend | None = None, **settings: object) -> Pipeline:
    lesson = TrainSettings(
        scenario=places[0],
        n_steps=64,
        batch=64,
        epochs=1,
        num_envs=2,
        hidden=(8,),
        **({"steps": 128} | settings),  # type: ignore[arg-type]
    )
    run = RunSettings(
        workers=0,
        validation=(places[0],),
        validation_episodes=1,
        backend=backend or default_backend(),
        checkpoint_every=64,
        final_episodes=1,
    )
    lessons = tuple(replace(lesson, scenario=place) for place in places)
    return Pipeline(lessons=lessons, run=run)


@pytest.mark.parametrize("backend", [default_backend(), "batch"])
def test_a_boats_policy_is_one_for_bays(backend: Backend, bay: Path, tmp_path: Path) -> None:
    trained = train(pipeline_in(str(bay), backend=backend), 0, tmp_path / "run")
    assert trained.point.steps == 128
    for name in ("policy.zip", "policy.onnx"):
        loaded = load_policy(str(tmp_path / "run" / name))
        assert (loaded.task, loaded.observation, loaded.action) == ("surface", "full", "multidiscrete")


def test_a_stopped_run_on_the_batch_ends_as_one_that_never_stopped(
    bay: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)
    pipeline = pipeline_in(str(bay), backend="batch", current=0.2, current_range=(0.5, 1.0), steps=384)
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch)


def test_a_stopped_run_with_ones_own_reward_and_sensor_ends_as_one_that_never_stopped(
    bay: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_module: WriteModule
) -> None:
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)
    own = own_module(OWN)
    more: dict[str, Any] = {"reward": f"{own}:Price", "sensors": (f"{own}:Where",), "observation_delay": 1}
    pipeline = pipeline_in(str(bay), backend="batch", steps=384, **more)
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch)


@pytest.mark.parametrize("name", ["bay-standard", "bay-safe"])
def test_pipelines_for_bays_are_shipped(name: str) -> None:
    pipeline = read_pipeline(name, {})
    assert pipeline.run.backend == "batch"
    assert {lesson.reward for lesson in pipeline.lessons} == {"safe" if name == "bay-safe" else "dense"}


def test_bays_and_caves_do_not_mix(bay: Path, tube: Scenario, tmp_path: Path) -> None:
    write_scenario(tube, tmp_path / "tube")
    with pytest.raises(InputError, match="small is a bay and tube a cave"):
        train(pipeline_in(str(bay), str(tmp_path / "tube")), 0, tmp_path / "run")


def test_mirrors_are_for_caves(bay: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="mirrored and masked_observations are for caves, and small is a bay"):
        train(pipeline_in(str(bay), mirrored=True), 0, tmp_path / "run")
