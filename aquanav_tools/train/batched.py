"""The training environments as one batch of Warp kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from aquanav_tools.envs.batch_task import Floats
from aquanav_tools.envs.places import Place, cave_of
from aquanav_tools.envs.sb3_env import CaveVecEnv
from aquanav_tools.task import choices_of
from aquanav_tools.train.episodes import SUMMARY, EpisodeSummary
from aquanav_tools.train.settings import TrainSettings


class BatchedEnvs(CaveVecEnv):
    """All vehicles of a lesson. Where they are is a few arrays, so that coming back there takes no time."""

    def __init__(self, scenario: Place, settings: TrainSettings) -> None:
        """Make the batch; it begins with the seed that SB3 gives it."""
        cave = cave_of(scenario, 'backend = "batch"')
        choices = choices_of(settings)
        super().__init__(cave, settings.num_envs, observation=settings.observation, action=settings.action, **choices)

    def state(self) -> dict[str, Any]:
        """Return all arrays of the batch."""
        return {name: torch.from_numpy(values) for name, values in self._task.world.state().items()}

    def restore(self, state: dict[str, Any]) -> Floats:
        """Go back to where `state` was taken; return the observations there."""
        self._task.world.restore({name: tensor.numpy() for name, tensor in state.items()})
        return self._task.copy_of("observations")

    def _describe_ends(self, infos: list[dict[str, Any]], ended: Any, truncated: np.ndarray) -> None:
        """Add what the learning curve reads."""
        super()._describe_ends(infos, ended, truncated)
        for n in ended:
            info = infos[n]
            episode = info["episode"]
            info[SUMMARY] = EpisodeSummary(
                episode["r"], episode["l"], info["num_collisions"], info["outcome"] == "success"
            )
