"""What is put around a policy by a word before its name: a safety shield, or a planner."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.planner import PlannedPolicy
from aquanav_tools.evaluate.policy_kinds import BatchPrivileged, PrivilegedPolicy, Vectorised
from aquanav_tools.evaluate.presets import CAVE
from aquanav_tools.evaluate.shield import ShieldedPolicy

if TYPE_CHECKING:
    from aquanav_tools.evaluate.policies import LoadedPolicy

SHIELD, PLANNER = "shield:", "planner:"
WRAPPERS = (SHIELD, PLANNER)


def wrapper_of(spec: str) -> str:
    """Return what stands first before a policy's name; empty where nothing does."""
    return next((wrapper for wrapper in WRAPPERS if spec.startswith(wrapper)), "")


def inner_of(spec: str) -> str:
    """Return the policy's name alone, without all that stands before it."""
    while wrapper := wrapper_of(spec):
        spec = spec.removeprefix(wrapper)
    return spec


def wrapped(wrapper: str, inner: LoadedPolicy, sensors: tuple[str, ...], history: tuple[int, ...]) -> LoadedPolicy:
    """Return a policy inside a wrapper.

    Args:
        wrapper: Which.
        inner: The policy.
        sensors: That it observes by what options name; its file may say others.
        history: The earlier decisions, likewise.

    Raises:
        InputError: it does not go into that.
    """
    if wrapper == SHIELD:
        return _shielded(inner)
    if inner.observed is not None:
        sensors, history = inner.observed.sensors, inner.observed.history
    return _planned(inner, sensors, history)


def _planned(inner: LoadedPolicy, sensors: tuple[str, ...], history: tuple[int, ...]) -> LoadedPolicy:
    if inner.observation != "full" or inner.takes is not None or inner.parts is not None:
        raise InputError(
            f"The planner reads the preset 'full' and sensors behind it, and the policy {inner.name} observes another "
            "one, or a dictionary of parts. Leave out planner:."
        )
    if history:
        raise InputError(
            f"The policy {inner.name} observes earlier decisions, in which the goal is where it was, and the planner "
            "shows it another. Leave out planner:."
        )
    if inner.task not in (None, CAVE):
        raise InputError(f"The planner knows ways through caves, and {inner.name} steers a boat. Leave out planner:.")
    is_privileged = isinstance(inner.policy, PrivilegedPolicy | BatchPrivileged)
    if is_privileged or not isinstance(inner.policy, Vectorised):
        raise InputError(
            f"The planner leads networks, which see the goal where it says, and {inner.name} is a program. Leave out "
            "planner:."
        )
    policy = PlannedPolicy(inner.policy, sensors)
    return replace(inner, policy=policy, name=PLANNER + inner.name, task=CAVE)


def _shielded(inner: LoadedPolicy) -> LoadedPolicy:
    if inner.takes is not None or inner.parts is not None:
        raise InputError(
            f"The shield hands on the values of the presets 'full' and 'paper', and the policy {inner.name} observes a "
            "dictionary of parts. Leave out shield:."
        )
    if inner.observation == "original":
        raise InputError(
            f"The policy {inner.name} observes the preset 'original', which has no speed, so the shield cannot foresee "
            "where an action leads. Shield a policy that observes 'full' or 'paper'."
        )
    has_more = inner.observed is not None and bool(inner.observed.sensors or inner.observed.history)
    if has_more and inner.observation != "full":
        raise InputError(
            f"The policy {inner.name} observes '{inner.observation}' and sensors or earlier decisions behind it, which "
            "the shield hands on behind 'full' alone. Leave out shield:."
        )
    if inner.task not in (None, CAVE):
        raise InputError(f"The shield keeps off the walls of caves, and {inner.name} steers a boat. Leave out shield:.")
    policy = ShieldedPolicy(inner.policy, inner.observation, inner.action)
    size = inner.size if inner.observation == "full" else None
    return replace(
        inner, policy=policy, name=SHIELD + inner.name, observation="full", task=CAVE, size=size, takes=None, parts=None
    )
