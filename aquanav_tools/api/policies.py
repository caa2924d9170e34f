"""Policies by name, from files, and from callables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from aquanav_tools.evaluate import policies
from aquanav_tools.evaluate.own_code import CallablePolicy
from aquanav_tools.evaluate.policies import LoadedPolicy

PolicySpec = str | Path | LoadedPolicy | Callable[[Any], Any]


def load_policy(policy: PolicySpec, *, trust: bool = False) -> LoadedPolicy:
    """Return a policy with `reset(seed)` and `act(observation)`, which gives the action for one (O,) observation.

    `observation` and `action` of what is returned name the preset and the form that it was made for, as `make_env`
    takes them. baseline:oracle and shield: look at the environment too: call `policy.policy.bind(env)` after each
    reset. Of a file whose policy observes a dictionary, `takes` has the parts with their shapes.

    Args:
        policy: Path of a Stable-Baselines3 zip, an ONNX file, TorchScript or a training run's folder; "module:Name";
            "baseline:reference" and other baselines; "shield:" before any of these; or a callable from observation to
            action, whose attributes `observation`, `action` and `reset` may say more.
        trust: Whether a file may run code when it is loaded; what can be read without is, all the same.

    Raises:
        InputError: no such baseline (with the nearest name), or the file is missing, damaged, unsafe or for another
            task.
    """
    if isinstance(policy, LoadedPolicy):
        return policy
    if isinstance(policy, str | Path):
        return policies.load_policy(str(policy), trust)
    return policies.own_policy(CallablePolicy(policy), getattr(policy, "__name__", type(policy).__name__))
