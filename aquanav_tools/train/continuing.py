"""Going on with a run that was begun before: what must be the same, and what may be more."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError
from aquanav_tools.train.checkpoint import Checkpoint
from aquanav_tools.train.fitting import decisions_of, fitted
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.settings import TrainSettings

OPEN = ("n_steps", "batch", "learning_starts")
"""Settings that a lesson may leave open, and that are then chosen by its steps."""
Tables = Sequence[dict[str, Any]]
"""The lessons of a run, as its record has them."""


def as_begun(lesson: TrainSettings, table: dict[str, Any]) -> dict[str, Any]:
    """Return what of a lesson's record must be as this lesson asks: steps may differ, and what it leaves open."""
    chosen = {name: table.get(name) for name in OPEN if getattr(lesson, name) == 0}
    return {**dataclasses.asdict(fitted(lesson)), **chosen, "steps": table.get("steps")}


def continued(asked: Pipeline, tables: Tables) -> Pipeline:
    """Return the pipeline with what each lesson leaves open as the run chose it; chosen anew in others."""
    lessons = tuple(
        fitted(lesson)
        if table is None or lesson.steps != table["steps"]
        else dataclasses.replace(lesson, **{name: table[name] for name in OPEN})
        for lesson, table in zip_longest(asked.lessons, tables)
    )
    return Pipeline(lessons, asked.run)


def check_steps(asked: Pipeline, tables: Tables, checkpoint: Checkpoint, folder: Path) -> None:
    """Check that no lesson has become shorter, and none longer that others were built on.

    Raises:
        InputError: one has.
    """
    for number, (lesson, table) in enumerate(zip(asked.lessons, tables, strict=False)):
        before = table["steps"]
        if lesson.steps < before:
            raise InputError(
                f"The run in {folder} was begun with {before:,} steps{_of(number, tables)} and has learned from "
                f"{checkpoint.journal['steps']:,} decisions; {lesson.steps:,} were asked for now. A run can be made "
                "longer, not shorter. Ask for as many or more, name another folder with -o, or begin anew with "
                "--overwrite."
            )
        if lesson.steps > before and number < checkpoint.lesson:
            raise InputError(
                f"Lesson {number + 1} of the run in {folder} ended after {before:,} steps, and lesson "
                f"{checkpoint.lesson + 1} went on from there; {lesson.steps:,} were asked for now. Only the lesson "
                "learned last, and those after it, can be made longer: change steps in their [[lessons]] tables."
            )


def is_lesson_over(lesson: TrainSettings, checkpoint: Checkpoint) -> bool:
    """Return whether nothing is left to do in the checkpoint's lesson, which may have become longer since."""
    return bool(lesson.steps <= checkpoint.learner["num_timesteps"])


def continuation_text(pipeline: Pipeline, tables: Tables, checkpoint: Checkpoint, folder: Path) -> str:
    """Return a sentence about where a run goes on."""
    lesson, before = pipeline.lessons[checkpoint.lesson], tables[checkpoint.lesson]["steps"]
    done = checkpoint.learner["num_timesteps"]
    text = f"Goes on with the run in {folder} after {checkpoint.journal['steps']:,} decisions."
    if lesson.steps > before:
        rate = lesson.learning_rate
        was, now = (rate * max(0.0, 1.0 - done / steps) for steps in (before, decisions_of(lesson, done)))
        text += (
            f" It was begun with {before:,} steps{_of(checkpoint.lesson, tables)} and now has {lesson.steps:,}: the "
            f"learning rate, which falls over all of them, rises here from {was:.2g} to {now:.2g}. The policy will not "
            f"be that of one run of {lesson.steps:,} steps."
        )
    if len(pipeline.lessons) > len(tables):
        text += f" It was begun with {len(tables)} of its {len(pipeline.lessons)} lessons; the others come after them."
    return text


def _of(number: int, tables: Tables) -> str:
    return f" in lesson {number + 1}" if len(tables) > 1 else ""
