"""Beginning a run with the weights of a policy that was trained before, read without running code from its file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm

from aquanav_tools.envs.observation import observation_space
from aquanav_tools.errors import InputError
from aquanav_tools.policy.architecture import KINDS, read_kind, read_options
from aquanav_tools.policy.archive import TRAINED, read_archive, read_weights
from aquanav_tools.policy.normaliser import HIDDEN
from aquanav_tools.policy.observed import Observed, read_observed
from aquanav_tools.policy.run_folder import best_policy
from aquanav_tools.policy.spaces import describe_space, is_same_space, parse_space
from aquanav_tools.provenance import file_hash
from aquanav_tools.shipped import shipped_path
from aquanav_tools.sim.scales import PRESETS
from aquanav_tools.train.learners import make_policy, maskable_indices
from aquanav_tools.train.settings import TrainSettings

BASELINE = "baseline:"
CLASSES = {
    "ppo": "stable_baselines3.common.policies.ActorCriticPolicy",
    "recurrent-ppo": "sb3_contrib.common.recurrent.policies.RecurrentActorCriticPolicy",
    "sac": "stable_baselines3.sac.policies.SACPolicy",
    "td3": "stable_baselines3.td3.policies.TD3Policy",
}
"""Of the policies that the algorithms learn."""
NORMALISER_MEAN, NORMALISER_VARIANCE, NORMALISER_COUNT = (
    f"features_extractor.{name}" for name in ("mean", "variance", "count")
)
GOAL, WAYPOINT = ("distance", "azimuth", "elevation"), "waypoint"
"""What of the goal the waypoint begins with: the first three of its values."""
FIRST_LAYERS = ("policy_net.0.weight", "value_net.0.weight")


@dataclass(frozen=True)
class InitialPolicy:
    """A policy's file and what it holds."""

    path: Path
    sha256: str
    settings: dict[str, Any]
    weights: dict[str, torch.Tensor]
    """By the names of SB3's policy; float32, but for the normaliser's count."""


def read_initial(name: str) -> InitialPolicy:
    """Return the policy in an SB3 zip, in a run's folder, or of a shipped baseline.

    Raises:
        InputError: there is none, or it is damaged or unsafe.
    """
    path = _path_of(name)
    if not path.is_file():
        raise InputError(
            f"There is no policy at {path} to begin with. Give --init a policy.zip or best.zip of another run, its "
            "folder, or baseline:reference."
        )
    settings, weights = read_archive(path)
    return InitialPolicy(path, file_hash(path), settings, read_weights(weights, path))


def fitted_initial(
    initial: InitialPolicy, observation: spaces.Space[Any], action: spaces.Space[Any], settings: TrainSettings
) -> InitialPolicy:
    """Return a policy as a run can begin with it: one that has fewer of the run's sensors gets weights for the others.

    These are 0, so that it acts as before until it has learned; but where the goal is masked and a waypoint shown in
    its place, the waypoint gets the goal's weights. Means and spreads of observations begin anew with what the run sees
    first, as nothing is known of the new ones.

    Raises:
        InputError: its spaces, its network or what it sees is another; the message has both.
    """
    policy = make_policy(observation, action, settings)
    is_wider = _has_fewer_sensors(initial, settings)
    if not is_wider:
        _check_space(initial, "observation", observation, settings.observation)
    _check_space(initial, "action", action, settings.action)
    _check_network(initial, settings)
    if is_wider:
        initial = _widened(initial, policy.state_dict())
        _hand_over(initial.weights, settings, observation)
    _check_weights(initial, policy.state_dict())
    _check_sight(initial, settings)
    return initial


def begin_with(learner: BaseAlgorithm, initial: InitialPolicy) -> None:
    """Give a new learner the weights and the means and spreads of observations; its optimiser begins anew."""
    learner.policy.load_state_dict(initial.weights)


def _has_fewer_sensors(initial: InitialPolicy, settings: TrainSettings) -> bool:
    """Return whether a policy of PPO observes the run's preset and the first of its sensors alone."""
    if settings.algorithm != "ppo" or not settings.normalise or settings.observation not in PRESETS:
        return False
    seen = read_observed(initial.settings, initial.path)
    if seen is None:  # older files do not say; then as many values as a preset has are that preset
        found = parse_space(initial.settings.get("observation_space"), "observation space")
        if not is_same_space(found, observation_space(settings.observation)):
            return False
        seen = Observed(settings.observation)
    num = len(seen.sensors)
    is_prefix = seen.observation == settings.observation and seen.sensors == settings.sensors[:num]
    return is_prefix and num < len(settings.sensors) and not (seen.history or settings.history)


def _widened(initial: InitialPolicy, wanted: dict[str, torch.Tensor]) -> InitialPolicy:
    """Return a policy whose first layers and normalisers take as many values as `wanted`."""
    weights = dict(initial.weights)
    for name, tensor in wanted.items():
        found = weights.get(name)
        if found is None or found.dim() != tensor.dim() or tensor.dim() == 0:
            continue
        missing = tensor.shape[-1] - found.shape[-1]
        if missing > 0 and name.endswith((*FIRST_LAYERS, NORMALISER_MEAN)):
            weights[name] = torch.nn.functional.pad(found, (0, missing))
        elif missing > 0 and name.endswith(NORMALISER_VARIANCE):
            weights[name] = torch.nn.functional.pad(found, (0, missing), value=1.0)
    for name in [name for name in weights if name.endswith(NORMALISER_COUNT)]:
        weights[name] = torch.zeros_like(weights[name])
    return replace(initial, weights=weights)


def _hand_over(weights: dict[str, torch.Tensor], settings: TrainSettings, observation: spaces.Space[Any]) -> None:
    """Give the waypoint, where it is new and the goal is masked, the goal's weights, in place."""
    if not (set(GOAL) <= set(settings.masked_observations) and settings.sensors[-1:] == (WAYPOINT,)):
        return
    from aquanav_tools.sim.batch.sensors.waypoint import SIZE

    hidden, places = _hidden(weights, settings), maskable_indices(settings.observation)
    first = spaces.flatdim(observation) - SIZE
    for name in [name for name in weights if name.endswith(FIRST_LAYERS)]:
        for column, value in enumerate(GOAL):
            if value not in hidden:  # what was never seen has the weights that it began with
                weights[name][:, first + column] = weights[name][:, places[value]]


def _hidden(weights: dict[str, torch.Tensor], settings: TrainSettings) -> list[str]:
    """Return the names of what a policy was kept from seeing."""
    variances = [value for name, value in weights.items() if name.endswith(NORMALISER_VARIANCE)]
    places = maskable_indices(settings.observation) if variances else {}
    return [name for name, place in places.items() if place < len(variances[0]) and variances[0][place] >= HIDDEN]


def _path_of(name: str) -> Path:
    if name.startswith(BASELINE):
        folder, suffix = TRAINED
        return shipped_path(folder, name.removeprefix(BASELINE), suffix)
    path = Path(name)
    return best_policy(path) if path.is_dir() else path


def _check_space(initial: InitialPolicy, name: str, wanted: spaces.Space[Any], choice: str) -> None:
    found = parse_space(initial.settings.get(f"{name}_space"), f"{name} space")
    if not is_same_space(found, wanted):
        raise InputError(
            f"The policy {initial.path} has the {name} space {describe_space(found)}, and this run "
            f"{describe_space(wanted)} ({name} {choice}). Choose --{name} as it was trained, or another policy."
        )


def _check_network(initial: InitialPolicy, settings: TrainSettings) -> None:
    kind = read_kind(initial.settings, initial.path)
    if kind is not KINDS[CLASSES[settings.algorithm]]:
        (name,) = (name for name, known in KINDS.items() if known is kind)
        raise InputError(
            f"The policy {initial.path} is a {name.rsplit('.', 1)[-1]}, and {settings.algorithm} learns a "
            f"{CLASSES[settings.algorithm].rsplit('.', 1)[-1]}. Choose the --algorithm that trained it."
        )
    found = read_options(initial.settings.get("policy_kwargs"), kind, initial.path)
    wanted = {
        "net_arch": (list(settings.hidden), "--hidden"),
        "activation_fn": ("SiLU", "a policy of aquanav-train"),
        "is_normalised": (settings.normalise, "--normalise or --no-normalise"),
    }
    if kind.is_recurrent:
        wanted |= {"lstm_hidden_size": (settings.memory, "--memory"), "n_lstm_layers": (1, "a policy of aquanav-train")}
    for name, (value, choice) in wanted.items():
        if found[name] != value:
            raise InputError(
                f"The policy {initial.path} was made with {name} {found[name]}, and this run makes {value}. Choose "
                f"{choice} to match, or another policy."
            )


def _check_weights(initial: InitialPolicy, wanted: dict[str, torch.Tensor]) -> None:
    found = initial.weights
    for name in sorted({*found, *wanted}):
        texts = [_described(tensors.get(name)) for tensors in (found, wanted)]
        if texts[0] != texts[1]:
            raise InputError(
                f"The policy {initial.path} has {texts[0]} as {name}, and this run's network {texts[1]}. It was made "
                "otherwise than its settings tell, or by another version. Choose another policy."
            )


def _check_sight(initial: InitialPolicy, settings: TrainSettings) -> None:
    """Refuse a policy that was kept from seeing what this run shows: its statistics would hide that for good."""
    hidden = _hidden(initial.weights, settings)
    if not set(hidden) <= set(settings.masked_observations):
        raise InputError(
            f"The policy {initial.path} was kept from seeing {' and '.join(hidden)}, and this run shows it. Add "
            f"--masked-observations {' '.join(hidden)}."
        )


def _described(tensor: torch.Tensor | None) -> str:
    if tensor is None:
        return "nothing"
    return f"{' x '.join(map(str, tensor.shape)) or 'one'} {str(tensor.dtype).removeprefix('torch.')}"
