"""Policies whose files are programs: loaded only where the user says with --trust that their maker is trusted.

A Stable-Baselines3 zip of unknown make is unpickled, which runs what its pickles say. TorchScript has no pickles that
Python would run, but it is a language with operators that write files (torch.save, torch.from_file) and with
`__setstate__`, which runs while loading: a TorchScript file is a program too, and bounding its size bounds nothing.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.presets import OBSERVATION_SIZES, PARTS
from aquanav_tools.libraries import require
from aquanav_tools.sim.command import NUM_CHOICES

MAX_FILE_BYTES = 1 << 30
"""Far above any policy; a larger file is something else."""
TORCHSCRIPT = (".pt", ".pth")
EXPORT = "Export it again with torch.jit.script(model).save('policy.pt')."

logger = logging.getLogger(__name__)


class TrustedPolicy:
    """A policy that Stable-Baselines3 loads itself, with all that its file makes it run; acts deterministically."""

    def __init__(self, path: Path) -> None:
        """Load an SB3 zip with its pickles.

        Raises:
            InputError: it cannot be loaded, or a library that it names is not installed.
        """
        _warn(path)
        self._model = _library_load(path)
        self.observation_space: spaces.Space[Any] = self._model.observation_space
        self.action_space: spaces.Space[Any] = self._model.action_space
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget what was seen."""
        self._memory: Any = None
        self._is_first = np.ones(1, dtype=np.bool_)

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return the action for one observation."""
        action, self._memory = self._model.predict(
            observation, state=self._memory, episode_start=self._is_first, deterministic=True
        )
        self._is_first = np.zeros(1, dtype=np.bool_)
        return action


class TorchScriptPolicy:
    """A TorchScript module from a batch of one observation to actions.

    It takes float32 (1, 44), (1, 31) or (1, 120): the presets "full", "paper" or "original", tried in this order. Of
    floats it gives 3 levels, or 9 logits (three for each of ballast, steer and thrust), or 27 logits of the discrete
    form; of integers 3 choices, or 1. For a boat it takes 16, 9 or 36 values, and gives 2 levels, 6 logits or 9, or 2
    choices or 1. An exported method `reset()` is called before each episode.
    """

    def __init__(self, path: Path) -> None:
        """Load a TorchScript file.

        Raises:
            InputError: it is no TorchScript, or takes or gives numbers of other shapes.
        """
        require(f"The policy {path}, which is TorchScript,", "torch")
        import torch

        _warn(path)
        torch.set_num_threads(1)
        try:
            loaded = torch.jit.load(str(path), map_location="cpu")  # type: ignore[no-untyped-call]
            self._module: Any = loaded.eval()
        except (RuntimeError, ValueError) as cause:
            raise InputError(f"{path} is no TorchScript: {_first_line(cause)} {EXPORT}") from cause
        task, size, output = self._try_sizes(path)
        self.observation_space = spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = ActionModel(_form(output, PARTS[task], path), PARTS[task]).space

    def reset(self, seed: int) -> None:
        """Call the module's own reset, where it has one."""
        if hasattr(self._module, "reset"):
            self._module.reset()

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return the action for one observation."""
        output = self._run(observation)
        if not isinstance(self.action_space, spaces.Box) and output.dtype.kind == "f":
            is_branched = isinstance(self.action_space, spaces.MultiDiscrete)
            output = output.reshape(-1, NUM_CHOICES if is_branched else output.size).argmax(axis=1)
        return output if isinstance(self.action_space, spaces.Box | spaces.MultiDiscrete) else int(output[0])

    def _run(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        import torch

        with torch.inference_mode():
            batch = torch.as_tensor(np.asarray(observation, dtype=np.float32)).reshape(1, -1)
            return np.asarray(self._module(batch).numpy()).reshape(-1)

    def _try_sizes(self, path: Path) -> tuple[str, int, npt.NDArray[Any]]:
        """Return the task and the number of values that the module takes, and what it gives."""
        import torch

        reasons = []
        for task, size in ((task, size) for task, sizes in OBSERVATION_SIZES.items() for size in sizes.values()):
            try:
                output = self._run(np.zeros(size, dtype=np.float32))
            except (torch.jit.Error, RuntimeError, AttributeError, TypeError) as cause:  # wrong size, or no tensor
                reasons.append(f"{size}: {_first_line(cause)}")
            else:
                return task, size, output
        raise InputError(
            f"The TorchScript module {path} takes no observation of a task: {'; '.join(reasons)[:600]}. It must take "
            f"one float32 tensor (1, N) and give a tensor. {EXPORT}"
        )


def _form(output: npt.NDArray[Any], parts: tuple[str, ...], path: Path) -> str:
    """Return the form of the actions that a module gives."""
    num, all_logits = len(parts), NUM_CHOICES ** len(parts)
    forms = {("f", num): "continuous", ("f", NUM_CHOICES * num): "multidiscrete", ("f", all_logits): "discrete"}
    forms |= {("i", num): "multidiscrete", ("i", 1): "discrete"}
    found = (output.dtype.kind, output.size)
    if found not in forms:
        raise InputError(
            f"The TorchScript module {path} gives {output.size} values of type {output.dtype}. Known are "
            f"{num} floats (continuous), {NUM_CHOICES * num} floats or {num} integers (multidiscrete), "
            f"{all_logits} floats or 1 integer (discrete). {EXPORT}"
        )
    return forms[found]


def _library_load(path: Path) -> Any:
    """Return the policy as Stable-Baselines3 makes it from its unpickled settings and weights."""
    require(f"The policy {path}, a zip of Stable-Baselines3,", "torch", "stable_baselines3")
    from stable_baselines3.common.save_util import load_from_zip_file

    try:
        settings, weights, _ = load_from_zip_file(path, device="cpu")
        if settings is None:
            raise ValueError("it has no settings")
        options = settings["policy_kwargs"]
        if settings.get("use_sde"):
            options = {"use_sde": True, **options}
        policy = settings["policy_class"](
            settings["observation_space"], settings["action_space"], lambda _: 0.0, **options
        )
        policy.load_state_dict(weights["policy"])
    except Exception as cause:  # foreign code runs here: whatever it raises is told
        raise InputError(
            f"Stable-Baselines3 cannot load {path}: {type(cause).__name__}: {_first_line(cause)} A class that it needs "
            "may not be installed (sb3-contrib, or a module of the training's own, which must be importable here)."
        ) from cause
    policy.set_training_mode(False)
    return policy


def _warn(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"There is no policy at {path}. Check the path.")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise InputError(f"{path} has {path.stat().st_size} bytes, more than {MAX_FILE_BYTES}: no policy.")
    logger.warning("--trust: loading %s runs any code that it holds, with your rights.", path)


def _first_line(cause: BaseException) -> str:
    lines = [line.strip() for line in str(cause).splitlines() if line.strip()]
    return f"{lines[-1] if lines else type(cause).__name__}"[:300]
