"""The training environments as one batch, in which the vehicles are divided among the scenarios of the lesson."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from aquanav_tools.envs.action import choices_of as choices_of_commands
from aquanav_tools.envs.batch import Floats
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.task import choices_of
from aquanav_tools.train.cave_rotation import CaveRotation
from aquanav_tools.train.episodes import SUMMARY, EpisodeSummary
from aquanav_tools.train.settings import TrainSettings


class BatchedEnvs(BatchedVecEnv):
    """All vehicles of a lesson. Where they are is a few arrays: coming back there takes no time."""

    def __init__(
        self, scenarios: Sequence[AnyScenario], settings: TrainSettings, rotation: CaveRotation | None = None
    ) -> None:
        """Make the batch; it begins with the seed that SB3 gives it.

        Args:
            scenarios: Of the lesson; drawn caves are the last of them.
            settings: Of the lesson.
            rotation: What brings other drawn caves in; None where there are none.
        """
        form: dict[str, Any] = {"observation": settings.observation, "action": settings.action}
        if rotation is not None:
            form["replaceable"] = True
        self.rotation = rotation
        super().__init__(scenarios, settings.num_envs, **(form | _shown(settings)))

    def reset(self) -> Floats:
        """Begin all episodes, as if some time had passed in each.

        Hundreds of vehicles that began together would all run out of time at once, or, where a lesson has fewer
        decisions for each than an episode, never: those that are stuck would teach the same till the end.
        """
        seed = self._first_seed if self._seeds[0] is None else self._seeds[0]
        observations = super().reset()
        self._task.randomise_time_limits(seed)
        return observations

    def step_wait(self) -> tuple[Floats, Floats, Any, list[dict[str, Any]]]:
        """Carry out the decision; then the next drawn cave comes in where it is its turn."""
        stepped = super().step_wait()
        if self.rotation is not None:
            infos = stepped[3]
            self.rotation.step(self._caves, {n: infos[n][SUMMARY] for n in np.flatnonzero(stepped[2]).tolist()})
        return stepped

    def advice(self) -> npt.NDArray[np.int64]:
        """Return the (N, 3) choices of the oracle where the vehicles are."""
        return choices_of_commands(self._caves.advice())

    @property
    def _caves(self) -> CaveBatch:
        assert isinstance(self._task, CaveBatch)
        return self._task

    def state(self) -> dict[str, Any]:
        """Return all arrays of the batch, and which drawn caves are in it."""
        drawn = {} if self.rotation is None else self.rotation.state()
        return {name: torch.from_numpy(values) for name, values in (self._task.state() | drawn).items()}

    def restore(self, state: dict[str, Any]) -> Floats:
        """Go back to where `state` was taken; return the observations there."""
        arrays = {name: tensor.numpy() for name, tensor in state.items()}
        if self.rotation is not None:
            self.rotation.restore(arrays, self._caves)
        self._task.restore(arrays)
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


def _shown(settings: TrainSettings) -> dict[str, Any]:
    """Return the task's options, with the route in place of the waypoint where the lesson shows that."""
    choices = choices_of(settings)
    if settings.waypoint == "route":
        choices["sensors"] = tuple("route" if name == "waypoint" else name for name in settings.sensors)
    return choices
