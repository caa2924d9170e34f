"""The last policy is measured in whole episodes, wherever it learned."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.scenario.schema import LimitSettings
from aquanav_tools.train import training
from aquanav_tools.train.settings import RunSettings
from aquanav_tools.train.training import train
from aquanav_tools.train.validation import measure
from tests.caves import tube_scenario
from tests.train.runs import TINY, tiny_pipeline, tiny_tube


class Straight:
    """Stands for a learner whose policy goes straight ahead, or stays."""

    def __init__(self, thrust: int) -> None:
        self.policy, self._thrust = self, thrust

    def set_training_mode(self, mode: bool) -> None:
        assert not mode

    def predict(self, observations: Any, memory: Any, is_first: Any, deterministic: bool) -> Any:
        assert deterministic
        return np.tile([1, 1, self._thrust], (len(observations), 1)), None


@pytest.mark.parametrize(("thrust", "decisions", "rate"), [(2, 300, 1.0), (2, 40, 0.0), (1, 60, 0.0)])
def test_a_straight_tube_is_swum_through_by_who_goes_straight_ahead_for_long_enough(
    thrust: int, decisions: int, rate: float
) -> None:
    # 11 to 17.5 m at 1 m/s and ten decisions a second: 300 are enough, and 40 are not.
    tube = tube_scenario(limits=LimitSettings(decisions=decisions))
    trial = measure(Straight(thrust), [tube, tube], TINY, 4, 1, 7)  # type: ignore[arg-type]
    assert (trial.episodes, trial.lesson, trial.steps) == (4, 1, 7)
    assert (trial.success_rate, trial.clean_success_rate, trial.mean_collisions) == (rate, rate, 0.0)


def test_run_on_the_batch_ends_with_whole_episodes_where_its_curve_has_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "write_artifacts", lambda *_: None)
    pipeline = tiny_pipeline(
        tiny_tube(tmp_path / "tube"), run=RunSettings(backend="batch", final_episodes=5), steps=128, num_envs=32
    )  # 4 decisions of each vehicle, of the 40 of an episode
    trained = train(pipeline, 0, tmp_path / "run")
    assert trained.point.caveat.startswith("100%")
    assert trained.final is not None and trained.final.episodes == 5
    assert json.loads((tmp_path / "run" / "train.json").read_text())["final"]["episodes"] == 5
    again = train(pipeline, 0, tmp_path / "run")
    assert again.was_finished and again.final == trained.final
