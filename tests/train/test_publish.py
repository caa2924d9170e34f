"""A published policy acts as the run's does, begins other runs, and is smaller."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.train.training import train
from eval.publish_policy import publish
from tests.train.runs import tiny_pipeline, tiny_tube


@pytest.mark.drawn_reports
def test_a_published_policy_is_the_runs_without_what_it_needs_to_go_on(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    tube = tiny_tube(tmp_path / "tube")
    pipeline = tiny_pipeline(tube, steps=128, hidden=(64, 64))
    train(pipeline, 3, tmp_path / "run")
    paths = publish(tmp_path / "run", "ours", tmp_path)
    again = publish(tmp_path / "run", "again", tmp_path)
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in again]
    assert paths[0].stat().st_size < 0.6 * (tmp_path / "run" / "policy.zip").stat().st_size
    loaded = [load_policy(str(path)) for path in (tmp_path / "run" / "policy.zip", *paths)]
    for seen in rng.normal(size=(20, 31)).astype(np.float32):
        first, *others = (one.policy.act(seen) for one in loaded)
        assert all(np.array_equal(first, other) for other in others)
    begun = tiny_pipeline(tube, steps=128, hidden=(64, 64), run=pipeline.run.__class__(init=str(paths[0])))
    assert train(begun, 3, tmp_path / "begun").point.steps == 128
