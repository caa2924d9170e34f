"""The benchmark's task as a Gymnasium vector environment: thousands of vehicles in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from aquanav_tools.envs.batch import Batch, Floats, raise_failures, row_of
from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.factory import NUM_DRAWN, with_drawn
from aquanav_tools.envs.starting import NUM_SEEDS, episode_conditions
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.sea_map import SeaMap

Flags = npt.NDArray[np.bool_]


class BatchVectorEnv(VectorEnv[Floats, Any, Any]):
    """N vehicles, each at the task of the environment with one: same action, observation, reward and episode.

    ## Autoreset
    `autoreset_mode`: NEXT_STEP, Gymnasium's default, begins the next episode in the step after an episode's end, whose
    action is not used and whose reward is 0. SAME_STEP begins it at once; the last observation is then in
    `infos["final_obs"]`, what else is known of the end in `infos["final_info"]`.

    ## Info
    One array each, (N,) unless noted: position (N, 3), velocity (N, 6), clearance, collision, num_collisions,
    progress, remaining, cost, start_index, outcome, and the reward's terms ("reward/<name>"). Units are those of the
    environment with one vehicle. Each vehicle has a seed of its own, so that its episodes do not depend on the others'.
    """

    closed = True
    """Until there is something to close: Gymnasium below 1.3 closes what failed to begin, too."""

    def __init__(self, num_envs: int, mode: AutoresetMode | str, make: Callable[..., Batch]) -> None:
        """Wrap the batch that `make` returns of a number of vehicles and `next_step`."""
        mode = AutoresetMode(mode)
        if mode is AutoresetMode.DISABLED:
            raise InputError("A batch begins the next episodes itself. Choose NEXT_STEP or SAME_STEP.")
        self.batch = make(num_envs, next_step=mode is AutoresetMode.NEXT_STEP)
        self.closed = False
        self._is_same_step = mode is AutoresetMode.SAME_STEP
        self.num_envs = num_envs
        self.single_action_space = self.batch.action_space
        self.single_observation_space = self.batch.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.metadata = {"autoreset_mode": mode, "render_modes": [], "contacts": self.batch.contacts}

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin all episodes.

        Args:
            seed: (N,) of the vehicles' episodes. One number counts on from vehicle to vehicle, as in Gymnasium's own
                vector environments; None, also within a list, draws from this environment's generator.
            options: {"start": index of a start, or (N,) indices}; later episodes draw theirs. And, until the next
                reset, sensor_noise, sensor_dropout and current_range of the task: one value for all vehicles, or (N,)
                of them ((N, 2) of the range).
        """
        if isinstance(seed, list) and len(seed) != self.num_envs:
            raise InputError(f"A batch of {self.num_envs} vehicles takes as many seeds, or one; got {len(seed)}.")
        super().reset(seed=None if isinstance(seed, list) else seed)
        given = options or {}
        conditions = episode_conditions(given, self.num_envs)
        starts = given.get("start")
        if starts is not None:
            starts = np.broadcast_to(np.asarray(starts), (self.num_envs,)).tolist()
        self.batch.reset(self._seeds(seed), starts, conditions)
        raise_failures(self.batch)
        return self.batch.copy_of("observations"), self._infos()

    def _seeds(self, seed: int | list[int | None] | None) -> list[int]:
        """Return a seed for each vehicle."""
        given = [seed + n for n in range(self.num_envs)] if isinstance(seed, int) else seed or [None] * self.num_envs
        return [int(self.np_random.integers(NUM_SEEDS)) if one is None else one % NUM_SEEDS for one in given]

    def step(self, actions: Any) -> tuple[Floats, Floats, Flags, Flags, dict[str, Any]]:
        """Hold each vehicle's action for one decision."""
        task = self.batch
        task.command(actions)
        task.step()
        raise_failures(task)
        terminated, truncated = task.copy_of("terminated"), task.copy_of("truncated")
        infos = self._infos()
        if self._is_same_step and (ended := terminated | truncated).any():
            infos.update(self._final_infos(ended))
        return task.copy_of("observations"), task.copy_of("rewards"), terminated, truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        self.batch.close()

    def _infos(self) -> dict[str, Any]:
        copy_of = self.batch.copy_of
        is_touched = copy_of("touched") > 0
        infos = {
            "position": copy_of("positions"),
            "velocity": copy_of("velocities"),
            "clearance": copy_of("clearances"),
            "collision": is_touched,
            "num_collisions": copy_of("collisions"),
            "remaining": copy_of("remaining"),
            "cost": is_touched.astype(np.float64),
            "start_index": copy_of("start_indices"),
            "outcome": np.array(OUTCOMES)[self.batch.view_of("outcomes")],
        }
        infos["progress"] = self.batch.route_lengths - infos["remaining"]
        terms = copy_of("terms")
        infos.update({f"reward/{name}": terms[:, n] for n, name in enumerate(self.batch.term_names)})
        infos.update({f"dynamics/{name}": values.copy() for name, values in self.batch.dynamics.items()})
        return infos | {f"_{name}": np.ones(self.num_envs, dtype=bool) for name in infos}

    def _final_infos(self, ended: Flags) -> dict[str, Any]:
        """Return what Gymnasium asks for of episodes that ended in this step, whose successors have begun."""
        observations = np.full(self.num_envs, None, dtype=object)
        finals = self.batch.view_of("final_observations")
        for vehicle in np.flatnonzero(ended):
            observations[vehicle] = row_of(finals, int(vehicle))
        final_info = {
            "outcome": np.array(OUTCOMES)[self.batch.view_of("last_outcomes")],
            "num_collisions": self.batch.copy_of("last_collisions"),
            "return": self.batch.copy_of("last_returns"),
            "length": self.batch.copy_of("last_lengths"),
        }
        final_info |= {f"_{name}": ended for name in final_info}
        return {"final_obs": observations, "_final_obs": ended, "final_info": final_info, "_final_info": ended}


class CaveVectorEnv(BatchVectorEnv):
    """N vehicles in one cave, each at the task of `CaveEnv`; or shared out over several caves.

    `gymnasium.make_vec("aquanav/Cave-v0", num_envs=1024, vectorization_mode="vector_entry_point", scenario=...)`, with
    a list of scenarios where there are several: `batch.slices` then has the slice of the vehicles in each of them.
    generated/mixed, or another style without a seed, stands for `num_caves` caves that `cave_seed` draws.
    """

    def __init__(
        self,
        num_envs: int,
        scenario: str | Path | Scenario | Sequence[str | Path | Scenario],
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        num_caves: int = NUM_DRAWN,
        cave_seed: int = 0,
        **options: Any,
    ) -> None:
        """Load the scenarios; `options` are those of `CaveBatch`.

        Raises:
            ScenarioError: a scenario cannot be read, or has no start.
            InputError: an option is unknown, senseless or not batched, or there are fewer vehicles than caves.
        """
        caves = with_drawn(scenario, num_envs, num_caves, cave_seed)
        super().__init__(num_envs, autoreset_mode, partial(CaveBatch, caves, **options))


class SurfaceVectorEnv(BatchVectorEnv):
    """N boats, each in bays of its own, at the task of `SurfaceEnv`.

    `gymnasium.make_vec("aquanav/Surface-v0", num_envs=256, vectorization_mode="vector_entry_point", sea="breeze")`
    """

    def __init__(
        self,
        num_envs: int,
        bay: SeaMap | MapSettings | int | str | Path | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        """Prepare bays as `SurfaceEnv` does; `options` are those of `BoatBatch`.

        Raises:
            ScenarioError: the bay cannot be read, or has no start.
            InputError: an option is unknown, senseless or not batched.
        """
        super().__init__(num_envs, autoreset_mode, partial(BoatBatch, bay, **options))
