"""Settings by the names and meanings that they once had: pipelines with an old one are refused, recorded runs go on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aquanav_tools.errors import InputError

RENAMED = {
    "also": "scenarios",
    "blind_to": "masked_observations",
    "trace": "gae_lambda",
    "warm_up": "learning_starts",
    "entropy": "ent_coef",
}
"""Old names and new ones of the same meaning."""
BUFFER = "buffer"
"""Was n_steps * num_envs."""
OLD_NAMES = frozenset({*RENAMED, BUFFER})
ADDED: dict[str, Any] = {
    "precision": "float32", "randomisation": None, "sensors": [], "num_caves": 64, "new_cave_every": 100_000,
    "cave_that_leaves": "oldest", "start_range": [0.0, 1.0], "cave_scales": [1.0, 1.0], "imitation": [0.0, 0.0],
    "greedy": 0.0, "waypoint": "map",
}  # fmt: skip
"""Settings that records of earlier versions lack, as those versions learned."""


def refuse_old_name(key: str, value: object, num_envs: object, where: str) -> None:
    """Refuse a setting by an old name; the message has the new one, and for a buffer the value to write.

    Args:
        key: An old name, or any other, which passes.
        value: Of the setting.
        num_envs: Environments of the lesson; None where that is not known.
        where: A file or function that has the key.

    Raises:
        InputError: the name is an old one.
    """
    if key in RENAMED:
        raise InputError(f"{where} has the key '{key}', which is called {RENAMED[key]} now. Rename it there.")
    if key == BUFFER:
        raise InputError(
            f"{where} has the key 'buffer', which counted decisions over all environments. n_steps counts those of "
            f"each, as in Stable-Baselines3. Write n_steps = {n_steps_text(value, num_envs)} in its place."
        )


def n_steps_text(buffer: object, num_envs: object) -> str:
    """Return the n_steps of an old buffer, or how to find it where the environments are not known or do not fit."""
    if isinstance(buffer, int) and isinstance(num_envs, int) and num_envs > 0 and buffer % num_envs == 0:
        return f"{buffer // num_envs} ({buffer} / {num_envs} environments)"
    return f"{buffer} / {'num_envs' if num_envs is None else num_envs}"


def current_lesson(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a lesson, as a run of this or an earlier version recorded it, by the names that settings have now."""
    lesson = {RENAMED.get(key, key): value for key, value in record.items()}
    if BUFFER in lesson:
        lesson["n_steps"] = lesson.pop(BUFFER) // lesson["num_envs"]  # always a multiple: others were refused
    return {**ADDED, **lesson}
