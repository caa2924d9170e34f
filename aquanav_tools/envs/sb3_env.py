"""The benchmark's task as a Stable-Baselines3 VecEnv: thousands of vehicles in one process."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from aquanav_tools.envs.batch import Floats, raise_failures, row_of
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.factory import Spec, make_batch


class BatchedVecEnv(VecEnv):
    """N vehicles in one cave or several, or N boats in bays; an ended episode's successor begins in the same step.

    The info of an episode's last step has "terminal_observation", "TimeLimit.truncated", "episode" (r, l, t, as SB3's
    Monitor), outcome and num_collisions; that of every other step is empty.
    """

    def __init__(self, scenarios: Spec | Sequence[Spec], num_envs: int, *, seed: int = 0, **options: Any) -> None:
        """Load one or several scenarios; arguments, `options` and errors are those of `make_batch`."""
        self._task = make_batch(scenarios, num_envs, next_step=False, **options)
        self._first_seed, self._num_resets = seed, 0
        self._began = time.time()
        self.render_mode = None
        super().__init__(num_envs, self._task.observation_space, self._task.action_space)

    def reset(self) -> Floats:
        """Begin all episodes; each call draws other starts, in an order that the seed gives."""
        seed = self._first_seed if self._seeds[0] is None else self._seeds[0]
        # Not seed + n, as SB3 counts: runs whose seeds follow one another would learn from nearly the same episodes.
        spread = np.random.SeedSequence([seed, self._num_resets]).generate_state(self.num_envs)
        self._task.reset(spread.tolist())
        raise_failures(self._task)
        self._num_resets += 1
        self._reset_seeds()
        self._reset_options()
        return self._task.copy_of("observations")

    def step_async(self, actions: Any) -> None:
        """Take the actions of the next decision."""
        self._task.command(actions)

    def step_wait(self) -> tuple[Floats, Floats, Any, list[dict[str, Any]]]:
        """Carry out the decision."""
        task = self._task
        task.step()
        raise_failures(task)
        truncated = task.copy_of("truncated")
        dones = task.view_of("terminated") | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            self._describe_ends(infos, np.flatnonzero(dones), truncated)
        return task.copy_of("observations"), task.copy_of("rewards"), dones, infos

    def close(self) -> None:
        """End the threads."""
        self._task.close()

    def _describe_ends(self, infos: list[dict[str, Any]], ended: Any, truncated: Any) -> None:
        view_of = self._task.view_of
        finals, outcomes = view_of("final_observations"), view_of("last_outcomes")
        returns, lengths, collisions = view_of("last_returns"), view_of("last_lengths"), view_of("last_collisions")
        elapsed = round(time.time() - self._began, 6)
        for n in ended:
            infos[n] = {
                "terminal_observation": row_of(finals, int(n)),
                "TimeLimit.truncated": bool(truncated[n]),
                "episode": {"r": float(returns[n]), "l": int(lengths[n]), "t": elapsed},
                "outcome": OUTCOMES[outcomes[n]],
                "num_collisions": int(collisions[n]),
            }

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the batch, once for each vehicle asked for."""
        value = getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: vehicles of a batch have no attributes of their own."""
        raise NotImplementedError("Vehicles of a batch share their settings. Make another batch.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refuse: vehicles of a batch have no methods of their own."""
        raise NotImplementedError(f"Vehicles of a batch have no method '{method_name}' of their own.")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> Sequence[bool]:  # type: ignore[override]
        """Return False for each vehicle: wrappers go around the batch."""
        return [False for _ in self._get_indices(indices)]
