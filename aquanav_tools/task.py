"""What can be chosen about the task, for training and evaluation alike. Light to import: command lines read it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Literal

from aquanav_tools.errors import InputError, did_you_mean


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """The rules of the task. Each field is an option of aquanav-train, aquanav-eval and the environment."""

    reward: Literal["dense", "safe", "sparse"] = "dense"
    """What is paid for: progress; progress away from walls; the outcome alone."""
    progress: Literal["panels", "original"] = "panels"
    """How the reward measures the way to go: along the guide's panels, or by the original's chain of their centres."""
    on_collision: Literal["continue", "end"] = "continue"
    """What the first contact with a wall does to the episode. The sparse reward always ends it."""


def task_options(choices: dict[str, Any]) -> TaskOptions:
    """Return the options from their names and values.

    Raises:
        InputError: there is no option of a name, or a value makes no sense.
    """
    known = [field.name for field in fields(TaskOptions)]
    for name in choices:
        if name not in known:
            raise InputError(f"The task has no option '{name}'.{did_you_mean(name, known)}")
    return TaskOptions(**choices)


def choices_of(options: TaskOptions) -> dict[str, Any]:
    """Return the names and values of the task's options, also from a dataclass that adds others."""
    return {field.name: getattr(options, field.name) for field in fields(TaskOptions)}
