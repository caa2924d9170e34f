"""What a training run leaves behind: policy.zip, train.json and curve.csv, each written in one piece."""

from __future__ import annotations

import csv
import dataclasses
import importlib.metadata
import io
import json
import os
import platform
from pathlib import Path
from typing import Any

from aquanav_tools import __version__
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.train.episodes import CurvePoint, LearningCurve
from aquanav_tools.train.settings import TrainSettings

FORMAT = 1
POLICY_FILE, RECORD_FILE, CURVE_FILE = "policy.zip", "train.json", "curve.csv"
LIBRARIES = ("gymnasium", "numpy", "pybullet", "stable-baselines3", "torch")


@dataclasses.dataclass(frozen=True)
class RunRecord:
    """Writes a run's files. A run that is killed leaves those of its last checkpoint."""

    folder: Path
    scenario: Scenario
    settings: TrainSettings
    seed: int

    def write(self, policy: bytes, curve: LearningCurve, *, steps: int, seconds: float, is_finished: bool) -> None:
        """Write the three files, the policy last: when it is new, so are the others."""
        self.folder.mkdir(parents=True, exist_ok=True)
        table = self._table(curve, steps, seconds, is_finished)
        _write_whole(self.folder / CURVE_FILE, _curve_text(curve.points).encode())
        _write_whole(self.folder / RECORD_FILE, (json.dumps(table, indent=1) + "\n").encode())
        _write_whole(self.folder / POLICY_FILE, policy)

    def _table(self, curve: LearningCurve, steps: int, seconds: float, is_finished: bool) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "is_finished": is_finished,
            "steps": steps,
            "episodes": curve.num_episodes,
            "wall_seconds": round(seconds, 1),
            "seed": self.seed,
            "scenario": {"name": self.scenario.name, "content_hash": self.scenario.content_hash},
            "settings": dataclasses.asdict(self.settings),
            "versions": {
                "aquanav": __version__,
                "python": platform.python_version(),
                **{name: importlib.metadata.version(name) for name in LIBRARIES},
            },
            "curve": [_without_nan(dataclasses.asdict(point)) for point in curve.points],
        }


def _curve_text(points: list[CurvePoint]) -> str:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, [field.name for field in dataclasses.fields(CurvePoint)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(dataclasses.asdict(point) for point in points)
    return stream.getvalue()


def _without_nan(row: dict[str, Any]) -> dict[str, Any]:
    """Return the row with None for nan, which JSON does not have."""
    return {name: None if value != value else value for name, value in row.items()}


def _write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is never seen half-written."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    os.replace(partial, path)
