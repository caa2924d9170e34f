"""A policy that the user wrote: any callable from an observation to an action, named as module:function."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import ACTIONS
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.observation import PRESETS
from aquanav_tools.errors import InputError, did_you_mean

SPEC = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)")


class CallablePolicy:
    """Calls the user's code, which is any callable.

    Three attributes of it may say more: `observation` (a preset, "full" if absent), `action` (a form, "multidiscrete"
    if absent) and `reset`, called with the episode's seed before each episode.
    """

    def __init__(self, call: Callable[[Any], Any], name: str = "The policy") -> None:
        """Look at what it asks for.

        Raises:
            InputError: it is no callable, or asks for an unknown preset or form.
        """
        if not callable(call):
            raise InputError(f"{name} is a {type(call).__name__}, which cannot be called with an observation.")
        self._call = call
        self.observation = str(getattr(call, "observation", "full"))
        self.action = str(getattr(call, "action", "multidiscrete"))
        check_choice("observation preset", self.observation, PRESETS)
        check_choice("action form", self.action, ACTIONS)
        self.path: Path | None = None
        """File whose content stands for the policy."""

    def reset(self, seed: int) -> None:
        """Call the policy's own reset, where it has one."""
        if hasattr(self._call, "reset"):
            self._call.reset(seed)

    def act(self, observation: npt.NDArray[np.float32]) -> Any:
        """Return the action for one observation."""
        return self._call(observation)


class OwnPolicy(CallablePolicy):
    """Code named as module:function. Naming a module of one's own is asking to run it, as `python -m` does: no --trust.

    What is named is a function, or a class that is made without arguments and whose instances are called.
    """

    def __init__(self, spec: str) -> None:
        """Import it, the working directory first.

        Raises:
            InputError: it cannot be imported, is no callable, or asks for an unknown preset or form.
        """
        module_name, name = spec.split(":")
        module = _import(module_name)
        if not hasattr(module, name):
            raise InputError(f"The module {module_name} has no {name}.{did_you_mean(name, _callables(module))}")
        found = getattr(module, name)
        super().__init__(_made(found, spec) if isinstance(found, type) else found, spec)
        self.path = Path(module.__file__) if getattr(module, "__file__", None) else None
        """Of the module, whose content stands for the policy; what it imports is not looked at."""


def _import(name: str) -> Any:
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # a command's own path begins with its folder instead
    try:
        return importlib.import_module(name)
    except Exception as cause:  # foreign code runs here: whatever it raises is told
        raise InputError(
            f"The module {name} cannot be imported: {type(cause).__name__}: {cause}. It is looked for in the working "
            f"directory {Path.cwd()} and where Python finds modules. Run the command from the folder of the module."
        ) from cause


def _made(kind: type[Any], spec: str) -> Any:
    try:
        return kind()
    except Exception as cause:  # foreign code again
        raise InputError(
            f"{spec} is a class, and making one without arguments failed: {type(cause).__name__}: {cause}. Name a "
            "function, or a class that needs no arguments."
        ) from cause


def _callables(module: Any) -> list[str]:
    return [name for name, value in vars(module).items() if callable(value) and not name.startswith("_")]
