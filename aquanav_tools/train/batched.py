"""The training environments as batches, one for each scenario of the lesson."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv

from aquanav_tools.envs.batch import Floats
from aquanav_tools.envs.places import Place
from aquanav_tools.envs.sb3_env import PlaceVecEnv
from aquanav_tools.task import choices_of
from aquanav_tools.train.environments import shares
from aquanav_tools.train.episodes import SUMMARY, EpisodeSummary
from aquanav_tools.train.settings import TrainSettings


class BatchedPlace(PlaceVecEnv):
    """All vehicles of a lesson in one scenario. Where they are is a few arrays: coming back there takes no time."""

    def __init__(self, scenario: Place, settings: TrainSettings, num: int) -> None:
        """Make the batch of `num` vehicles; it begins with the seed that SB3 gives it."""
        choices = choices_of(settings)
        super().__init__(scenario, num, observation=settings.observation, action=settings.action, **choices)

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
        for n in ended:
            info = infos[n]
            episode = info["episode"]
            info[SUMMARY] = EpisodeSummary(
                episode["r"], episode["l"], info["num_collisions"], info["outcome"] == "success"
            )


class BatchedEnvs(VecEnv):
    """All vehicles of a lesson, a batch for each of its scenarios."""

    def __init__(self, scenarios: Sequence[Place], settings: TrainSettings) -> None:
        """Make the batches, and share out the vehicles."""
        self._shares = shares(settings.num_envs, len(scenarios))
        self._places = [
            BatchedPlace(scenario, settings, share.stop - share.start)
            for scenario, share in zip(scenarios, self._shares, strict=True)
        ]
        self.render_mode = None
        first = self._places[0]
        super().__init__(settings.num_envs, first.observation_space, first.action_space)

    def reset(self) -> Floats:
        """Begin all episodes; a scenario's seed is that of its first vehicle."""
        for place, share in zip(self._places, self._shares, strict=True):
            place._seeds = self._seeds[share]
        self._reset_seeds()
        self._reset_options()
        return np.concatenate([place.reset() for place in self._places])

    def step_async(self, actions: Any) -> None:
        """Take the actions of the next decision."""
        for place, share in zip(self._places, self._shares, strict=True):
            place.step_async(actions[share])

    def step_wait(self) -> tuple[Floats, Floats, Any, list[dict[str, Any]]]:
        """Carry out the decision."""
        observations, rewards, dones, infos = zip(*(place.step_wait() for place in self._places), strict=True)
        told = [info for part in infos for info in part]
        return np.concatenate(observations), np.concatenate(rewards), np.concatenate(dones), told

    def state(self) -> dict[str, Any]:
        """Return all arrays of each scenario's batch."""
        return {"places": [place.state() for place in self._places]}

    def restore(self, state: dict[str, Any]) -> Floats:
        """Go back to where `state` was taken; return the observations there."""
        pairs = zip(self._places, state["places"], strict=True)
        return np.concatenate([place.restore(own) for place, own in pairs])

    def close(self) -> None:
        """End the threads."""
        for place in self._places:
            place.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of this object, once for each vehicle asked for."""
        value = getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: vehicles of a lesson are alike."""
        raise NotImplementedError("Vehicles of a lesson share their settings.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refuse: vehicles of a lesson are not called one by one."""
        raise NotImplementedError(f"Vehicles of a lesson have no method '{method_name}' of their own.")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each: what wraps them is no concern of SB3's."""
        return [False for _ in self._get_indices(indices)]
