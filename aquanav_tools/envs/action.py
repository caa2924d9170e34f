"""From an action to a command: ballast (up), steer (left) and thrust (ahead), each in [-1, 1]."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.errors import InputError


class Command(NamedTuple):
    """What the actuators are told for one decision."""

    ballast: float
    """-1 heavier to 1 lighter; 0 keeps the trim."""
    steer: float
    """-1 right to 1 left."""
    thrust: float
    """-1 reverse to 1 ahead."""


IDLE = Command(0.0, 0.0, 0.0)
ACTIONS = ("multidiscrete", "discrete", "continuous")
NUM_CHOICES = 3


class ActionModel:
    """One of the three forms of an action, its space and its meaning.

    - multidiscrete: [ballast 0 up, 1 keep, 2 down; steer 0 left, 1 straight, 2 right; thrust 0 reverse,
      1 stop, 2 ahead]
    - discrete: 9 * ballast + 3 * steer + thrust of the above
    - continuous: [ballast, steer, thrust] in [-1, 1]; positive is up, left and ahead
    """

    def __init__(self, name: str) -> None:
        check_choice("action form", name, ACTIONS)
        self.space: spaces.Space[Any] = _SPACES[name]()
        self._convert = _CONVERTERS[name]

    def command(self, action: Any) -> Command:
        """Return the command of an action.

        Raises:
            InputError: the action is not in the space.
        """
        return self._convert(action)


def _from_choices(action: Any) -> Command:
    try:
        # Numbers from a list take a quarter of the time of those from an array.
        ballast, steer, thrust = map(int, action.tolist() if isinstance(action, np.ndarray) else action)
    except (TypeError, ValueError) as cause:
        raise InputError(f"An action must be 3 choices from 0 to 2, got {action!r}.") from cause
    if not (0 <= ballast < NUM_CHOICES and 0 <= steer < NUM_CHOICES and 0 <= thrust < NUM_CHOICES):
        raise InputError(f"An action must be 3 choices from 0 to 2, got {action!r}.")
    return _COMMANDS[9 * ballast + 3 * steer + thrust]


def _from_number(action: Any) -> Command:
    number = int(action)
    if not 0 <= number < NUM_CHOICES**3:
        raise InputError(f"An action must be a number from 0 to 26, got {action!r}.")
    return _COMMANDS[number]


def _from_levels(action: Any) -> Command:
    levels = np.asarray(action, dtype=np.float64)
    if levels.shape != (3,) or not np.isfinite(levels).all():
        raise InputError(f"An action must be 3 finite numbers, got {action!r}. Did the policy diverge?")
    return Command(*np.clip(levels, -1.0, 1.0).tolist())


_COMMANDS = [Command(1.0 - ballast, 1.0 - steer, thrust - 1.0) for ballast, steer, thrust in np.ndindex(3, 3, 3)]
"""By the number of the action; making a new one each time takes longer than all of the choices' checks."""
_SPACES: dict[str, Callable[[], spaces.Space[Any]]] = {
    "multidiscrete": lambda: spaces.MultiDiscrete([NUM_CHOICES] * 3),
    "discrete": lambda: spaces.Discrete(NUM_CHOICES**3),
    "continuous": lambda: spaces.Box(-1.0, 1.0, (3,), np.float32),
}
_CONVERTERS: dict[str, Callable[[Any], Command]] = {
    "multidiscrete": _from_choices,
    "discrete": _from_number,
    "continuous": _from_levels,
}
