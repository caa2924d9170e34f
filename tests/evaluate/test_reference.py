"""The policies in eval/policies: they can be read without trust, and they fly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.scenario.schema import Scenario
from tests.conftest import REPOSITORY

POLICIES = sorted((REPOSITORY / "eval" / "policies").glob("*.zip"))
MAX_BYTES = 2_000_000
"""Of a file in the repository."""


def test_there_is_a_reference_policy_that_is_known_by_its_name() -> None:
    assert POLICIES
    for path in POLICIES:
        named, read = load_policy(f"baseline:{path.stem}"), load_policy(str(path))
        assert (named.name, named.sha256) == (f"baseline:{path.stem}", read.sha256)


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_a_reference_policy_flies_a_straight_tube_without_a_touch_and_so_does_its_onnx(
    path: Path, tube: Scenario
) -> None:
    # A tube four metres wide, in still water and a gentle stream against the vehicle, is easier than any cave.
    loaded, other = (load_policy(str(path.with_suffix(suffix))) for suffix in (".zip", ".onnx"))
    for current in ((0.0, 0.0, 0.0), (-0.2, 0.0, 0.0)):
        env = CaveEnv(tube, observation=loaded.observation, action=loaded.action, on_collision="end", current=current)
        observation, info = env.reset(seed=0, options={"start": 0})
        for policy in (loaded.policy, other.policy):
            policy.reset(0)
        while info["outcome"] == "running":
            action = loaded.policy.act(observation)
            assert np.array_equal(other.policy.act(observation), action)
            observation, *_, info = env.step(action)
        assert info["outcome"] == "success"
        env.close()


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_a_reference_policys_files_are_small_and_have_a_card(path: Path) -> None:
    assert all(path.with_suffix(suffix).stat().st_size <= MAX_BYTES for suffix in (".zip", ".onnx"))
    assert path.stem in (path.parent / "README.md").read_text()
