"""The user's own reward, sensors, observation, termination rule and disturbance: what each is asked, and its answer.

Every one sees a `BatchView` and returns arrays with a row per vehicle, so that one definition is for one vehicle and
for thousands. What they return is checked; where one fails, the vehicles that it fails for are found by asking about
each of them alone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.batch_view import BatchView, stream_of
from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.registry import Registry, error_text, is_own
from aquanav_tools.sim.batch.sensors import BUILT_IN


class Reward(Protocol):
    """What is paid for. An attribute `base` may name a reward of aquanav's, whose terms are then paid as well."""

    def terms(self, batch: BatchView) -> dict[str, npt.ArrayLike]:
        """Return each term, (N,), by its name: the same names always. The reward is their sum."""


class Sensor(Protocol):
    """Something that measures."""

    def spec(self, scenario: Any, vehicle: Any) -> spaces.Box:
        """Return the space of one vehicle's reading."""

    def measure(self, batch: BatchView) -> npt.ArrayLike:
        """Return the readings, (N, ...): each is in the space."""


class Observation(Protocol):
    """What is observed in place of a preset. `base` may name the preset in `batch.observations`; "full" if absent."""

    space: spaces.Box

    def __call__(self, batch: BatchView) -> npt.ArrayLike:
        """Return what each vehicle observes, (N, ...)."""


class Termination(Protocol):
    """A rule that ends episodes with the outcome "ended"."""

    def __call__(self, batch: BatchView) -> npt.ArrayLike:
        """Return which episodes are over, (N,) bool."""


class Disturbance(Protocol):
    """What comes between policy and vehicle; either method may be left out."""

    def actions(self, batch: BatchView, commands: npt.NDArray[np.float32]) -> npt.ArrayLike:
        """Return the (N, 3) ballast, steer and thrust that act, of those that were chosen; all in [-1, 1]."""

    def observations(self, batch: BatchView, observations: npt.NDArray[np.float32]) -> npt.ArrayLike:
        """Return what is observed, (N, O), of what would be."""


KINDS = ("reward", "sensor", "observation", "termination rule", "disturbance", "law of motion")


class Motion(Protocol):
    """How vehicles move in free water."""

    def __call__(
        self,
        states: npt.NDArray[np.float64],
        commands: npt.NDArray[np.float64],
        currents: npt.NDArray[np.float64],
        dt: float,
    ) -> npt.ArrayLike:
        """Return the (M, 13) states of vehicles a physics step later, of the moment alone.

        Args:
            states: (M, 13) positions (world, m), quaternions (w, x, y, z), velocities over ground (body, m/s) and rates
                of turn (body, rad/s).
            commands: (M, 3) ballast, steer and thrust, each in [-1, 1].
            currents: (M, 3) velocities of the water (world, m/s).
            dt: Duration of the step, s.
        """  # fmt: skip


class WrongAnswerError(Exception):
    """What a definition returned is not what is asked for."""


Check = Callable[[Any, int], npt.NDArray[Any]]
"""Returns the answer about a number of vehicles as an array with a row for each; raises WrongAnswerError."""


class OwnCode:
    """One definition of the user's own: called, and what it returns checked."""

    def __init__(self, kind: str, name: str, method: str | None = None, made: Any = None) -> None:
        """Take a definition, imported by its name if it is not there yet.

        Args:
            kind: "reward" and so on.
            name: module:Name.
            method: That is called; None calls the definition itself.
            made: The definition; None imports it.

        Raises:
            InputError: the name is not module:Name, or it means nothing that can be called so.
        """
        self.label, self.made = f"The {kind} {name}", Registry(kind, {}).find(name) if made is None else made
        self._stream = stream_of(name)
        self._call = self.made if method is None else getattr(self.made, method, None)
        if not callable(self._call):
            what = f"has no method `{method}`" if method else "cannot be called"
            raise InputError(
                f"{self.label} is a {type(self.made).__name__}, which {what}. docs/extending.md shows what it takes."
            )

    def without_batch(self, *more: Any) -> None:
        """Call the definition with the other arguments of `ask` and these, and not with a batch."""
        law: Any = self.made
        self._call = lambda _, *values: law(*values, *more)

    def ask(
        self, batch: BatchView, check: Check, failures: dict[int, str], *values: npt.NDArray[Any]
    ) -> npt.NDArray[Any] | None:
        """Return what the definition says of all vehicles, checked.

        Args:
            batch: The vehicles.
            check: Of the answer.
            failures: Gets the reason for each vehicle that the answer fails for, unless it has one.
            values: Further (N, ...) arguments.

        Returns:
            An array with a row per vehicle, zeros where it fails; None where it fails for all.
        """
        batch.stream = self._stream
        try:
            return check(self._call(batch, *values), batch.num)  # type: ignore[misc]  # it is callable
        except Exception as cause:  # foreign code: whatever it raises is told
            whole = cause
        answers = {}
        for row in range(batch.num):
            try:
                alone = [value[row : row + 1] for value in values]
                answers[row] = check(self._call(batch.only([row]), *alone), 1)[0]  # type: ignore[misc]
            except Exception as cause:
                failures.setdefault(row, self._reason(cause, batch, row))
        if len(answers) == batch.num:  # each alone is right, so that all of them are to blame
            for row in range(batch.num):
                failures.setdefault(row, self._reason(whole, batch, row))
        if not answers:
            return None
        blank = np.zeros_like(next(iter(answers.values())))
        return np.stack([answers.get(row, blank) for row in range(batch.num)])

    def _reason(self, error: Exception, batch: BatchView, row: int) -> str:
        what = str(error) if isinstance(error, WrongAnswerError) else f"raised {error_text(error)}"
        return f"{self.label} {what}, after {int(batch.decisions[row])} decisions of the episode."


def array_of(given: Any, shape: tuple[int, ...], dtype: type) -> npt.NDArray[Any]:
    """Return an answer as an array.

    Raises:
        WrongAnswerError: it has another shape, is not of numbers (or of bool, where these are asked for), or is not
            finite.
    """
    array = np.asarray(given)
    if array.shape != shape:
        raise WrongAnswerError(f"returned an array of shape {array.shape}, and {shape} is asked for")
    kinds, wanted = ("b", "bool") if dtype is np.bool_ else ("bif", "numbers")
    if array.dtype.kind not in kinds:
        raise WrongAnswerError(f"returned {array.dtype}, and {wanted} are asked for")
    if not np.isfinite(array).all():
        row = np.flatnonzero(~np.isfinite(array.reshape(len(array), -1)).all(axis=1))[0]
        raise WrongAnswerError(f"returned {array[row]}, which is not finite")
    return array.astype(dtype)


def is_own_code(reason: str) -> bool:
    """Return whether an episode failed by code of the user's own, by the reason; else by the policy."""
    return reason.startswith(tuple(f"The {kind} " for kind in KINDS))


def check_reading(given: Any, num: int, like: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return readings with the shape and the type of other (N, ...) readings; a `definitions.Check`."""
    return array_of(given, (num, *like.shape[1:]), like.dtype.type)


def check_flags(given: Any, num: int) -> npt.NDArray[Any]:
    """Return (num,) bool; a `Check`."""
    return array_of(given, (num,), np.bool_)


def check_commands(given: Any, num: int) -> npt.NDArray[Any]:
    """Return (num, 3) commands in [-1, 1]; a `Check`."""
    commands = array_of(given, (num, 3), np.float32)
    if (abs(commands) > 1.0).any():
        raise WrongAnswerError(f"returned a command of {commands[abs(commands) > 1.0][0]:g}, outside of -1 to 1")
    return commands


def find_disturbance(name: str | None) -> tuple[OwnCode | None, OwnCode | None]:
    """Return what disturbs actions, and what disturbs observations."""
    if name is None:
        return None, None
    made = Registry("disturbance", {}).find(name)
    methods = [method if hasattr(made, method) else None for method in ("actions", "observations")]
    if not any(methods):
        raise InputError(
            f"The disturbance {name} is a {type(made).__name__} with neither a method `actions` nor `observations`. "
            "docs/extending.md shows what is asked for."
        )
    act, blur = (OwnCode("disturbance", name, method) if method else None for method in methods)
    return act, blur


def base_of(own: OwnCode, usual: str, known: Collection[str]) -> str:
    """Return what of aquanav's a definition adds to."""
    name = str(getattr(own.made, "base", usual))
    if name not in known:
        raise InputError(f"{own.label} has the base '{name}', which there is not.{did_you_mean(name, known)}")
    return name


def common_box(own: OwnCode, pairs: Sequence[tuple[Any, Any]]) -> spaces.Box:
    """Return the space of a sensor of the user's own, which must be the same in all scenarios of a batch.

    Raises:
        InputError: it is not, or it is no box.
    """
    first, *others = [box_of(own, partial(_spec_in, pair)) for pair in pairs]
    if any(other != first for other in others):
        raise InputError(
            f"{own.label} has other spaces in other scenarios of a batch. In one batch it must be the same."
        )
    return first


def _spec_in(pair: tuple[Any, Any], sensor: Any) -> Any:
    return sensor.spec(*pair)


def find_sensor(name: str) -> OwnCode | Any:
    """Return a sensor of the user's own, or one that comes with aquanav."""
    if is_own(name):
        return OwnCode("sensor", name, "measure")
    Registry("sensor", BUILT_IN).find(name)
    from aquanav_tools.sim.batch.sensors.suite import make_sensor

    return make_sensor(name)


def box_of(own: OwnCode, space_of: Callable[[Any], Any]) -> spaces.Box:
    """Return the space of what a definition returns."""
    try:
        space = space_of(own.made)
    except Exception as cause:  # foreign code
        raise InputError(f"{own.label} cannot tell its space: {error_text(cause)}. It has {_SPACE}.") from cause
    if not isinstance(space, spaces.Box):
        raise InputError(f"{own.label} has {space!r} for a space. It has {_SPACE}.")
    return space


_SPACE = "a gymnasium.spaces.Box: an observation as `space`, a sensor from `spec(scenario, vehicle)`"
