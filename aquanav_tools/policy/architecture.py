"""What a Stable-Baselines3 zip tells of its network, read from its JSON alone.

A zip that `model.save` wrote holds weights, and settings as JSON beside base64 pickles. Pickles run code when they are
loaded, so they are never touched: the JSON names the class, the layers, the activation and the spaces, and that is all
the networks of MlpPolicy and MlpLstmPolicy are made of. What it does not tell is refused, not guessed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError, did_you_mean

ACTIVATIONS = (
    "CELU", "ELU", "GELU", "Hardswish", "Hardtanh", "Identity", "LeakyReLU", "Mish", "ReLU", "ReLU6", "SELU", "SiLU",
    "Sigmoid", "Softplus", "Softsign", "Tanh",
)  # fmt: skip
"""PyTorch's activations without trained parameters; swish is SiLU there."""
ACTIVATION = re.compile(r"<class 'torch\.nn\.modules\.(?:activation|linear)\.(\w+)'>")
TRAINING_ONLY = {
    "optimizer_class", "optimizer_kwargs", "ortho_init", "log_std_init", "full_std", "use_expln", "clip_mean",
    "n_critics", "share_features_extractor", "normalize_images", "shared_lstm", "enable_critic_lstm",
}  # fmt: skip
"""Settings that do not change what trained weights make of a vector of observations."""
MAX_LAYERS, MAX_WIDTH = 16, 8192
COMBINED = "<class 'stable_baselines3.common.torch_layers.CombinedExtractor'>"
"""What lays the parts of a dictionary side by side."""
NORMALISED = "<class 'aquanav_tools.policy.normaliser.NormalisedObservations'>"
"""The one features extractor that may be rebuilt, as a zip names it: aquanav-train's."""


class ExoticPolicyError(InputError):
    """A policy that cannot be rebuilt without running code from its file."""


@dataclass(frozen=True)
class Kind:
    """How one of Stable-Baselines3's policy classes names the weights that choose an action, and its defaults."""

    features: str
    """Where the normaliser of observations is, if there is one."""
    hidden: str
    """Where the hidden layers are; the last layer too where `output` is empty."""
    output: str
    others: tuple[str, ...]
    """Weights that only training needs: critics, targets, the spread of actions."""
    layers: tuple[int, ...]
    activation: str
    is_squashed: bool = False
    """Whether tanh bounds the actions."""
    is_recurrent: bool = False
    has_parts: bool = False
    """Whether it observes a dictionary, whose parts are flattened side by side."""


_CRITICS = ("critic.", "critic_target.")
_VALUES = ("mlp_extractor.value_net.", "value_net.", "log_std", "pi_features_extractor.", "vf_features_extractor.")
KINDS = {
    "stable_baselines3.common.policies.ActorCriticPolicy": Kind(
        "features_extractor", "mlp_extractor.policy_net", "action_net", _VALUES, (64, 64), "Tanh"
    ),
    "sb3_contrib.common.recurrent.policies.RecurrentActorCriticPolicy": Kind(
        "features_extractor", "mlp_extractor.policy_net", "action_net", (*_VALUES, "lstm_critic.", "critic."), (64, 64),
        "Tanh", is_recurrent=True,
    ),
    "stable_baselines3.dqn.policies.DQNPolicy": Kind(
        "q_net.features_extractor", "q_net.q_net", "", ("q_net_target.",), (64, 64), "ReLU"
    ),
    "stable_baselines3.sac.policies.SACPolicy": Kind(
        "actor.features_extractor", "actor.latent_pi", "actor.mu", ("actor.log_std.", *_CRITICS), (256, 256), "ReLU",
        is_squashed=True,
    ),
    "stable_baselines3.td3.policies.TD3Policy": Kind(
        "actor.features_extractor", "actor.mu", "", ("actor_target.", *_CRITICS), (400, 300), "ReLU", is_squashed=True
    ),
}  # fmt: skip
"""By module and name of the class, with the defaults of version 2.x."""
KINDS |= {
    multi: replace(KINDS[flat], has_parts=True)
    for multi, flat in {
        "stable_baselines3.common.policies.MultiInputActorCriticPolicy":
            "stable_baselines3.common.policies.ActorCriticPolicy",
        "sb3_contrib.common.recurrent.policies.RecurrentMultiInputActorCriticPolicy":
            "sb3_contrib.common.recurrent.policies.RecurrentActorCriticPolicy",
        "stable_baselines3.dqn.policies.MultiInputPolicy": "stable_baselines3.dqn.policies.DQNPolicy",
        "stable_baselines3.sac.policies.MultiInputPolicy": "stable_baselines3.sac.policies.SACPolicy",
        "stable_baselines3.td3.policies.MultiInputPolicy": "stable_baselines3.td3.policies.TD3Policy",
    }.items()
}  # fmt: skip
"""Those that observe a dictionary name their weights alike."""


def read_kind(settings: dict[str, Any], path: Path) -> Kind:
    """Return what the settings of the zip at `path` say about the policy's class.

    Raises:
        ExoticPolicyError: the class is unknown.
    """
    entry = settings.get("policy_class")
    entry = entry if isinstance(entry, dict) else {}
    found = re.search(r"<function (\w+)\.__init__", str(entry.get("__init__")))
    name = f"{entry.get('__module__')}.{found.group(1)}" if found else "nothing readable"
    if name not in KINDS:
        raise ExoticPolicyError(
            f"The policy in {path} is of class {name[:200]}. Known are MlpPolicy and MultiInputPolicy of PPO, "
            "A2C, DQN, SAC and TD3, and MlpLstmPolicy and MultiInputLstmPolicy of RecurrentPPO."
        )
    if settings.get("use_sde"):
        raise ExoticPolicyError(f"The policy in {path} uses state dependent exploration (use_sde).")
    return KINDS[name]


def read_options(entry: Any, kind: Kind, path: Path) -> dict[str, Any]:
    """Return what the network is made of, from the readable fields of `policy_kwargs` and the class's defaults.

    Args:
        entry: The member `policy_kwargs` of the zip's settings.
        kind: Of the policy.
        path: Of the zip, for messages.

    Returns:
        net_arch (widths of the actor's hidden layers), activation_fn (name in torch.nn), is_normalised, and of a
        recurrent policy lstm_hidden_size and n_lstm_layers.

    Raises:
        ExoticPolicyError: it was made with what cannot be rebuilt without running code from the zip.
        InputError: a value makes no sense.
    """
    if not isinstance(entry, dict):
        raise InputError(f"The settings in {path} have no readable policy_kwargs. Save the policy with SB3 2.x.")
    given = {key: value for key, value in entry.items() if not key.startswith(":") and key not in TRAINING_ONLY}
    for name in ("use_sde", "squash_output", "lstm_kwargs"):  # as good as not given
        if name in given and not given[name]:
            del given[name]
    normaliser = given.pop("features_extractor_class", None)
    if kind.has_parts and normaliser in (None, COMBINED):
        given.pop("features_extractor_kwargs", None)  # of images alone, which are refused by their weights
        normaliser = None
    plain = f"<class 'torch.nn.modules.activation.{kind.activation}'>"
    options: dict[str, Any] = {"net_arch": list(kind.layers), "activation_fn": plain}
    memory = {"lstm_hidden_size": 256, "n_lstm_layers": 1} if kind.is_recurrent else {}
    unknown = sorted(set(given) - set(options) - set(memory))
    unknown += [] if normaliser in (None, NORMALISED) else [f"features_extractor_class {str(normaliser)[:200]}"]
    if unknown:
        raise ExoticPolicyError(
            f"The policy in {path} was made with {', '.join(unknown)}, which cannot be rebuilt without running code "
            f"from the file. Only {', '.join([*options, *memory])} are understood."
        )
    options |= memory | {name: value for name, value in given.items() if value is not None}
    for name, most in (("lstm_hidden_size", MAX_WIDTH), ("n_lstm_layers", MAX_LAYERS)):
        if name in memory and not (type(options[name]) is int and 1 <= options[name] <= most):
            raise InputError(f"The policy in {path} has {name} {options[name]!r}; 1 to {most} are supported.")
    options["is_normalised"] = normaliser is not None
    options["net_arch"] = _actors_layers(options["net_arch"], path)
    options["activation_fn"] = _activation(str(options["activation_fn"]), path)
    return options


def _actors_layers(net_arch: Any, path: Path) -> list[int]:
    """Return the widths of the hidden layers that lead to actions."""
    layers = net_arch
    if isinstance(layers, list) and len(layers) == 1 and isinstance(layers[0], dict):
        layers = layers[0]  # as versions before 1.8 wrote it
    if isinstance(layers, dict) and set(layers) <= {"pi", "vf", "qf", ":type:"}:
        layers = layers.get("pi", [])
    is_valid = isinstance(layers, list) and len(layers) <= MAX_LAYERS
    if not is_valid or not all(type(width) is int and 1 <= width <= MAX_WIDTH for width in layers):
        raise InputError(
            f"The policy in {path} has the layers {str(net_arch)[:200]}; at most {MAX_LAYERS} widths in "
            f"[1, {MAX_WIDTH}] are supported, alone or as 'pi' beside 'vf' or 'qf'."
        )
    return list(layers)


def _activation(text: str, path: Path) -> str:
    found = ACTIVATION.fullmatch(text)
    if found is None or found.group(1) not in ACTIVATIONS:
        hint = did_you_mean(text.removesuffix("'>").rsplit(".", 1)[-1], ACTIVATIONS)
        raise ExoticPolicyError(
            f"The policy in {path} uses the activation {text[:200]}, which is none of PyTorch's without trained "
            f"parameters.{hint}"
        )
    return found.group(1)
