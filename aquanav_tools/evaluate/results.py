"""results.json: what an evaluation found, in a versioned form that other programs can rely on.

Everything but the table `run` follows from the policy, the scenario and the options: repeated on the same machine, it
is the same to the byte.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import os
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aquanav_tools import __version__
from aquanav_tools.evaluate.metrics import EpisodeMetrics, Summary

FORMAT = 1
SCHEMA = Path(__file__).with_name("results.schema.json")
DIGITS = 6
"""Decimals kept: micrometres and microseconds."""


@dataclasses.dataclass(frozen=True)
class Provenance:
    """What was evaluated, where and how."""

    policy: str
    """File name of the zip, or the name of the baseline."""
    policy_sha256: str | None
    """Of the zip; None for a baseline."""
    scenario: str
    scenario_hash: str
    options: dict[str, Any]
    """Resolved options that change the numbers."""


@dataclasses.dataclass(frozen=True)
class Run:
    """What differs from one run to the next."""

    started: str
    """ISO 8601, UTC."""
    seconds: float
    decisions_per_second: float


def results_table(
    provenance: Provenance, summary: Summary, episodes: Sequence[EpisodeMetrics], run: Run
) -> dict[str, Any]:
    """Return the table that results.json holds."""
    table = {
        "format": FORMAT,
        "policy": {"name": provenance.policy, "sha256": provenance.policy_sha256},
        "scenario": {"name": provenance.scenario, "content_hash": provenance.scenario_hash},
        "options": provenance.options,
        "versions": _versions(),
        "summary": dataclasses.asdict(summary),
        "episodes": [dataclasses.asdict(episode) for episode in episodes],
        "run": dataclasses.asdict(run),
    }
    rounded: dict[str, Any] = _rounded(table)
    return rounded


def check_results(table: dict[str, Any]) -> None:
    """Raise jsonschema.ValidationError when a table does not follow the shipped schema."""
    import jsonschema  # type: ignore[import-untyped]

    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(table)


def write_results(table: dict[str, Any], path: Path) -> None:
    """Check a table and write it as results.json, whole or not at all."""
    check_results(table)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(table, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    os.replace(partial, path)


def _versions() -> dict[str, str]:
    packages = ("numpy", "gymnasium", "pybullet", "torch", "stable-baselines3")
    versions = {name: importlib.metadata.version(name) for name in packages}
    return {"aquanav": __version__, "python": platform.python_version(), **versions}


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return value
