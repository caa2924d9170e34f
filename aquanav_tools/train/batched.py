"""The training environments as one batch, in which the vehicles are divided among the scenarios of the lesson."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from aquanav_tools.envs.batch import Floats
from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.task import choices_of
from aquanav_tools.train.episodes import SUMMARY, EpisodeSummary
from aquanav_tools.train.settings import TrainSettings


class BatchedEnvs(BatchedVecEnv):
    """All vehicles of a lesson. Where they are is a few arrays: coming back there takes no time."""

    def __init__(self, scenarios: Sequence[AnyScenario], settings: TrainSettings) -> None:
        """Make the batch; it begins with the seed that SB3 gives it."""
        form = {"observation": settings.observation, "action": settings.action}
        super().__init__(scenarios, settings.num_envs, **(form | choices_of(settings)))

    def reset(self) -> Floats:
        """Begin all episodes, as if some time had passed in each.

        Hundreds of vehicles that began together would all run out of time at once, or, where a lesson has fewer
        decisions for each than an episode, never: those that are stuck would teach the same till the end.
        """
        seed = self._first_seed if self._seeds[0] is None else self._seeds[0]
        observations = super().reset()
        self._task.randomise_time_limits(seed)
        return observations

    def state(self) -> dict[str, Any]:
        """Return all arrays of the batch."""
        return {name: torch.from_numpy(values) for name, values in self._task.state().items()}

    def restore(self, state: dict[str, Any]) -> Floats:
        """Go back to where `state` was taken; return the observations there."""
        self._task.restore({name: tensor.numpy() for name, tensor in state.items()})
        return self._task.copy_of("observations")

    def _describe_ends(self, infos: list[dict[str, Any]], ended: Any, truncated: np.ndarray) -> None:
        """Add what the learning curve reads."""
        super()._describe_ends(infos, ended, truncated)
        was_first = self._task.view_of("episodes") == 2  # the second has just begun
        for n in ended:
            info = infos[n]
            episode = info["episode"]
            info[SUMMARY] = EpisodeSummary(
                episode["r"],
                episode["l"],
                info["num_collisions"],
                info["outcome"] == "success",
                bool(truncated[n] and was_first[n]),
            )
