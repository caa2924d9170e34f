"""Lessons in drawn caves: which caves they begin with, and what brings in the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from tqdm import tqdm

from aquanav_tools.envs.cave_batch import CURRENT
from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.split import check_training_cave, distribution_of
from aquanav_tools.train.cave_rotation import CaveRotation, current_numbers, steps_between
from aquanav_tools.train.cave_supply import CaveSequence, CaveSupply
from aquanav_tools.train.checkpoint import Checkpoint
from aquanav_tools.train.fitting import decisions_of, fitted
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.settings import RunSettings, TrainSettings


@dataclass(frozen=True)
class DrawnCaves:
    """The drawn caves of a lesson."""

    sequence: CaveSequence
    first: int
    """Number of the first in the sequence: each lesson goes on where the one before would end."""
    num: int
    """So many at once."""

    @property
    def window(self) -> range:
        """The numbers of those that the lesson begins with."""
        return range(self.first, self.first + self.num)


@dataclass(frozen=True)
class LessonCaves:
    """Where a lesson is learned."""

    scenarios: list[AnyScenario]
    """In the order of the environments; drawn ones are the last. Emptied once the environments hold them, so that caves
    are let go of whose place others have taken."""
    rotation: CaveRotation | None = None
    """What brings other drawn caves in; None where there are none."""
    final: Sequence[AnyScenario] = ()
    """In which the last policy is measured."""


def check_names(pipeline: Pipeline) -> None:
    """Check that no test cave is named, and that caves are drawn only where they can be.

    Raises:
        InputError: a scenario is a test cave, the backend is not the batch, or the progress is the original's.
        ScenarioError: a name is that of no drawn cave.
    """
    for lesson in pipeline.lessons:
        for name in lesson.all_scenarios:
            if distribution_of(name) is None:
                check_training_cave(name)
            elif pipeline.run.backend != "batch":
                raise InputError(f"{name} draws caves for the batch only. Choose --backend batch, or name a seed.")
            elif lesson.progress == "original":
                raise InputError(f"The progress original counts panels, and {name} has another number in each cave.")
    for name in pipeline.run.validation:
        if distribution_of(name) is not None:
            raise InputError(f"A validation needs caves that stay: give {name} a seed, such as {name}/1.")
        check_training_cave(name)


def fixed_names(lesson: TrainSettings) -> list[str]:
    """Return the names of a lesson's scenarios that are not drawn while it learns."""
    return [name for name in lesson.all_scenarios if distribution_of(name) is None]


def drawn_caves(pipeline: Pipeline, seed: int) -> list[DrawnCaves | None]:
    """Return the drawn caves of each lesson; None where it has none."""
    found: list[DrawnCaves | None] = []
    first = 0
    for lesson in map(fitted, pipeline.lessons):
        styles = tuple(style for name in lesson.all_scenarios if (style := distribution_of(name)) is not None)
        if not styles:
            found.append(None)
            continue
        num = min(lesson.num_caves, lesson.num_envs - len(fixed_names(lesson)))
        found.append(DrawnCaves(CaveSequence(styles, seed, pipeline.run.vehicle, lesson.cave_scales), first, num))
        first += decisions_of(lesson) // lesson.num_envs // steps_between(lesson)
    return found


def first_cave(drawn: DrawnCaves | None) -> list[Scenario]:
    """Return the first cave of a lesson's sequence, by which a run is known; none where no caves are drawn."""
    if drawn is None:
        return []
    with CaveSupply(drawn.sequence, 1) as supply:
        return supply.at_once([0])


@contextmanager
def open_caves(
    run: RunSettings,
    settings: TrainSettings,
    fixed: list[AnyScenario],
    drawn: DrawnCaves | None,
    checkpoint: Checkpoint | None,
    *,
    show_progress: bool,
) -> Iterator[LessonCaves]:
    """Yield where a lesson is learned; drawn caves are built ahead meanwhile.

    Args:
        run: The run's settings.
        settings: The lesson's.
        fixed: Scenarios that stay.
        drawn: Those that are drawn.
        checkpoint: Of this lesson, to go on from; None where it begins.
        show_progress: Whether to show how many caves are ready, with the time left.
    """
    if drawn is None:
        yield LessonCaves(fixed, None, fixed)
        return
    numbers = list(drawn.window)
    if checkpoint is not None:
        state = checkpoint.learner["environments"]
        numbers = current_numbers(state, state[CURRENT].numpy())
    with CaveSupply(drawn.sequence, run.cave_workers) as supply:
        with tqdm(total=drawn.num, desc="Drawing caves", disable=None if show_progress else True) as bar:

            def progress(done: int, _total: int) -> None:
                bar.update(done - bar.n)

            caves: list[AnyScenario] = [*fixed, *supply.at_once(numbers, progress)]
        rotation = CaveRotation(supply, numbers, settings)
        num_tried = max(1, run.final_episodes - len(fixed)) if run.final_episodes else 0
        tried: list[Any] = [*fixed, *supply.at_once(drawn.window[:num_tried])]
        yield LessonCaves(caves, rotation, tried)


def start_sentence(drawn: DrawnCaves) -> str:
    """Return a sentence about the caves that a lesson draws."""
    styles = " and ".join(drawn.sequence.styles)
    return f"It begins in {drawn.num} drawn caves ({styles}); those that are not in the cache are built first."
