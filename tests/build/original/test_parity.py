"""The test that counts: the original's own policy dives through the imported caves, and only if nothing is mirrored."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from aquanav_tools.build import cave_stages
from aquanav_tools.build.cave_stages import build_scenario
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.original.import_project import ImportOptions, build_options, choose_caves, import_caves
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.evaluate.policies import LoadedPolicy, load_policy
from aquanav_tools.evaluate.protocol import plan_episodes
from aquanav_tools.evaluate.rollout import run_episode
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import FANS
from aquanav_tools.types import IntArray, silent

CAVES = ["cave-easy", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("cave-medium", "cave-eval1"))]
"""The two are nightly: in the default tests the same policy dives through cave-eval1, imported with a coarser field."""
EPISODES = 25
MIN_CLEAN = 24
"""Of 25: what a numpy re-implementation of the original reached in the same meshes (saferlauv/README.md: 25)."""


class Swapped:
    """A policy that gets the rays of its left side as those of its right."""

    def __init__(self, policy: LoadedPolicy) -> None:
        """Wrap a policy."""
        self._policy = policy.policy
        self._order = mirrored_values()

    def reset(self, seed: int) -> None:
        """Begin an episode."""
        self._policy.reset(seed)

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Act on the swapped observation."""
        return self._policy.act(observation[self._order])


def mirrored_values() -> IntArray:
    """Return the 120 values in the order that swaps left and right: each fan has its middle ray, then pairs."""
    order: list[int] = []
    for fan in FANS:
        first = len(order) // 4
        rays = [first]
        for pair in range(fan.num_per_side):
            rays += [first + 2 + 2 * pair, first + 1 + 2 * pair]
        order += [4 * ray + value for ray in rays for value in range(4)]
    return np.array([*order, *range(112, 120)])


def num_clean(scenario: Scenario, policy: LoadedPolicy, episodes: int, is_swapped: bool, max_decisions: int) -> int:
    """Return how many episodes reached the goal and touched nothing."""
    env = CaveEnv(scenario, observation=policy.observation, action=policy.action, max_decisions=max_decisions)
    pilot = Swapped(policy) if is_swapped else policy.policy
    tracks = [run_episode(env, pilot, plan) for plan in plan_episodes(len(scenario.starts), episodes, seed=0)]
    env.close()
    return sum(track.outcome == "success" and track.num_collisions == 0 for track in tracks)


def the_policy(data_dir: Path) -> LoadedPolicy:
    return load_policy(str(data_dir / "saferlauv" / "policies" / "CurriculumLearning.onnx"))


def test_the_originals_policy_dives_through_an_imported_cave(
    data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = ImportOptions(data_dir / "saferlauv_unity", tmp_path, ("cave-eval1",))
    (cave,) = choose_caves(options)
    # Spheres are traced through this field; 0.5 m is fine enough in a passage of 4 m radius.
    monkeypatch.setattr(cave_stages, "choose_spacing", lambda *_: 0.5)
    scenario = build_scenario(cave.mesh, build_options(cave, options), Journal(silent)).scenario
    policy = the_policy(data_dir)
    assert num_clean(scenario, policy, 3, False, 900) == 3
    assert num_clean(scenario, policy, 2, True, 900) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", CAVES)
def test_the_originals_policy_reaches_the_goal_without_a_collision(name: str, data_dir: Path, tmp_path: Path) -> None:
    # A whole clone of the project, where there is one, also has the panels of the medium cave.
    project = Path(os.environ.get("AQUANAV_ORIGINAL", data_dir / "saferlauv_unity"))
    options = ImportOptions(project, tmp_path, (name,))
    (result,) = import_caves(choose_caves(options), options)
    policy = the_policy(data_dir)
    assert num_clean(result.scenario, policy, EPISODES, False, 2400) >= MIN_CLEAN
    assert num_clean(result.scenario, policy, 6, True, 2400) == 0
