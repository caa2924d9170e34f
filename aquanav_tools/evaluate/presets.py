"""Which task, observation preset and form of action a policy was made for."""

from __future__ import annotations

from typing import Any, NamedTuple

from gymnasium import spaces

from aquanav_tools.envs.action import ACTIONS, ActionModel
from aquanav_tools.envs.observation import layout
from aquanav_tools.envs.surface_observation import surface_layout
from aquanav_tools.errors import InputError
from aquanav_tools.policy.spaces import describe_space, is_same_space
from aquanav_tools.sim.command import AFLOAT, DIVING

CAVE, SURFACE = "cave", "surface"
"""The tasks."""
OBSERVATION_SIZES = {
    task: {name: max(part.stop for part in slices(name).values()) for name in ("full", "paper", "original")}
    for task, slices in {CAVE: layout, SURFACE: surface_layout}.items()
}
"""Number of values in each preset."""
PARTS = {CAVE: DIVING, SURFACE: AFLOAT}
"""What actions tell the vehicle."""


class Fit(NamedTuple):
    """What a policy was made for."""

    task: str
    observation: str
    action: str


def fitting_presets(
    observation: spaces.Space[Any], action: spaces.Space[Any], name: str, observed: str | None = None
) -> Fit:
    """Return the task, the observation preset and the action form that have a policy's spaces.

    `observed` names the observation where that is known, so that its space need be none of a preset.

    Raises:
        InputError: no task has both; the message shows what was found, what fits and what the tasks offer.
    """
    found: dict[str, tuple[list[str], list[str]]] = {}
    for task, sizes in OBSERVATION_SIZES.items():
        presets = [preset for preset, size in sizes.items() if observation.shape == (size,)]
        forms = [form for form, space in _forms(task).items() if is_same_space(action, space)]
        if observed is not None:
            presets = [observed]
        if presets and forms:
            return Fit(task, presets[0], forms[0])
        found[task] = presets, forms
    task = max(found, key=lambda task: len(found[task][0]) + len(found[task][1]))
    presets, forms = found[task]
    env = "CaveEnv(scenario" if task == CAVE else "SurfaceEnv("
    offers = "; ".join(f"in the {task} task {_offer(task)}" for task in OBSERVATION_SIZES)
    raise InputError(
        f"The policy {name} observes a {describe_space(observation)}{_fit(presets, 'preset')} and acts in "
        f"{describe_space(action)}{_fit(forms, 'form')}. There are, {offers}. It was trained for another task: train "
        f"it again in aquanav_tools.envs.{env}, observation='{(presets or ['full'])[0]}', "
        f"action='{(forms or ['multidiscrete'])[0]}'), or with aquanav-train. If it observes by code of your own, name "
        "that: --observation or --sensors with module:Name."
    )


def fitting_form(action: spaces.Space[Any], name: str, observed: str) -> str:
    """Return the form of a cave's actions that has the space of a policy that observes a dictionary.

    Raises:
        InputError: none has; the message shows what was found and what there is.
    """
    forms = _forms(CAVE)
    found = [form for form, space in forms.items() if is_same_space(action, space)]
    if not found:
        offers = ", ".join(f"{form} ({describe_space(space)})" for form, space in forms.items())
        raise InputError(
            f"The policy {name} observes a {observed} and acts in {describe_space(action)}. The cave task has the "
            f"actions {offers}. It was trained for another task: train it again in aquanav_tools.envs.CaveEnv."
        )
    return found[0]


def _forms(task: str) -> dict[str, spaces.Space[Any]]:
    return {form: ActionModel(form, PARTS[task]).space for form in ACTIONS}


def _offer(task: str) -> str:
    sizes = ", ".join(f"{preset} ({size} values)" for preset, size in OBSERVATION_SIZES[task].items())
    forms = ", ".join(f"{form} ({describe_space(space)})" for form, space in _forms(task).items())
    return f"the observations {sizes} and the actions {forms}"


def _fit(names: list[str], what: str) -> str:
    return f" (the {what} {names[0]})" if names else f" (no {what} has that)"
