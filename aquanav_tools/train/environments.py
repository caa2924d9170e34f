"""The training environments as one Stable-Baselines3 VecEnv, in this process or divided among workers.

What an environment does depends on its own seed and actions only, so that the number of workers changes nothing but
the time. A worker has several environments: with one each, as SB3's SubprocVecEnv has it, handing over costs more than
a second processor brings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv

from aquanav_tools.envs.cave_batch import slices_of
from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.sim.contacts import Contacts
from aquanav_tools.train.environment_group import EnvironmentGroup, Floats, Stepped, make_group
from aquanav_tools.train.settings import TrainSettings
from aquanav_tools.train.snapshots import Snapshot
from aquanav_tools.train.versions import versions
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.ray_cluster import as_at_home, connected
from aquanav_tools.workers.worker import Transport, WorkerSpec

CALL_LIMIT = 600.0
"""Wall time in which a worker must answer, s: of thousands of steps done again from a snapshot. Chosen."""
KEPT = "The last checkpoint is kept; the same command goes on from it."


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
    """All environments of a lesson, each by itself."""

    def __init__(
        self,
        scenarios: Sequence[AnyScenario],
        settings: TrainSettings,
        num_workers: int,
        ray: str | None = None,
        contacts: Contacts | None = None,
    ) -> None:
        """Make the environments.

        Args:
            scenarios: Of the lesson, among which the environments are divided evenly, in order.
            settings: Of the lesson.
            num_workers: Workers among which the environments are divided; with 0 they are in this process.
            ray: Address of the Ray cluster whose actors the workers are; None for processes of this machine.
            contacts: As `CaveEnv` has it.

        Raises:
            ResourceError: a worker does not start, or the cluster does not answer.
        """
        num = settings.num_envs
        per_env = [
            scenario
            for scenario, part in zip(scenarios, slices_of(num, len(scenarios)), strict=True)
            for _ in range(part.stop - part.start)
        ]
        self._slices = slices_of(num, num_workers)
        self._held = ExitStack()
        self.pool: WorkerPool | None = None
        """The workers; None where there are none."""
        if self._slices:
            transport: Transport = PipeTransport() if ray is None else self._held.enter_context(connected(ray))
            makes = [partial(make_group, per_env[part], settings, contacts) for part in self._slices]
            specs = [_worker_spec(make, is_on_ray=ray is not None) for make in makes]
            self.pool = self._held.enter_context(WorkerPool(transport, specs))
        else:
            self._group = EnvironmentGroup(per_env, settings, contacts)
            self._held.callback(self._group.close)
        self.render_mode = None
        self._actions: Any = None
        super().__init__(num, *self._spaces())

    def reset(self) -> Floats:
        """Begin all episodes, with the seeds given to `seed` the first time."""
        seeds, self._seeds = self._seeds, [None] * self.num_envs
        self._reset_options()
        return np.concatenate(self._call("reset", seeds))

    def step_async(self, actions: Any) -> None:
        """Take the actions of the next decision."""
        self._actions = actions
        if self.pool is not None:
            self.pool.call("step", [self._divided(actions)])

    def step_wait(self) -> tuple[Floats, Floats, Any, list[dict[str, Any]]]:
        """Carry out the decision."""
        parts: list[Stepped] = self.pool.answers() if self.pool is not None else [self._group.step(self._actions)]
        observations, rewards, dones, infos = zip(*parts, strict=True)
        return np.concatenate(observations), np.concatenate(rewards), np.concatenate(dones), _joined(infos)

    def state(self) -> dict[str, Any]:
        """Return where each environment is: its generator at the episode's start, and the actions since."""
        snapshots: list[Snapshot] = _joined(self._call("snapshots"))
        return {
            "starts": [snapshot["generator"] for snapshot in snapshots],
            "actions": [torch.from_numpy(snapshot["actions"].copy()) for snapshot in snapshots],
        }

    def restore(self, state: dict[str, Any]) -> Floats:
        """Bring each environment back to where it was; return the observations there."""
        pairs = zip(state["starts"], state["actions"], strict=True)
        snapshots: list[Snapshot] = [{"generator": start, "actions": actions.numpy()} for start, actions in pairs]
        return np.concatenate(self._call("restore", snapshots))

    def close(self) -> None:
        """Free all environments and end the workers."""
        self._held.close()

    def _spaces(self) -> tuple[Any, Any]:
        try:
            found: tuple[Any, Any] = self._call("spaces")[0]
            return found
        except BaseException:
            self.close()
            raise

    def _call(self, method: str, *columns: Sequence[Any]) -> list[Any]:
        """Return what a method of each group of environments returns for its part of the values."""
        if self.pool is None:
            return [getattr(self._group, method)(*columns)]
        self.pool.call(method, [self._divided(column) for column in columns])
        return self.pool.answers()

    def _divided(self, column: Sequence[Any]) -> list[Any]:
        return [column[part] for part in self._slices]

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of this object, once for each environment asked for."""
        value = getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: environments of a lesson are alike."""
        raise NotImplementedError("Environments of a lesson have their settings in common.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refuse: environments of a lesson are not called one by one."""
        raise NotImplementedError(f"Environments of a lesson have no method '{method_name}' of their own.")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each: what wraps them is no concern of SB3's."""
        return [False for _ in self._get_indices(indices)]


def _worker_spec(make: Callable[[Any], EnvironmentGroup], *, is_on_ray: bool) -> WorkerSpec:
    return WorkerSpec(
        make=as_at_home(make, versions) if is_on_ray else make,
        name="training worker",
        activity="environments ran",
        advice=KEPT,
        call_limit=CALL_LIMIT,
    )


def _joined(parts: Iterable[list[Any]]) -> list[Any]:
    return [item for part in parts for item in part]
