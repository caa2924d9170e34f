"""What a policy's own file says that it observes: a preset, sensors and earlier decisions, by their names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from aquanav_tools.errors import InputError
from aquanav_tools.registry import is_own
from aquanav_tools.task import TaskOptions

OBSERVED = "observed"
"""Name of the learner's attribute, and so of the entry among an SB3 zip's settings."""
MAX_NAMES = 32
"""Of sensors, and of earlier decisions, that a file may ask for. Chosen."""
Options = TypeVar("Options", bound=TaskOptions)


@dataclass(frozen=True)
class Observed:
    """What is observed, as options name it; no code of a user's own, which a file must not choose."""

    observation: str
    sensors: tuple[str, ...] = ()
    history: tuple[int, ...] = ()

    def rules(self, options: Options) -> Options:
        """Return the task's options with what the policy observes, where they name nothing themselves."""
        return replace(options, sensors=options.sensors or self.sensors, history=options.history or self.history)


def observed_table(observation: str, options: TaskOptions) -> dict[str, Any] | None:
    """Return what to keep in a policy's file; None where it observes by code of the user's own."""
    if any(map(is_own, (observation, *options.sensors))):
        return None
    table = asdict(Observed(observation, options.sensors, options.history))
    return {name: list(value) if isinstance(value, tuple) else value for name, value in table.items()}


def read_observed(settings: Mapping[str, Any], path: Path) -> Observed | None:
    """Return what the settings of a policy's file say that it observes; None where they say nothing.

    Raises:
        InputError: they say it in another form, or name code.
    """
    table = settings.get(OBSERVED)
    if table is None:
        return None
    try:
        found = Observed(table["observation"], tuple(table["sensors"]), tuple(table["history"]))
    except (KeyError, TypeError) as cause:
        raise InputError(f"{path} says in another form than aquanav's what it observes: {table!r:.200}.") from cause
    names = (found.observation, *found.sensors)
    is_plain = all(isinstance(name, str) and not is_own(name) for name in names)
    is_plain &= all(type(ago) is int for ago in found.history)
    if not is_plain or max(len(found.sensors), len(found.history)) > MAX_NAMES:
        raise InputError(
            f"{path} says that it observes {table!r:.200}. A file may name presets and sensors of aquanav's, no code, "
            f"and at most {MAX_NAMES} of them. Do not use it."
        )
    return found
