"""The policies in eval/policies: they can be read without trust, and they fly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.factory import TaskEnv
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.presets import SURFACE
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.task import TaskOptions
from tests.conftest import REPOSITORY

POLICIES = sorted((REPOSITORY / "eval" / "policies").glob("*.zip"))
MAX_BYTES = 3_000_000
"""Of a file in the repository."""


def test_there_is_a_reference_policy_that_is_known_by_its_name() -> None:
    assert POLICIES
    for path in POLICIES:
        named, read = load_policy(f"baseline:{path.stem}"), load_policy(str(path))
        assert (named.name, named.sha256) == (f"baseline:{path.stem}", read.sha256)


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_a_reference_policy_has_an_easy_way_without_a_touch_and_so_does_its_onnx(path: Path, tube: Scenario) -> None:
    loaded, other = (load_policy(str(path.with_suffix(suffix))) for suffix in (".zip", ".onnx"))
    rules = loaded.rules(TaskOptions(on_collision="end"))
    form: dict[str, Any] = {"observation": loaded.observation, "action": loaded.action, "on_collision": "end"}
    form |= {"sensors": rules.sensors, "history": rules.history}
    # A tube four metres wide, in still water and a gentle stream against the vehicle, is easier than any cave; a bay
    # of few rocks, in still water and a gentle tide, than any that is drawn by the usual settings.
    if loaded.task == SURFACE:
        envs: list[TaskEnv] = [
            SurfaceEnv(MapSettings(density=0.02), sea="still", current=c, **form) for c in (0.0, 0.2)
        ]
    else:
        envs = [CaveEnv(tube, current=current, **form) for current in ((0.0, 0.0, 0.0), (-0.2, 0.0, 0.0))]
    for env in envs:
        observation, info = env.reset(seed=0, options={} if loaded.task == SURFACE else {"start": 0})
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
