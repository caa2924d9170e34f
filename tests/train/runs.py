"""Training runs of a second, and what to hold them against."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
import torch

from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import LimitSettings
from aquanav_tools.train.checkpoint import read_checkpoint
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.record import RunRecord
from aquanav_tools.train.settings import RunSettings, TrainSettings
from aquanav_tools.train.training import train
from tests.caves import tube_scenario

TINY = TrainSettings(
    scenario="tube", steps=512, observation="paper", num_envs=4, hidden=(8,), n_steps=32, batch=32, epochs=2, memory=8,
    learning_starts=100, replay=200,
)  # fmt: skip
"""Episodes of 40 decisions, so that they end within and across rollouts."""


def tiny_tube(folder: Path, decisions: int = 40) -> Path:
    """Write the tube with short episodes; return its folder."""
    write_scenario(tube_scenario(limits=LimitSettings(decisions=decisions)), folder)
    return folder


def tiny_pipeline(tube: Path, num_lessons: int = 1, run: RunSettings | None = None, **changes: Any) -> Pipeline:
    """Lessons in the tube, with a checkpoint after every update and no last trial unless `run` says otherwise."""
    lesson = dataclasses.replace(TINY, **{"scenario": str(tube), **changes})
    return Pipeline((lesson,) * num_lessons, run or RunSettings(checkpoint_every=128, final_episodes=0))


def stop_after(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    """Stop the run right after the checkpoint of a number, from 1."""
    write, written = RunRecord.write, []

    def write_and_stop(*args: object, **kwargs: object) -> None:
        write(*args, **kwargs)  # type: ignore[arg-type]
        written.append(None)
        if len(written) == number:
            raise KeyboardInterrupt

    monkeypatch.setattr(RunRecord, "write", write_and_stop)


def assert_stopped_run_ends_alike(
    pipeline: Pipeline, folder: Path, monkeypatch: pytest.MonkeyPatch, checkpoint: int = 1
) -> None:
    """Learn in `folder`/whole, and in `folder`/stopped with a stop after a checkpoint: both end with the same bytes."""
    train(pipeline, 3, folder / "whole")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        stop_after(patch, checkpoint)
        train(pipeline, 3, folder / "stopped")
    train(pipeline, 3, folder / "stopped")
    assert learned(folder / "stopped") == learned(folder / "whole")


def learned(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all that a run has learned: weights, statistics, optimisers' moments."""
    checkpoint = read_checkpoint(folder)
    assert checkpoint is not None
    found: dict[str, bytes] = {}
    _collect("", {"parameters": checkpoint.learner["parameters"], "spread": checkpoint.learner["spread"]}, found)
    return found


def _collect(where: str, value: Any, found: dict[str, bytes]) -> None:
    if isinstance(value, torch.Tensor):
        found[where] = value.numpy().tobytes()
    elif isinstance(value, dict):
        for key, item in value.items():
            _collect(f"{where}/{key}", item, found)
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            _collect(f"{where}/{number}", item, found)
    else:
        found[where] = repr(value).encode()
