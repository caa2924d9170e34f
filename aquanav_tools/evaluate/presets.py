"""Which observation preset and which form of action a policy was made for."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces

from aquanav_tools.envs.action import ACTIONS, ActionModel
from aquanav_tools.envs.observation import PRESETS, layout
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.spaces import describe_space, is_same_space

OBSERVATION_SIZES = {name: max(part.stop for part in layout(name).values()) for name in ("full", "paper", "original")}
"""Number of values in each of PRESETS."""


def fitting_presets(observation: spaces.Space[Any], action: spaces.Space[Any], name: str) -> tuple[str, str]:
    """Return the observation preset and the action form that have a policy's spaces.

    Raises:
        InputError: one of both has none; the message shows what was found, what fits and what the task offers.
    """
    forms = {form: ActionModel(form).space for form in ACTIONS}
    presets = [preset for preset in PRESETS if observation.shape == (OBSERVATION_SIZES[preset],)]
    actions = [form for form, space in forms.items() if is_same_space(action, space)]
    if presets and actions:
        return presets[0], actions[0]
    offered_sizes = ", ".join(f"{preset} ({size} values)" for preset, size in OBSERVATION_SIZES.items())
    offered_forms = ", ".join(f"{form} ({describe_space(space)})" for form, space in forms.items())
    raise InputError(
        f"The policy {name} observes a {describe_space(observation)}{_fit(presets, 'preset')} and acts in "
        f"{describe_space(action)}{_fit(actions, 'form')}. The task offers the observations {offered_sizes} and the "
        f"actions {offered_forms}. It was trained for another task: train it again in "
        f"aquanav_tools.envs.CaveEnv(scenario, observation='{(presets or ['full'])[0]}', "
        f"action='{(actions or ['multidiscrete'])[0]}'), or with aquanav-train."
    )


def _fit(names: list[str], what: str) -> str:
    return f" (the {what} {names[0]})" if names else f" (no {what} has that)"
