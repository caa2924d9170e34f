"""Policies by name: a Stable-Baselines3 zip, an ONNX file of ML-Agents, or one of the baselines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import ACTIONS, ActionModel
from aquanav_tools.envs.observation import PRESETS, layout
from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.evaluate.ml_agents import SUFFIX, MlAgentsPolicy
from aquanav_tools.evaluate.network import NetworkPolicy
from aquanav_tools.evaluate.reactive import ReactivePolicy
from aquanav_tools.evaluate.spaces import describe_space, is_same_space
from aquanav_tools.provenance import file_hash

PREFIX = "baseline:"
NUM_CHOICES = 3


class Policy(Protocol):
    """Chooses actions from observations."""

    def reset(self, seed: int) -> None:
        """Forget the last episode; draw random numbers, if any, from `seed`."""

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return the action for one observation."""


@dataclass(frozen=True)
class LoadedPolicy:
    """A policy and what it needs of the environment."""

    policy: Policy
    name: str
    """Name of the file, or of the baseline."""
    sha256: str | None
    """Of the file; None for a baseline."""
    observation: str
    """Preset it observes."""
    action: str
    """Form in which it acts."""


class RandomPolicy:
    """Draws each of the three choices evenly: the floor that any policy must beat."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def reset(self, seed: int) -> None:
        """Begin the sequence that belongs to `seed`."""
        self._rng = np.random.default_rng(seed)

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return three choices from 0 to 2, whatever is observed."""
        return self._rng.integers(NUM_CHOICES, size=3)


BASELINES: dict[str, type[ReactivePolicy] | type[RandomPolicy]] = {"reactive": ReactivePolicy, "random": RandomPolicy}


def load_policy(spec: str) -> LoadedPolicy:
    """Return the policy named by `spec`: a path of an SB3 zip or an ONNX file, or a baseline.

    Raises:
        InputError: no such baseline (with the closest name), or the file is missing, damaged, unsafe or for another
            task.
    """
    if spec.startswith(PREFIX):
        name = spec.removeprefix(PREFIX)
        if name not in BASELINES:
            raise InputError(f"There is no baseline '{name}'.{did_you_mean(name, BASELINES)}")
        return LoadedPolicy(BASELINES[name](), spec, None, "full", "multidiscrete")
    path = Path(spec)
    policy = MlAgentsPolicy(path) if path.suffix.lower() == SUFFIX else NetworkPolicy(path)
    observation, action = _fitting_presets(policy, path)
    return LoadedPolicy(policy, path.name, file_hash(path), observation, action)


def _fitting_presets(policy: NetworkPolicy | MlAgentsPolicy, path: Path) -> tuple[str, str]:
    """Return the observation preset and the action form whose spaces the network was trained for."""
    sizes = {preset: max(part.stop for part in layout(preset).values()) for preset in PRESETS}
    forms = {form: ActionModel(form).space for form in ACTIONS}
    observations = [preset for preset, size in sizes.items() if policy.observation_space.shape == (size,)]
    actions = [form for form, space in forms.items() if is_same_space(policy.action_space, space)]
    if not observations or not actions:
        raise InputError(
            f"The policy in {path} observes a {describe_space(policy.observation_space)} and acts in "
            f"{describe_space(policy.action_space)}. The task offers the observations "
            f"{', '.join(f'{preset} ({size} values)' for preset, size in sizes.items())} and the actions "
            f"{', '.join(f'{form} ({describe_space(space)})' for form, space in forms.items())}. "
            "It was trained for another task; train one with aquanav-train."
        )
    return observations[0], actions[0]
