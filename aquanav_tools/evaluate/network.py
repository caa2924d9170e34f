"""Policies that Stable-Baselines3 trained, rebuilt from their weights and readable settings alone."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.evaluate.archive import read_archive, read_weights
from aquanav_tools.evaluate.spaces import parse_space

ACTIVATIONS = ("SiLU", "Tanh", "ReLU", "ELU", "GELU", "LeakyReLU")
"""Activations without parameters of their own that a policy may name."""
CLASSES = {
    "ActorCriticPolicy": "stable_baselines3.common.policies",
    "RecurrentActorCriticPolicy": "sb3_contrib.common.recurrent.policies",
    "SACPolicy": "stable_baselines3.sac.policies",
    "TD3Policy": "stable_baselines3.td3.policies",
}
"""Classes that may be rebuilt, and the modules that have them."""
NORMALISED = "<class 'aquanav_tools.policy.normaliser.NormalisedObservations'>"
"""The one features extractor that may be rebuilt, as a zip names it: aquanav-train's."""
TRAINING_ONLY = {"optimizer_class", "optimizer_kwargs", "ortho_init", "log_std_init", "use_sde"}
"""Settings that do not change what trained weights compute."""
MAX_LAYERS, MAX_WIDTH = 16, 8192


class NetworkPolicy:
    """A trained network; acts deterministically, with the most likely or mean action."""

    def __init__(self, path: Path) -> None:
        """Read an SB3 zip.

        Raises:
            InputError: it is damaged, unsafe, or not an actor-critic policy on flat observations.
        """
        settings, weights = read_archive(path)
        kind = _policy_class(settings, path)
        self.observation_space = parse_space(settings.get("observation_space"), "observation space")
        self.action_space = parse_space(settings.get("action_space"), "action space")
        if not isinstance(self.observation_space, spaces.Box):
            raise InputError(f"The policy in {path} observes {self.observation_space}; a flat Box is needed.")
        self._network = _build_network(kind, settings, (self.observation_space, self.action_space), path)
        _load_weights(self._network, read_weights(weights, path), path)
        self._memory: Any = None

    def reset(self, seed: int) -> None:
        """Forget the last episode, where the network has a memory; it draws no random numbers."""
        self._memory = None

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return the action for one observation."""
        action, self._memory = self._network.predict(observation, self._memory, deterministic=True)
        return action


def _policy_class(settings: dict[str, Any], path: Path) -> Any:
    entry = settings.get("policy_class")
    initialiser = str(entry.get("__init__")) if isinstance(entry, dict) else ""
    found = re.search(r"<function (\w+)\.__init__", initialiser)
    name = found.group(1) if found else "nothing readable"
    if name not in CLASSES:
        raise InputError(
            f"The policy in {path} is of class {name}; {', '.join(CLASSES)} are supported: MlpPolicy of PPO, A2C, SAC "
            "and TD3, and MlpLstmPolicy of RecurrentPPO. Train one with aquanav-train."
        )
    if settings.get("use_sde"):
        raise InputError(f"The policy in {path} uses state dependent exploration (use_sde). Train one without it.")
    try:
        return getattr(importlib.import_module(CLASSES[name]), name)
    except ImportError as cause:
        raise InputError(
            f"The policy in {path} needs sb3-contrib, which is not installed. Install it: pip install "
            "'aquanav[recurrent]'"
        ) from cause


def _build_network(kind: Any, settings: dict[str, Any], both: tuple[spaces.Box, spaces.Space[Any]], path: Path) -> Any:
    import torch

    torch.set_num_threads(1)  # measured: a second thread on a busy machine makes small networks 4-20 times slower
    options = _network_options(settings.get("policy_kwargs"), path)
    try:
        network = kind(*both, lr_schedule=lambda _: 0.0, **options)
    except (AssertionError, RuntimeError, TypeError, ValueError) as cause:
        raise InputError(f"The network in {path} cannot be built from {options}: {cause}.") from cause
    network.set_training_mode(False)
    return network


def _network_options(entry: Any, path: Path) -> dict[str, Any]:
    """Return the keywords of the policy's class, taken from the readable fields of `policy_kwargs`."""
    if not isinstance(entry, dict):
        raise InputError(f"The settings in {path} have no readable policy_kwargs. Save the policy with SB3 2.x.")
    given = {key: value for key, value in entry.items() if not key.startswith(":") and key not in TRAINING_ONLY}
    normaliser = given.pop("features_extractor_class", None)
    unknown = sorted(set(given) - {"net_arch", "activation_fn", "lstm_hidden_size"})
    unknown += [] if normaliser in (None, NORMALISED) else [f"features_extractor_class {normaliser}"]
    if unknown:
        raise InputError(
            f"The policy in {path} was made with {', '.join(unknown)}, which cannot be rebuilt without running "
            "code from the file. Only net_arch and activation_fn are supported."
        )
    options: dict[str, Any] = {}
    if normaliser is not None:
        from aquanav_tools.policy.normaliser import NormalisedObservations

        options["features_extractor_class"] = NormalisedObservations
    if "lstm_hidden_size" in given:
        options["lstm_hidden_size"] = _checked_layers([given["lstm_hidden_size"]], path)[0]
    if "net_arch" in given:
        options["net_arch"] = _checked_layers(given["net_arch"], path)
    if "activation_fn" in given:
        options["activation_fn"] = _activation(str(given["activation_fn"]), path)
    return options


def _checked_layers(net_arch: Any, path: Path) -> Any:
    if isinstance(net_arch, dict) and set(net_arch) == {"pi", "vf"}:
        return {part: _checked_layers(layers, path) for part, layers in net_arch.items()}
    is_valid = isinstance(net_arch, list) and len(net_arch) <= MAX_LAYERS
    if not is_valid or not all(type(width) is int and 1 <= width <= MAX_WIDTH for width in net_arch):
        raise InputError(
            f"The policy in {path} has the layers {net_arch!r}; at most {MAX_LAYERS} widths in [1, {MAX_WIDTH}] are "
            "supported, alone or as {'pi': [...], 'vf': [...]}."
        )
    return net_arch


def _activation(text: str, path: Path) -> Any:
    import torch

    name = text.removesuffix("'>").rsplit(".", 1)[-1]
    if name not in ACTIVATIONS:
        raise InputError(f"The policy in {path} uses the activation {name}.{did_you_mean(name, ACTIVATIONS)}")
    return getattr(torch.nn, name)


def _load_weights(network: Any, tensors: dict[str, Any], path: Path) -> None:
    try:
        network.load_state_dict(tensors, strict=True)
    except RuntimeError as cause:
        reason = " ".join(str(cause).split())[:300]
        raise InputError(
            f"The weights in {path} do not fit its own settings: {reason}. Save the policy again."
        ) from cause
