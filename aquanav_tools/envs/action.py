"""From actions to commands: ballast (up), steer (left) and thrust (ahead), each in [-1, 1]."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.errors import InputError
from aquanav_tools.sim.command import DIVING, NUM_CHOICES, Command, command_of

ACTIONS = ("multidiscrete", "discrete", "continuous")


def choices_of(commands: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return the (..., 3) multidiscrete actions of (..., 3) commands, each -1, 0 or 1: ballast, steer and thrust."""
    return (1 + np.array([-1, -1, 1]) * np.asarray(commands)).astype(np.int64)


class ActionModel:
    """One of the three forms of an action, its space and its meaning.

    - multidiscrete: [ballast 0 up, 1 keep, 2 down; steer 0 left, 1 straight, 2 right; thrust 0 reverse,
      1 stop, 2 ahead]
    - discrete: 9 * ballast + 3 * steer + thrust of the above
    - continuous: [ballast, steer, thrust] in [-1, 1]; positive is up, left and ahead

    Boats have no ballast: their actions are the same without it.
    """

    def __init__(self, name: str, parts: Sequence[str] = DIVING) -> None:
        """Prepare a form of an action; `parts` is DIVING or AFLOAT."""
        check_choice("action form", name, ACTIONS)
        self._num, self._form = len(parts), name
        self._choices = (NUM_CHOICES,) * len(parts)
        self._commands = {choices: command_of(parts, choices) for choices in np.ndindex(self._choices)}
        self._table = np.array(list(self._commands.values()), dtype=np.float32)
        self._numbered: dict[float, Command] = dict(enumerate(self._commands.values()))
        """By the number of the action; making a new one each time takes longer than all of the choices' checks."""
        self._absent = (0.0,) * (len(DIVING) - len(parts))
        self.space, self._convert = self._forms()[name]

    def command(self, action: Any) -> Command:
        """Return the command of an action.

        Raises:
            InputError: the action is not in the space.
        """
        return self._convert(action)

    def commands(self, actions: Any, num: int) -> npt.NDArray[np.float32]:
        """Return the (N, 3) commands of the actions of `num` vehicles.

        Raises:
            InputError: one is not in the space.
        """
        given = np.asarray(actions)
        shape = (num,) if self._form == "discrete" else (num, self._num)
        if given.shape != shape or given.dtype.kind not in "biuf":
            raise InputError(
                f"Actions must be numbers, one for each of the {num} vehicles and so of shape {shape}; got "
                f"{given.dtype} of {given.shape}."
            )
        if self._form == "continuous":
            if not np.isfinite(given).all():
                raise InputError("An action is not finite. Did the policy diverge?")
            commands = np.zeros((num, len(DIVING)), dtype=np.float32)
            np.clip(given, -1.0, 1.0, out=commands[:, len(self._absent) :], casting="same_kind")
            return commands
        most, form = (NUM_CHOICES, "choices") if self._form == "multidiscrete" else (len(self._table), "numbers")
        with np.errstate(invalid="ignore"):
            numbers = given.astype(np.int64)
        if given.size and not ((numbers == given).all() and 0 <= given.min() and given.max() < most):
            raise InputError(f"Actions must be whole {form} from 0 to {most - 1}, got {given.min()} to {given.max()}.")
        if self._form == "multidiscrete":
            numbers = np.ravel_multi_index(tuple(numbers.T), self._choices)
        return self._table[numbers]

    def _forms(self) -> dict[str, tuple[spaces.Space[Any], Callable[[Any], Command]]]:
        return {
            "multidiscrete": (spaces.MultiDiscrete([NUM_CHOICES] * self._num), self._from_choices),
            "discrete": (spaces.Discrete(NUM_CHOICES**self._num), self._from_number),
            "continuous": (spaces.Box(-1.0, 1.0, (self._num,), np.float32), self._from_levels),
        }

    def _from_choices(self, action: Any) -> Command:
        try:
            # Numbers from a list take a quarter of the time of those from an array. Floats: int(1.7) would pass for 1.
            return self._commands[tuple(map(float, action.tolist() if isinstance(action, np.ndarray) else action))]
        except (TypeError, ValueError, KeyError) as cause:
            raise InputError(f"An action must be {self._num} choices from 0 to 2, got {action!r}.") from cause

    def _from_number(self, action: Any) -> Command:
        try:
            return self._numbered[float(action)]
        except (TypeError, ValueError, KeyError) as cause:
            raise InputError(
                f"An action must be a whole number from 0 to {len(self._numbered) - 1}, got {action!r}."
            ) from cause

    def _from_levels(self, action: Any) -> Command:
        try:
            levels = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            levels = np.empty(0)
        if levels.shape != (self._num,) or not np.isfinite(levels).all():
            raise InputError(f"An action must be {self._num} finite numbers, got {action!r}. Did the policy diverge?")
        return Command(*self._absent, *np.clip(levels, -1.0, 1.0).tolist())
