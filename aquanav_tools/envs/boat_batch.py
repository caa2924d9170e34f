"""The benchmark's task for a batch of boats, each in a bay of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.batch_view import BatchView
from aquanav_tools.envs.dict_observation import parts_of
from aquanav_tools.envs.extended_batch import ExtendedBatch
from aquanav_tools.envs.extensions import Extensions
from aquanav_tools.envs.starting import CONDITIONS, NUM_SEEDS
from aquanav_tools.envs.surface_observation import surface_space
from aquanav_tools.envs.surface_task import Bay, SurfaceTask, refuse_in_bays, split_options
from aquanav_tools.sim.batch.boat_state import BoatEpisode
from aquanav_tools.sim.batch.random import NEXT, draw_many
from aquanav_tools.sim.command import AFLOAT
from aquanav_tools.task import task_options
from aquanav_tools.types import Array


class BoatBatch(ExtendedBatch):
    """N boats, with the options and definitions of `SurfaceEnv`: a `Batch`.

    A boat given a seed of its own has the very episode that `SurfaceEnv` has of it, as that is a batch of one: bay, sea
    and gusts are drawn on the host when the episode begins. The seed of its next episode follows from it, as in caves.
    """

    def __init__(
        self,
        bay: Bay,
        num: int,
        *,
        next_step: bool,
        action: str = "multidiscrete",
        device: str = "cpu",
        num_threads: int | None = None,
        **options: Any,
    ) -> None:
        """Prepare bays and boats; call `reset` next.

        Args:
            bay: As of `SurfaceEnv`.
            num: Number of boats.
            next_step: Whether an ended episode's successor begins at the next step, or in the same one.
            action: "multidiscrete", "discrete" or "continuous".
            device: "cpu", "cuda" or "cuda:0".
            num_threads: On the processor; None takes as many as the process may use.
            options: As of `SurfaceEnv`.

        Raises:
            ScenarioError: the bay cannot be read, or has no start.
            InputError: an option is unknown or senseless, or there is no such device.
        """
        choices, task = split_options(options)
        self.task = task_options(task)
        refuse_in_bays(self.task, choices.observation)
        self._parts = parts_of(choices.observation, self.task.observation_delay)
        self._own = Extensions(self.task, str(getattr(self._parts, "preset", choices.observation)), self._parts)
        self.definition = SurfaceTask(bay, choices, self.task, self._own)
        self.world = self.definition.make_world(num, self._draw, next_step, device, num_threads)
        self.num, self.decision_seconds = num, self.definition.numbers.dt * self.definition.numbers.substeps
        self.ray_lengths = self.definition.pattern.lengths
        self.parts: tuple[str, ...] = AFLOAT
        self._actions = ActionModel(action, AFLOAT)
        self.action_space = self._actions.space
        self._arrays: dict[str, npt.NDArray[Any]] = {
            name: np.zeros(num, dtype=np.int64) for name in ("episodes", "asked", "start_indices")
        }
        self._arrays["path_lengths"] = np.zeros(num)
        self._arrays |= {name: np.zeros((num, 2) if name == "current_range" else num) for name in CONDITIONS}
        self.observation_space = self._prepare_observations()

    def _prepare_observations(self) -> spaces.Space[Any]:
        """Return the space of what is observed, having made room for what the user's own code gives."""
        seconds = self.decision_seconds
        view = partial(BatchView, num=self.num, ray_lengths=self.ray_lengths, decision_seconds=seconds)
        preset, pairs = surface_space(self._own.observation), [(self.definition.bays.kind, self.definition.boat)]
        space = self._own.prepare(view, self.world, preset, pairs, None)
        return space if self._parts is None else self._parts.prepare(self.world, preset, pairs, None, self._own)

    @property
    def route_lengths(self) -> Array:
        """(N,) how far the goal was at the episodes' beginnings, m."""
        lengths: Array = self.copy_of("lengths")
        return lengths

    @property
    def path_lengths(self) -> Array:
        """(N,) length of the shortest way to the goal from where each episode began, m."""
        lengths: Array = self.copy_of("path_lengths")
        return lengths

    def reset(
        self,
        seeds: Sequence[int],
        starts: Sequence[int | None] | None = None,
        conditions: dict[str, Any] | None = None,
    ) -> None:
        """Begin all episodes, each from a seed of its own: see `Batch`."""
        arrays = self._arrays
        self.world.write("seeds", np.array([seed % NUM_SEEDS for seed in seeds], dtype=np.uint32).view(np.int32))
        arrays["episodes"][:] = 0
        arrays["asked"][:] = [-1 if start is None else start for start in starts or [None] * self.num]
        for name in CONDITIONS:
            arrays[name][:] = (conditions or {}).get(name, getattr(self.task, name))
        self.world.reset()
        self._begin_observing()

    def randomise_time_limits(self, seed: int) -> None:
        """Let time run out earlier, by chance, in the episodes that have just begun."""
        most = self.definition.numbers.max_decisions
        self.world.randomise_time_limits(np.random.default_rng(seed).integers(most, size=self.num))

    def view_of(self, name: str) -> Any:
        """Return an array of a `Batch`, which later steps change; of a `Dict`, one for each part."""
        return self._arrays[name] if name in self._arrays else super().view_of(name)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on; bays and seas come again from their seeds."""
        own = self._own.state() | ({} if self._parts is None else self._parts.state())
        return {name: values.copy() for name, values in self._arrays.items()} | self.world.state() | own

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken."""
        for name in ("asked", *CONDITIONS):
            self._arrays[name][:] = state[name]
        self.world.write("seeds", state["seeds"])
        self._arrays["episodes"][:] = 0  # so that they begin again with these seeds
        self.world.reset()
        self._arrays["episodes"][:] = state["episodes"]
        self.world.restore(state)
        self._own.restore(state)
        if self._parts is not None:
            self._parts.restore(state)

    def _draw(self, i: int) -> BoatEpisode:
        """Return the next episode of a boat."""
        arrays, seeds = self._arrays, self.world.as_numpy("seeds")[i : i + 1].view(np.uint32)
        if arrays["episodes"][i] > 0:
            seeds, arrays["asked"][i] = draw_many(seeds, NEXT), -1
        asked, seed = int(arrays["asked"][i]), int(seeds[0])
        noise, dropout = float(arrays["sensor_noise"][i]), float(arrays["sensor_dropout"][i])
        low, high = arrays["current_range"][i].tolist()
        task = replace(self.task, sensor_noise=noise, sensor_dropout=dropout, current_range=(low, high))
        drawn = self.definition.draw(seed, task, asked if asked >= 0 else None)
        arrays["episodes"][i] += 1
        arrays["start_indices"][i] = drawn.start_index
        arrays["path_lengths"][i] = 0.0 if drawn.path is None else drawn.path.length
        return drawn
