"""The word before a policy's name that puts a safety shield around it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.presets import CAVE
from aquanav_tools.evaluate.shield import ShieldedPolicy

if TYPE_CHECKING:
    from aquanav_tools.evaluate.policies import LoadedPolicy

SHIELD = "shield:"


def inner_of(spec: str) -> str:
    """Return the policy's name alone, without all that stands before it."""
    while spec.startswith(SHIELD):
        spec = spec.removeprefix(SHIELD)
    return spec


def shielded(inner: LoadedPolicy) -> LoadedPolicy:
    """Return a policy inside a shield.

    Raises:
        InputError: it does not go into one.
    """
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
