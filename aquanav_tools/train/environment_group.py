"""Several training environments that are stepped together. Imports no torch: each worker has such a group."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.factory import AnyScenario, make_env
from aquanav_tools.sim.contacts import Contacts
from aquanav_tools.task import choices_of
from aquanav_tools.train.episodes import SummaryWrapper
from aquanav_tools.train.settings import TrainSettings
from aquanav_tools.train.snapshots import Snapshot, SnapshotEnv

Floats = npt.NDArray[np.float32]


class Stepped(NamedTuple):
    """What a step of N environments brought; an ended episode's successor has begun."""

    observations: Floats
    """(N, size)."""
    rewards: Floats
    dones: npt.NDArray[np.bool_]
    infos: list[dict[str, Any]]
    """Empty but for the last of an episode, which has what SB3 and the learning curve read."""


class EnvironmentGroup:
    """Environments of one lesson, in this process."""

    def __init__(
        self, scenarios: Sequence[AnyScenario], settings: TrainSettings, contacts: Contacts | None = None
    ) -> None:
        """Make an environment in each of the scenarios, of which some may be the same. See `CaveEnv` for contacts."""
        self._envs = [training_env(scenario, settings, contacts) for scenario in scenarios]

    def __len__(self) -> int:
        return len(self._envs)

    def spaces(self) -> tuple[gymnasium.Space[Any], gymnasium.Space[Any]]:
        """Return the spaces of observation and action."""
        return self._envs[0].observation_space, self._envs[0].action_space

    def reset(self, seeds: Sequence[int | None]) -> Floats:
        """Begin all episodes; return the (N, size) observations."""
        return np.stack([env.reset(seed=seed)[0] for env, seed in zip(self._envs, seeds, strict=True)])

    def step(self, actions: npt.NDArray[Any]) -> Stepped:
        """Take one decision in each environment."""
        observations, rewards, dones, infos = zip(*map(_step, self._envs, actions), strict=True)
        return Stepped(np.stack(observations), np.array(rewards, np.float32), np.array(dones), list(infos))

    def snapshots(self) -> list[Snapshot]:
        """Return where each environment is."""
        return [env.snapshot() for env in self._envs]

    def restore(self, snapshots: Sequence[Snapshot]) -> Floats:
        """Bring each environment to a snapshot; return the (N, size) observations there."""
        return np.stack([env.restore(snapshot) for env, snapshot in zip(self._envs, snapshots, strict=True)])

    def close(self) -> None:
        """Free all environments."""
        for env in self._envs:
            env.close()


def training_env(scenario: AnyScenario, settings: TrainSettings, contacts: Contacts | None = None) -> SnapshotEnv:
    """Return one environment of a lesson."""
    choices = choices_of(settings) | {"observation": settings.observation, "action": settings.action}
    env = make_env(scenario, contacts=contacts, **choices)
    return SnapshotEnv(SummaryWrapper(env))


def make_group(
    scenarios: Sequence[AnyScenario], settings: TrainSettings, contacts: Contacts | None, clock: Any
) -> EnvironmentGroup:
    """Return a worker's environments, as `WorkerSpec.make` has it; each call is timed by the pool, not by the clock."""
    return EnvironmentGroup(scenarios, settings, contacts)


def _step(env: SnapshotEnv, action: Any) -> tuple[Any, float, bool, dict[str, Any]]:
    observation, reward, terminated, truncated, info = env.step(action)
    is_over = terminated or truncated
    if is_over:
        last = {"terminal_observation": observation, "TimeLimit.truncated": truncated and not terminated}
        info = {**info, **last}
        observation, _ = env.reset()
    return observation, reward, is_over, info
