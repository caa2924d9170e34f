"""The folder of a training run: what it is, how it went, its policies and where to go on from."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.errors import InputError
from aquanav_tools.policy.run_folder import BEST_FILE, POLICY_FILE
from aquanav_tools.store import write_whole
from aquanav_tools.train.checkpoint import CHECKPOINT_FILE, Checkpoint, read_checkpoint, write_checkpoint
from aquanav_tools.train.continuing import as_begun, check_steps, continuation_text, continued, is_lesson_over
from aquanav_tools.train.episodes import LearningCurve
from aquanav_tools.train.fitting import fitted
from aquanav_tools.train.initial import InitialPolicy
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.renamed import current_lesson
from aquanav_tools.train.validation import TRIED_FILE, Trial
from aquanav_tools.train.versions import versions

FORMAT = 2
RECORD_FILE, CURVE_FILE, TRIALS_FILE = "train.json", "curve.csv", "validation.csv"
EVENTS_DIR = "tensorboard"
FREE = ("workers", "cave_workers", "ray", "checkpoint_every", "init")
"""Settings of the run that change neither the policy nor its record; of `init` the file's hash counts."""
OWN_FILES = (
    CHECKPOINT_FILE, POLICY_FILE, BEST_FILE, RECORD_FILE, CURVE_FILE, TRIALS_FILE, EVENTS_DIR, "policy.onnx",
    "policy.pt", "curve.rrd", "report.html", "pictures", TRIED_FILE,
)  # fmt: skip


class RunRecord:
    """Writes a run's files. A run that is killed leaves those of its last checkpoint."""

    def __init__(
        self,
        folder: Path,
        pipeline: Pipeline,
        seed: int,
        scenarios: Sequence[AnyScenario],
        validation: Sequence[AnyScenario],
        initial: InitialPolicy | None,
    ) -> None:
        self.folder = folder
        self._asked = pipeline
        self.pipeline = dataclasses.replace(pipeline, lessons=tuple(map(fitted, pipeline.lessons)))
        """With numbers for what lessons leave open."""
        self._identity = _identity(self.pipeline, seed, scenarios, validation, initial)
        self._versions = versions()
        self._resumed: list[dict[str, Any]] = []

    def find(self, tell: Callable[[str], None]) -> Checkpoint | None:
        """Return the checkpoint to go on from; None where nothing was begun.

        Args:
            tell: Called with a sentence about where the run goes on.

        Raises:
            InputError: the folder holds another run, a longer one, or a damaged checkpoint.
        """
        checkpoint = read_checkpoint(self.folder)
        if checkpoint is None:
            return None
        begun = checkpoint.journal["identity"]
        begun["lessons"] = [current_lesson(one) for one in begun["lessons"]]
        different = list(_differences(begun, self._as_begun(begun)))
        if different:
            raise InputError(
                f"{self.folder} holds another training run, with {_differences_text(different)}. Nothing was changed "
                "there. Go on with what it was begun with, name another folder with -o, or begin anew with --overwrite."
            )
        check_steps(self._asked, begun["lessons"], checkpoint, self.folder)
        self.pipeline = continued(self._asked, begun["lessons"])
        self._identity["lessons"] = _plain([dataclasses.asdict(lesson) for lesson in self.pipeline.lessons])
        self._resumed = checkpoint.journal["resumed"]
        asked = [lesson["steps"] for lesson in begun["lessons"]]
        self._resumed.append({"steps": checkpoint.journal["steps"], "asked": asked, "versions": self._versions})
        if not self.is_finished(checkpoint):
            tell(continuation_text(self.pipeline, begun["lessons"], checkpoint, self.folder))
        return checkpoint

    def is_finished(self, checkpoint: Checkpoint) -> bool:
        """Return whether nothing is left to learn."""
        lessons = self.pipeline.lessons
        is_last = checkpoint.lesson == len(lessons) - 1
        return bool(checkpoint.journal["is_finished"]) and is_last and is_lesson_over(lessons[-1], checkpoint)

    def _as_begun(self, begun: dict[str, Any]) -> dict[str, Any]:
        """Return what this run is, but for what may differ from how it was begun."""
        num_lessons, num_scenarios = len(begun["lessons"]), len(begun["scenarios"])
        if num_lessons > len(self._asked.lessons):
            return self._identity
        lessons = map(as_begun, self._asked.lessons[:num_lessons], begun["lessons"])
        scenarios = self._identity["scenarios"][:num_scenarios]  # those of lessons that came later are the last
        return {**self._identity, "lessons": _plain(list(lessons)), "scenarios": scenarios}

    def clear(self) -> None:
        """Remove the files of an earlier run."""
        for name in OWN_FILES:
            path = self.folder / name
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)

    def write(
        self,
        policy: bytes,
        checkpoint: Checkpoint,
        curve: LearningCurve,
        trials: Sequence[Trial],
        *,
        is_finished: bool,
    ) -> None:
        """Write all files, the checkpoint last: when it is new, so are the others."""
        table = {
            "format": FORMAT,
            "is_finished": is_finished,
            **{name: checkpoint.journal[name] for name in ("steps", "seconds")},
            "episodes": curve.num_episodes,
            **self._identity,
            "versions": self._versions,
            "resumed": self._resumed,
            "curve": [_without_nan(point.row) for point in curve.points],
            "validation": [dataclasses.asdict(trial) for trial in trials],
            "final": checkpoint.journal["final"],
        }
        write_whole(self.folder / CURVE_FILE, _as_csv([point.row for point in curve.points]))
        if trials:
            write_whole(self.folder / TRIALS_FILE, _as_csv([dataclasses.asdict(trial) for trial in trials]))
        write_whole(self.folder / RECORD_FILE, json.dumps(table, indent=1) + "\n")
        write_whole(self.folder / POLICY_FILE, policy)
        own = {"identity": self._identity, "resumed": self._resumed, "is_finished": is_finished}
        journal = {**checkpoint.journal, **own}
        write_checkpoint(dataclasses.replace(checkpoint, journal=journal), self.folder)


def _identity(
    pipeline: Pipeline,
    seed: int,
    scenarios: Sequence[AnyScenario],
    validation: Sequence[AnyScenario],
    initial: InitialPolicy | None,
) -> dict[str, Any]:
    """Return what makes a run this run, as JSON gives it back."""
    run = {name: value for name, value in dataclasses.asdict(pipeline.run).items() if name not in FREE}
    identity = {
        "seed": seed,
        "run": run,
        "lessons": [dataclasses.asdict(lesson) for lesson in pipeline.lessons],
        "scenarios": [_named(scenario) for scenario in scenarios],
        "validation_scenarios": [_named(scenario) for scenario in validation],
        "init": None if initial is None else {"file": initial.path.name, "sha256": initial.sha256},
    }
    plain: dict[str, Any] = _plain(identity)
    return plain


def _plain(tree: Any) -> Any:
    return json.loads(json.dumps(tree))


def _named(scenario: AnyScenario) -> dict[str, Any]:
    named: dict[str, Any] = {"name": scenario.name, "content_hash": scenario.content_hash}
    if scenario.other_vehicle is not None:
        named["vehicle"] = dataclasses.asdict(scenario.other_vehicle)
    return named


def _differences(found: Any, wanted: Any, where: str = "") -> Any:
    """Yield (where, found, wanted) for each value that differs between two trees of plain values."""
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key in sorted({*found, *wanted}):
            yield from _differences(found.get(key), wanted.get(key), f"{where}.{key}" if where else key)
    elif isinstance(found, list) and isinstance(wanted, list) and len(found) == len(wanted):
        for number, pair in enumerate(zip(found, wanted, strict=True), 1):
            yield from _differences(*pair, f"{where} {number}")
    elif found != wanted:
        yield where, found, wanted


def _differences_text(differences: Sequence[tuple[str, Any, Any]]) -> str:
    texts = [f"{where} {found!r} instead of {wanted!r}" for where, found, wanted in differences[:3]]
    more = f", and {len(differences) - 3} more" if len(differences) > 3 else ""
    return ", ".join(texts) + more


def _as_csv(rows: Sequence[dict[str, Any]]) -> str:
    names = list(dict.fromkeys(name for row in rows for name in row))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _without_nan(row: dict[str, Any]) -> dict[str, Any]:
    """Return the row with None for nan, which JSON does not have."""
    return {name: None if value != value else value for name, value in row.items()}
