"""A run that code of the user's own stops has its last checkpoint, and goes on from there when the code is right."""

from __future__ import annotations

from pathlib import Path

import pytest

from aquanav_tools.errors import OwnCodeError
from aquanav_tools.train.checkpoint import read_checkpoint
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from tests.own_modules import WriteModule, own_module
from tests.train.runs import learned, tiny_pipeline, tiny_tube

__all__ = ["own_module"]

CODE = """
import os

class Price:
    def terms(self, batch):
        values = batch.gained - 0.1 * np.abs(batch.commands - batch.last_commands).sum(axis=1)
        if os.path.exists("wrong"):
            values[batch.decisions == 35] = np.nan
        return {"price": values}

class Where:
    def spec(self, scenario, vehicle):
        return Box(-np.inf, np.inf, (3,))

    def measure(self, batch):
        return batch.positions + 0.01 * batch.normals(3)
"""


def test_a_run_that_a_reward_stops_goes_on_from_its_checkpoint_to_the_same_policy(
    tmp_path: Path, own_module: WriteModule
) -> None:
    own = own_module(CODE)
    pipeline = tiny_pipeline(
        tiny_tube(tmp_path / "tube"), run=RunSettings(checkpoint_every=128, final_episodes=0, backend="batch"),
        reward=f"{own}:Price", sensors=(f"{own}:Where",), observation_delay=1,
    )  # fmt: skip
    train(pipeline, 3, tmp_path / "whole")
    Path("wrong").touch()
    words = r"returned nan, which is not finite, after 35 decisions .* vehicle \d .* Training stopped .* after 128 "
    with pytest.raises(OwnCodeError, match=words):
        train(pipeline, 3, tmp_path / "stopped")
    checkpoint = read_checkpoint(tmp_path / "stopped")
    assert checkpoint is not None and checkpoint.learner["num_timesteps"] == 128
    Path("wrong").unlink()
    train(pipeline, 3, tmp_path / "stopped")
    assert learned(tmp_path / "stopped") == learned(tmp_path / "whole")


def test_a_run_that_never_got_far_has_no_checkpoint(tmp_path: Path, own_module: WriteModule) -> None:
    own = own_module("class No:\n    def terms(self, batch):\n        return {'a': np.inf * batch.remaining}")
    pipeline = tiny_pipeline(
        tiny_tube(tmp_path / "tube"), run=RunSettings(final_episodes=0, backend="batch"), reward=f"{own}:No"
    )
    with pytest.raises(OwnCodeError, match=r"returned inf, which is not finite.*run has no checkpoint."):
        train(pipeline, 3, tmp_path / "run")
