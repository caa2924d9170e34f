"""Policies as ONNX files in the form of Unity's ML-Agents: the original benchmark's, and those of aquanav-train."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.onnx_file import constants_of, input_shapes, onnx_properties, read_onnx
from aquanav_tools.evaluate.onnx_run import OnnxRunner, Shape
from aquanav_tools.policy.observed import read_observed
from aquanav_tools.policy.spaces import MAX_SIZE

SUFFIX = ".onnx"
OBSERVATION = re.compile(r"obs_(\d+)")
MASKS = "action_masks"
"""Input: 1 for every choice of every branch that is allowed. All are, here."""
ACTIONS = "deterministic_discrete_actions"
"""Output: the most likely choice of every branch."""
CONTINUOUS = "deterministic_continuous_actions"
"""Output of a policy that acts in levels from -1 to 1 instead: the mean of each."""
MEMORY = "memory_size"


class MlAgentsPolicy:
    """A trained network without memory, with choices in branches or with levels; acts deterministically."""

    def __init__(self, path: Path) -> None:
        """Read an ONNX file.

        Raises:
            InputError: it is damaged, no policy of ML-Agents, or one with memory, or one that sees images.
        """
        model = read_onnx(path)
        shapes, outputs = input_shapes(model), [value.name for value in model.graph.output]
        _check_kind(shapes, outputs, path)
        _check_memory(constants_of(model), path)
        self._sizes = _observation_sizes(shapes, path)
        self._is_continuous = ACTIONS not in outputs
        output = CONTINUOUS if self._is_continuous else ACTIONS
        self._runner = OnnxRunner(model, [output], f"The policy {path}")
        num_choices = 0 if self._is_continuous else _num_choices(shapes[MASKS], path)
        self._masks = np.ones((1, num_choices), dtype=np.float32)
        self.observed = read_observed(onnx_properties(model, path), path)
        """What the file says that it observes; None where it says nothing."""
        self.observation_space = spaces.Box(-np.inf, np.inf, (sum(self._sizes),), np.float32)
        """The sensors' values in a row, obs_0 first."""
        self.action_space = self._levels() if self._is_continuous else self._branches(path)

    def reset(self, seed: int) -> None:
        """Do nothing: the network keeps no state and draws no random numbers."""

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return a choice for every branch, or a level each, from the sensors' values in a row."""
        action = self._run(observation, self._masks)
        return int(action[0]) if isinstance(self.action_space, spaces.Discrete) else action

    def _run(self, observation: npt.NDArray[np.float32], masks: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        parts = np.split(observation.astype(np.float32)[None], np.cumsum(self._sizes)[:-1], axis=1)
        inputs = {f"obs_{n}": part for n, part in enumerate(parts)}
        (actions,) = self._runner.run({**inputs, MASKS: masks})
        return np.asarray(actions, dtype=np.float32 if self._is_continuous else np.int64).reshape(-1)

    def _levels(self) -> spaces.Box:
        """Return the space of the levels."""
        nothing = np.zeros(sum(self._sizes), dtype=np.float32)
        return spaces.Box(-1.0, 1.0, self._run(nothing, self._masks).shape, np.float32)

    def _branches(self, path: Path) -> spaces.MultiDiscrete | spaces.Discrete:
        """Return the space of the branches. Forbidding all choices but the last of all makes each branch take its own.

        The file names only the sum of the branches' sizes. With one choice allowed at a time, the branch it belongs
        to takes it; where the next branch takes over, one ends.
        """
        total = self._masks.shape[1]
        nothing = np.zeros(sum(self._sizes), dtype=np.float32)
        taken = []
        for choice in range(total):
            masks = np.zeros((1, total), dtype=np.float32)
            masks[0, choice] = 1.0
            taken.append(self._run(nothing, masks))
        sizes = _sizes_of_branches(np.array(taken), path)
        return spaces.Discrete(sizes[0]) if len(sizes) == 1 else spaces.MultiDiscrete(sizes)


def _sizes_of_branches(taken: npt.NDArray[np.int64], path: Path) -> list[int]:
    """Return the branches' sizes from the (choices, branches) that were taken with one choice allowed at a time."""
    num_choices, num_branches = taken.shape
    sizes: list[int] = []
    for branch in range(num_branches):
        first = sum(sizes)
        size = 0
        while first + size < num_choices and taken[first + size, branch] == size:
            size += 1
        sizes.append(size)
    if sum(sizes) != num_choices or min(sizes) < 1:
        raise InputError(
            f"The policy {path} has {num_choices} choices in {num_branches} branches that do not add up: {sizes}. "
            "Export it again with ML-Agents."
        )
    return sizes


def _check_kind(shapes: dict[str, Shape], outputs: list[str], path: Path) -> None:
    is_discrete = ACTIONS in outputs and MASKS in shapes
    if not is_discrete and CONTINUOUS not in outputs:
        raise InputError(
            f"The policy {path} has the outputs {', '.join(outputs) or 'none'}; {ACTIONS} and the input {MASKS}, "
            f"or {CONTINUOUS}, are needed. It was exported before ML-Agents 2, or is no policy of ML-Agents."
        )


def _check_memory(constants: dict[str, npt.NDArray[Any]], path: Path) -> None:
    memory = constants.get(MEMORY)
    if memory is not None and memory.any():
        raise InputError(f"The policy {path} has a memory of {memory.ravel()[0]:g} values; only those without are run.")


def _observation_sizes(shapes: dict[str, Shape], path: Path) -> list[int]:
    shapes = {name: shape for name, shape in shapes.items() if name != MASKS}
    wanted = [f"obs_{n}" for n in range(len(shapes))]
    is_flat = all(len(shape) == 2 and 1 <= shape[1] <= MAX_SIZE for shape in shapes.values())
    if set(shapes) != set(wanted) or not shapes or not is_flat:
        raise InputError(
            f"The policy {path} has the inputs {_list(shapes)}; vectors obs_0, obs_1, ... are needed, each of a fixed "
            "length. Cameras and memories are not supported."
        )
    return [shapes[name][1] for name in wanted]


def _num_choices(shape: Shape, path: Path) -> int:
    if len(shape) != 2 or not 1 <= shape[1] <= MAX_SIZE:
        raise InputError(f"The policy {path} has action masks of shape {shape}; a fixed number of choices is needed.")
    return shape[1]


def _list(shapes: dict[str, Shape]) -> Any:
    return ", ".join(f"{name} {list(shape)}" for name, shape in shapes.items()) or "none"
