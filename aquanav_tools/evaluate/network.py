"""Policies of Stable-Baselines3, rebuilt from their weights and readable settings (policy/architecture.py)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.padding import BLOCK, pad_columns, pad_layers, pad_lstm
from aquanav_tools.libraries import require
from aquanav_tools.policy.architecture import ExoticPolicyError, Kind, read_kind, read_options
from aquanav_tools.policy.archive import read_archive, read_weights
from aquanav_tools.policy.observed import read_observed
from aquanav_tools.policy.spaces import parse_space
from aquanav_tools.types import IntArray

LSTM = "lstm_actor"
OTHERWISE = ", or fly it as ONNX: aquanav-train writes policy.onnx beside it"
TRUST = (
    "If you trust whoever made the file, add --trust: then Stable-Baselines3 itself loads it, which runs any code that "
    "the file holds."
)


class NetworkPolicy:
    """A trained network; acts deterministically, with the most likely or mean action."""

    def __init__(self, path: Path) -> None:
        """Read an SB3 zip.

        Raises:
            LibraryError: torch or Stable-Baselines3 is not installed.
            ExoticPolicyError: it was made with what its readable settings do not tell in full.
            InputError: it is damaged or unsafe, or does not act on flat observations.
        """
        require(f"The policy {path}, a zip of Stable-Baselines3,", "torch", "stable_baselines3", otherwise=OTHERWISE)
        import torch

        torch.set_num_threads(1)  # measured: a second thread on a busy machine makes small networks 4-20 times slower
        settings, weights = read_archive(path)
        try:
            self._kind = read_kind(settings, path)
            options = read_options(settings.get("policy_kwargs"), self._kind, path)
        except ExoticPolicyError as cause:
            raise ExoticPolicyError(f"{cause} {TRUST}") from cause
        self.observation_space = parse_space(settings.get("observation_space"), "observation space")
        self.action_space = parse_space(settings.get("action_space"), "action space")
        self.observed = read_observed(settings, path)
        """What the file says that it observes; None where it says nothing."""
        if not isinstance(self.observation_space, spaces.Dict if self._kind.has_parts else spaces.Box):
            wanted = "dictionary of parts" if self._kind.has_parts else "flat Box"
            raise InputError(f"The policy in {path} observes {self.observation_space}; a {wanted} is needed.")
        with torch.device("meta"):  # takes no memory, whatever widths a file claims to have
            parts = _build(self._kind, options, settings, self.observation_space, self.action_space, path)
        tensors = read_weights(weights, path)
        _refuse_images(tensors, self._kind, path)
        _load_weights(parts, self._kind, tensors, path)
        self.normaliser = parts.pop(self._kind.features, None)
        """What scales observations first, where the policy learned with that."""
        lstm = parts.pop(LSTM, None)
        self._lstm: Any = None if lstm is None else pad_lstm(lstm)
        self._num_outputs = _num_outputs(self._kind, settings, self.action_space, path)
        self._layers = pad_layers(torch.nn.Sequential(*(layer for part in parts.values() for layer in _flat(part))))
        self._memory: Any = None
        """(2, layers, slots, width) hidden and cell state of the vehicle at each place; None before any."""

    def reset(self, seed: int) -> None:
        """Forget what was seen; nothing is drawn at random."""
        self._memory = None

    def act(self, observation: Any) -> Any:
        """Return the action for one observation, (O,) or a dictionary of arrays."""
        alone = {name: np.asarray(part)[None] for name, part in observation.items()} if self._kind.has_parts else None
        rows = np.asarray(observation)[None] if alone is None else self._side_by_side(alone)
        return self.decide(self._outputs(rows, np.zeros(1, dtype=np.int64))[0])

    def logits(self, observations: Any, slots: IntArray | None = None) -> npt.NDArray[np.float32]:
        """Return what the last layer makes of (N, O) observations, (N, K): of each the same as alone, to the bit.

        Of a policy that observes a dictionary they are one of (N, ...) arrays. A recurrent network remembers each
        vehicle by its slot, one of `slots` for each row; without them the rows' order tells.
        """
        observations = self._side_by_side(observations) if self._kind.has_parts else observations
        slots = np.arange(len(observations)) if slots is None else slots
        before, outputs = self._memory, []
        try:
            for first in range(0, len(observations), BLOCK):
                rows, where = observations[first : first + BLOCK], slots[first : first + BLOCK]
                missing = BLOCK - len(rows)
                outputs.append(self._outputs(np.pad(rows, ((0, missing), (0, 0))), where)[: len(rows)])
        except BaseException:
            self._memory = before  # an error leaves the memory as it was
            raise
        return np.concatenate(outputs)

    def _side_by_side(self, observations: Any) -> npt.NDArray[np.float32]:
        """Return (N, O) of a dictionary of (N, ...) arrays, in the order in which the policy learned from them."""
        assert isinstance(self.observation_space, spaces.Dict)
        parts = [np.asarray(observations[name], dtype=np.float32) for name in self.observation_space.spaces]
        return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)

    def _outputs(self, observations: npt.NDArray[np.float32], slots: IntArray) -> npt.NDArray[np.float32]:
        """Return the (N, K) outputs; rows beyond the slots are only computed."""
        import torch

        with torch.inference_mode():
            features = torch.as_tensor(np.asarray(observations, dtype=np.float32)).flatten(1)
            if self.normaliser is not None:
                features = self.normaliser(features)
            features, after = pad_columns(features), None
            if self._lstm is not None:
                sequence, after = self._lstm(features[None], self._recall(slots, len(features)))
                features = sequence[0]
            output = self._layers(features)
            output = torch.tanh(output) if self._kind.is_squashed else output
            if after is not None:
                memory = self._memory.clone()
                memory[:, :, slots] = torch.stack(after)[:, :, : len(slots)]
                self._memory = memory
            values: npt.NDArray[np.float32] = output[:, : self._num_outputs].numpy()
            return values

    def _recall(self, slots: IntArray, num_rows: int) -> tuple[Any, ...]:
        """Return both parts of the memory of some slots, and nothing for rows beyond; new slots remember nothing."""
        import torch

        known = 0 if self._memory is None else self._memory.shape[2]
        new = torch.zeros(2, self._lstm.num_layers, max(int(slots.max()) + 1 - known, 0), self._lstm.hidden_size)
        self._memory = new if self._memory is None else torch.cat([self._memory, new], dim=2)
        rows = torch.zeros(2, self._lstm.num_layers, num_rows, self._lstm.hidden_size)
        rows[:, :, : len(slots)] = self._memory[:, :, slots]
        return tuple(rows)

    def decide(self, logits: npt.NDArray[np.float32]) -> Any:
        """Return the action that a row of `logits` stands for: the best of each choice, or levels in [-1, 1].

        Raises:
            ValueError: it is not finite, which the best of each choice would hide.
        """
        if not np.isfinite(logits).all():
            raise ValueError("its network gave numbers that are not finite")
        space = self.action_space
        if isinstance(space, spaces.Discrete):
            return np.int64(logits.argmax())
        if isinstance(space, spaces.MultiDiscrete):
            choices = np.split(logits, np.cumsum(space.nvec)[:-1])
            return np.array([choice.argmax() for choice in choices], dtype=np.int64)
        return np.clip(logits, -1.0, 1.0)


def _build(
    kind: Kind,
    options: dict[str, Any],
    settings: dict[str, Any],
    observation: spaces.Space[Any],
    action: spaces.Space[Any],
    path: Path,
) -> dict[str, Any]:
    """Return the network's parts in their order, called as their weights are."""
    from torch import nn

    activation = getattr(nn, options["activation_fn"])
    width, num_outputs = spaces.flatdim(observation), _num_outputs(kind, settings, action, path)
    parts: dict[str, Any] = {}
    if options["is_normalised"]:
        from aquanav_tools.policy.normaliser import NormalisedObservations

        assert isinstance(observation, spaces.Box)
        parts[kind.features] = NormalisedObservations(observation)
    if kind.is_recurrent:
        memory = options["lstm_hidden_size"]
        parts[LSTM], width = nn.LSTM(width, memory, options["n_lstm_layers"]), memory
    hidden: list[nn.Module] = []
    for size in options["net_arch"]:
        hidden += [nn.Linear(width, size), activation()]
        width = size
    output = nn.Linear(width, num_outputs)
    parts[kind.hidden] = nn.Sequential(*hidden, *([] if kind.output else [output]))
    if kind.output:
        parts[kind.output] = output
    return parts


def _flat(part: Any) -> list[Any]:
    """Return the layers of a part of the network."""
    from torch import nn

    return list(part) if isinstance(part, nn.Sequential) else [part]


def _num_outputs(kind: Kind, settings: dict[str, Any], action: spaces.Space[Any], path: Path) -> int:
    if isinstance(action, spaces.Discrete):
        return int(action.n)
    if isinstance(action, spaces.MultiDiscrete):
        return int(action.nvec.sum())
    shape = action.shape or (1,)
    for name, bound in (("low", -1.0), ("high", 1.0)):
        text = str(settings["action_space"].get(name))
        if any(float(number) != bound for number in re.findall(r"[-+\d.e]+", text)) or not re.search(r"\d", text):
            raise InputError(
                f"The policy in {path} acts in a Box whose {name} is {text[:80]}; the task's levels reach from -1 to 1."
                " It was trained for another task. Train one with aquanav-train."
            )
    return int(shape[0])


def _refuse_images(tensors: dict[str, Any], kind: Kind, path: Path) -> None:
    """Refuse parts that go through a network of convolutions, by the names of its weights."""
    lead = f"{kind.features}.extractors."
    names = sorted({name.removeprefix(lead).split(".")[0] for name in tensors if name.startswith(lead)})
    if names and kind.has_parts:
        raise ExoticPolicyError(
            f"The policy in {path} looks at {' and '.join(repr(name) for name in names)} through convolutions (images "
            f"of uint8), which are not rebuilt here: parts that are flattened are. {TRUST}"
        )


def _load_weights(parts: dict[str, Any], kind: Kind, tensors: dict[str, Any], path: Path) -> None:
    """Fill the parts; every tensor must belong to one, or to what only training needs."""
    left = {name for name in tensors if not name.startswith(kind.others)}
    try:
        for prefix, part in parts.items():
            names = {name.removeprefix(prefix + "."): name for name in tensors if name.startswith(prefix + ".")}
            part.load_state_dict({own: tensors[name].float() for own, name in names.items()}, strict=True, assign=True)
            part.eval()
            left -= set(names.values())
    except RuntimeError as cause:
        reason = " ".join(str(cause).split())[:300]
        raise InputError(
            f"The weights in {path} do not fit its own settings: {reason}. Save the policy again."
        ) from cause
    if left:
        raise InputError(
            f"The weights in {path} do not fit its own settings: {', '.join(sorted(left)[:3])} belong to nothing that "
            "the settings name. Save the policy again."
        )
