"""The benchmark's task for a batch of boats, each in a bay of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import AFLOAT, ActionModel
from aquanav_tools.envs.batch import Floats
from aquanav_tools.envs.reward import TERMS
from aquanav_tools.envs.starting import CONDITIONS
from aquanav_tools.envs.surface_task import Bay, SurfaceTask, split_options
from aquanav_tools.sim.batch.boat_state import BoatEpisode
from aquanav_tools.task import task_options
from aquanav_tools.types import Array


class BoatBatch:
    """N boats at the task of `SurfaceEnv`, with the same options and definitions: a `Batch`.

    A boat given a seed of its own has the very episode that `SurfaceEnv` has of it: bay, sea and gusts are drawn in the
    same order from the same generator, on the host when the episode begins. Its later episodes are drawn from that seed
    and their number.
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
        self._task = SurfaceTask(bay, choices, task_options(task))
        self.world = self._task.make_world(
            num, self._draw, "next_step" if next_step else "same_step", device, num_threads
        )
        self.num, self.decision_seconds = num, self._task.numbers.dt * self._task.numbers.substeps
        self.ray_lengths = self._task.pattern.lengths
        self.observation_space = self._task.observation_space
        self.parts: tuple[str, ...] = AFLOAT
        self._actions = ActionModel(action, AFLOAT)
        self.action_space = self._actions.space
        self._arrays: dict[str, npt.NDArray[Any]] = {
            name: np.zeros(num, dtype=np.int64) for name in ("seeds", "episodes", "asked", "start_indices")
        }
        self._arrays["path_lengths"] = np.zeros(num)
        self._arrays |= {name: np.zeros((num, 2) if name == "current_range" else num) for name in CONDITIONS}

    @property
    def dynamics(self) -> dict[str, Array]:
        """Nothing: boats are as their files have them."""
        return {}

    @property
    def term_names(self) -> tuple[str, ...]:
        """Of the columns of "terms"."""
        return TERMS

    @property
    def failures(self) -> dict[int, str]:
        """None: boats have no code of the user's own."""
        return {}

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
        arrays["seeds"][:], arrays["episodes"][:] = seeds, 0
        arrays["asked"][:] = [-1 if start is None else start for start in starts or [None] * self.num]
        for name in CONDITIONS:
            arrays[name][:] = (conditions or {}).get(name, getattr(self._task.options, name))
        self.world.reset()

    def randomise_time_limits(self, seed: int) -> None:
        """Let time run out earlier, by chance, in the episodes that have just begun."""
        most = self._task.numbers.max_decisions
        self.world.randomise_time_limits(np.random.default_rng(seed).integers(most, size=self.num))

    def command(self, actions: Any) -> None:
        """Hand the actions of all boats to the next step."""
        self.set_commands(self._actions.commands(actions, self.num))

    def set_commands(self, commands: Floats) -> None:
        """Hand (N, 3) ballast, of which boats have none, steer and thrust in [-1, 1] to the next step."""
        self.world.set_commands(commands)

    def retire(self, vehicles: Sequence[int]) -> None:
        """Let no episode follow of these vehicles until the next reset."""
        self.world.retire(vehicles)

    def step(self) -> None:
        """Carry out a decision of every boat; where the last one ended an episode, begin the next instead."""
        self.world.step()

    def view_of(self, name: str) -> Any:
        """Return an array of a `Batch`, which later steps change."""
        return self._arrays[name] if name in self._arrays else self.world.view_of(name)

    def copy_of(self, name: str) -> Any:
        """Return a copy of an array that later steps leave alone."""
        return np.array(self.view_of(name))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on; bays and seas come again from their seeds."""
        return {name: values.copy() for name, values in self._arrays.items()} | self.world.state()

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken."""
        for name in ("seeds", "episodes", "asked", *CONDITIONS):
            self._arrays[name][:] = state[name]
        self._arrays["episodes"] -= 1  # they have begun
        self.world.reset()
        self.world.restore({name: values for name, values in state.items() if name not in self._arrays})

    def close(self) -> None:
        """End the threads."""
        self.world.close()

    def _draw(self, i: int) -> BoatEpisode:
        """Return the next episode of a boat."""
        arrays = self._arrays
        episode, seed = int(arrays["episodes"][i]), int(arrays["seeds"][i])
        rng = np.random.default_rng([seed, episode] if episode else seed)
        noise, dropout = float(arrays["sensor_noise"][i]), float(arrays["sensor_dropout"][i])
        low, high = arrays["current_range"][i].tolist()
        task = replace(self._task.options, sensor_noise=noise, sensor_dropout=dropout, current_range=(low, high))
        asked = int(arrays["asked"][i]) if episode == 0 else -1
        start = asked if asked >= 0 else None
        drawn = self._task.draw(rng, task, start)
        arrays["episodes"][i] += 1
        arrays["start_indices"][i] = drawn.start_index
        arrays["path_lengths"][i] = 0.0 if drawn.path is None else drawn.path.length
        return drawn
