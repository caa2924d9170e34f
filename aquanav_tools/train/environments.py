"""The training environments as one Stable-Baselines3 VecEnv, in this process or shared out to workers.

What an environment does depends on its own seed and actions only, so that the number of workers changes nothing but
the time. A worker has several environments: with one each, as SB3's SubprocVecEnv has it, handing over costs more than
a second processor brings.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv

from aquanav_tools.envs.cave_batch import shares
from aquanav_tools.envs.places import Place
from aquanav_tools.train.crew import Crew, Floats, Stepped
from aquanav_tools.train.rewinding import Moment
from aquanav_tools.train.settings import TrainSettings
from aquanav_tools.train.workers import Worker


@runtime_checkable
class Resumable(Protocol):
    """Environments that can be brought back to where they were."""

    def state(self) -> dict[str, Any]:
        """Return where all environments are, as tensors and texts."""

    def restore(self, state: dict[str, Any]) -> Floats:
        """Go back to where `state` was taken, also by other environments of the same task.

        Returns:
            (N, size) the observations there.
        """


class TrainingEnvs(VecEnv):
    """All environments of a lesson, in PyBullet."""

    def __init__(self, scenarios: Sequence[Place], settings: TrainSettings, num_workers: int) -> None:
        """Make the environments, shared out over the lesson's scenarios; with no workers, in this process."""
        num = settings.num_envs
        places = [
            scenario
            for scenario, share in zip(scenarios, shares(num, len(scenarios)), strict=True)
            for _ in range(share.stop - share.start)
        ]
        self._shares = shares(num, num_workers)
        self._crew = Crew(places, settings) if not self._shares else None
        self.workers = [
            Worker(places[share], settings, f"training worker {n + 1} of {len(self._shares)}")
            for n, share in enumerate(self._shares)
        ]
        self.render_mode = None
        self._actions: Any = None
        super().__init__(num, *self._spaces())

    def reset(self) -> Floats:
        """Begin all episodes, with the seeds given to `seed` the first time."""
        seeds, self._seeds = self._seeds, [None] * self.num_envs
        self._reset_options()
        if self._crew is not None:
            return self._crew.reset(seeds)
        return np.concatenate(self._ask_all("reset", seeds))

    def step_async(self, actions: Any) -> None:
        """Take the actions of the next decision."""
        self._actions = actions
        for worker, share in zip(self.workers, self._shares, strict=True):
            worker.ask("step", actions[share])

    def step_wait(self) -> tuple[Floats, Floats, Any, list[dict[str, Any]]]:
        """Carry out the decision."""
        if self._crew is not None:
            stepped = self._crew.step(self._actions)
            return stepped.observations, stepped.rewards, stepped.dones, stepped.infos
        parts: list[Stepped] = [worker.answer() for worker in self.workers]
        observations, rewards, dones, infos = zip(*parts, strict=True)
        return np.concatenate(observations), np.concatenate(rewards), np.concatenate(dones), _joined(infos)

    def state(self) -> dict[str, Any]:
        """Return where each environment is: its generator at the episode's start, and the actions since."""
        moments = self._crew.moments() if self._crew is not None else _joined(self._ask_all("moments"))
        return {
            "starts": [moment["generator"] for moment in moments],
            "actions": [torch.from_numpy(moment["actions"].copy()) for moment in moments],
        }

    def restore(self, state: dict[str, Any]) -> Floats:
        """Bring each environment back to where it was; return the observations there."""
        pairs = zip(state["starts"], state["actions"], strict=True)
        moments: list[Moment] = [{"generator": start, "actions": actions.numpy()} for start, actions in pairs]
        if self._crew is not None:
            return self._crew.rewind(moments)
        return np.concatenate(self._ask_all("rewind", moments))

    def close(self) -> None:
        """Free all environments and end the workers."""
        if self._crew is not None:
            self._crew.close()
        for worker in self.workers:
            worker.close()

    def _spaces(self) -> tuple[Any, Any]:
        if self._crew is not None:
            return self._crew.spaces
        try:
            return self._ask_all("spaces")[0]
        except BaseException:
            self.close()
            raise

    def _ask_all(self, method: str, values: Sequence[Any] | None = None) -> list[Any]:
        """Call a method of each worker's crew, with its share of the values."""
        for worker, share in zip(self.workers, self._shares, strict=True):
            worker.ask(method, *([] if values is None else [list(values[share])]))
        return [worker.answer() for worker in self.workers]

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of this object, once for each environment asked for."""
        value = getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: environments of a lesson are alike."""
        raise NotImplementedError("Environments of a lesson share their settings.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refuse: environments of a lesson are not called one by one."""
        raise NotImplementedError(f"Environments of a lesson have no method '{method_name}' of their own.")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each: what wraps them is no concern of SB3's."""
        return [False for _ in self._get_indices(indices)]


def _joined(parts: Iterable[list[Any]]) -> list[Any]:
    return [item for part in parts for item in part]
