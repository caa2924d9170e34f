"""A policy that the user wrote: any callable from an observation to an action, named as module:function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from aquanav_tools.envs.action import ACTIONS
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.observed import DICTIONARY
from aquanav_tools.registry import import_own, module_file
from aquanav_tools.sim.scales import PRESETS


class CallablePolicy:
    """Calls the user's code, which is any callable.

    Three attributes of it may say more: `observation` (a preset, "full" if absent, or a dictionary of parts), `action`
    (a form, "multidiscrete" if absent) and `reset`, called with the episode's seed before each episode.
    """

    def __init__(self, call: Callable[[Any], Any], name: str = "The policy") -> None:
        """Look at what it asks for.

        Raises:
            InputError: it is no callable, or asks for an unknown preset or form.
        """
        if not callable(call):
            raise InputError(f"{name} is a {type(call).__name__}, which cannot be called with an observation.")
        self._call = call
        observed = getattr(call, "observation", "full")
        self.parts: dict[str, Any] | None = dict(observed) if isinstance(observed, Mapping) else None
        """What it observes by name, where that is a dictionary."""
        self.observation = DICTIONARY if self.parts is not None else str(observed)
        self.action = str(getattr(call, "action", "multidiscrete"))
        if self.parts is None:
            check_choice("observation preset", self.observation, PRESETS)
        check_choice("action form", self.action, ACTIONS)
        self.path: Path | None = None
        """File whose content stands for the policy."""

    def reset(self, seed: int) -> None:
        """Call the policy's own reset, where it has one."""
        if hasattr(self._call, "reset"):
            self._call.reset(seed)

    def act(self, observation: Any) -> Any:
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
        super().__init__(import_own(spec, "policy"), spec)
        self.path = module_file(spec)
        """Of the module, whose content stands for the policy; what it imports is not looked at."""
