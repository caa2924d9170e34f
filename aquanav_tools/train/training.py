"""A training run: its lessons one after the other, from the beginning or from where it was stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize
from tqdm import tqdm

from aquanav_tools.envs.factory import AnyScenario, read_any_scenario, say_left_out, with_vehicle
from aquanav_tools.errors import InputError, OwnCodeError
from aquanav_tools.scenario.bay import Bay
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.split import check_training_scenario
from aquanav_tools.sim.batch.ahead import compiling_kernels
from aquanav_tools.sim.contacts import contacts_of, load_bullet
from aquanav_tools.store import locked, told_when_full
from aquanav_tools.train.batched import BatchedEnvs
from aquanav_tools.train.callback import TrainingCallback
from aquanav_tools.train.checkpoint import Checkpoint, restore_learner, return_statistics, set_return_statistics
from aquanav_tools.train.continuing import is_lesson_over
from aquanav_tools.train.drawn_lessons import (
    DrawnCaves,
    LessonCaves,
    check_names,
    drawn_caves,
    first_cave,
    fixed_names,
    open_caves,
    start_sentence,
)
from aquanav_tools.train.environment_group import training_env
from aquanav_tools.train.environments import TrainingEnvs
from aquanav_tools.train.episodes import CurvePoint
from aquanav_tools.train.events import EventFile
from aquanav_tools.train.fitting import decisions_of, described, fitted
from aquanav_tools.train.initial import InitialPolicy, begin_with, fitted_initial, read_initial
from aquanav_tools.train.journal import RunJournal
from aquanav_tools.train.learners import inherit, make_learner, parameters_of
from aquanav_tools.train.mirror import MirroredEnvs, check_mirror_images
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.products import fast_products
from aquanav_tools.train.record import EVENTS_DIR, RunRecord
from aquanav_tools.train.reporting import REPORT_FILE, write_artifacts
from aquanav_tools.train.settings import RunSettings, TrainSettings
from aquanav_tools.train.validation import Trial, open_trials


def _tell_nobody(sentence: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Trained:
    """What came out of a run."""

    point: CurvePoint
    """The last of the learning curve."""
    best: Trial | None
    """The trial of best.zip; None without validation."""
    final: Trial | None
    """The last policy in whole episodes of the last lesson; None where none were asked for."""
    was_finished: bool
    """Whether there was nothing left to do."""


def train(
    pipeline: Pipeline,
    seed: int,
    output_dir: Path,
    *,
    scenario: AnyScenario | None = None,
    overwrite: bool = False,
    show_progress: bool = False,
    tell: Callable[[str], None] = _tell_nobody,
) -> Trained:
    """Learn a policy, lesson by lesson. A run that was stopped goes on from its last checkpoint, to the same policy.

    One that is given more steps than it was begun with goes on as well, but not to the policy of a run that was begun
    with as many: the learning rate, which falls over all steps, fell faster before.

    Args:
        pipeline: What to learn.
        seed: Of environments, network and sampling. The same seed gives the same policy on one machine.
        output_dir: Folder of the run; made when absent.
        scenario: One in memory that stands for the scenario of each lesson.
        overwrite: Whether to begin anew where the folder holds another run.
        show_progress: Whether to show a bar with the time left on stderr, where that is a terminal.
        tell: Called with sentences about what is going to be learned.

    Raises:
        InputError: the folder holds another run, an algorithm is not installed, the policy to begin with does not
            fit, or the vehicle does not fit into a scenario.
        ScenarioError: a scenario cannot be read.
        ResourceError: the disk is full, or a worker was killed.
        WorkerError: an environment in a worker raised an error, or took too long.
        TrainingError: learning diverged.
    """
    torch.set_num_threads(1)  # more threads are slower on a busy machine, for networks this small
    vehicle = pipeline.run.vehicle
    check_names(pipeline)
    check_mirror_images(pipeline.lessons)
    drawn: list[DrawnCaves | None] = [None] * len(pipeline.lessons) if scenario else drawn_caves(pipeline, seed)
    named = [name for lesson in pipeline.lessons for name in lesson.all_scenarios] if scenario is None else []
    with compiling_kernels(named):
        scenarios = [
            [
                with_vehicle(scenario or read_any_scenario(name), vehicle)
                for name in ([""] if scenario else fixed_names(lesson))
            ]
            for lesson in pipeline.lessons
        ]
        validation = [with_vehicle(read_any_scenario(name), vehicle) for name in pipeline.run.validation]
        # Drawn caves are represented by the first: it changes when what draws them does.
        all_scenarios = [
            one for group, lesson in zip(scenarios, drawn, strict=True) for one in (*group, *first_cave(lesson))
        ]
    _check_task(pipeline, [*all_scenarios, *validation])
    say_left_out([*all_scenarios, *validation])
    initial = _initial(pipeline, all_scenarios[0])
    record = RunRecord(output_dir, pipeline, seed, all_scenarios, validation, initial)
    with _writable(output_dir):
        if overwrite:
            record.clear()
        checkpoint = record.find(tell)
        with closing(EventFile(output_dir / EVENTS_DIR)) as events:
            journal = RunJournal(events) if checkpoint is None else RunJournal.from_table(checkpoint.journal, events)
            was_finished = checkpoint is not None and record.is_finished(checkpoint)
            if not was_finished:
                run = _Run(record.pipeline, seed, record, journal, validation, initial, drawn, show_progress)
                with fast_products():
                    _learn_all(run, scenarios, checkpoint, tell)
            if not (was_finished and (output_dir / REPORT_FILE).is_file()):
                write_artifacts(output_dir, record.pipeline, journal)
        return Trained(journal.curve.points[-1], journal.best, journal.final, was_finished)


@dataclass(frozen=True)
class _Run:
    """What the lessons of a run have in common."""

    pipeline: Pipeline
    seed: int
    record: RunRecord
    journal: RunJournal
    validation: list[AnyScenario]
    initial: InitialPolicy | None
    drawn: list[DrawnCaves | None]
    """Of each lesson."""
    show_progress: bool


@dataclass(frozen=True)
class _Learned:
    """What passes from lesson to lesson."""

    parameters: dict[str, Any]
    returns: list[float]
    """Running mean, variance and count of the returns."""


def _check_task(pipeline: Pipeline, scenarios: list[AnyScenario]) -> None:
    bays = [one.name for one in scenarios if isinstance(one, Bay)]
    caves = [one.name for one in scenarios if not isinstance(one, Bay)]
    for one in scenarios:
        if isinstance(one, Scenario):
            check_training_scenario(one)
    if caves and pipeline.run.backend == "pybullet":
        load_bullet()
    if any(lesson.is_taught for lesson in pipeline.lessons) and (bays or pipeline.run.backend != "batch"):
        where = f"{bays[0]} is a bay" if bays else f"this is {pipeline.run.backend}"
        raise InputError(f"imitation needs caves and the batch, and {where}. Leave it out, or choose --backend batch.")
    if any(lesson.waypoint == "route" for lesson in pipeline.lessons) and pipeline.run.backend != "batch":
        raise InputError(
            f"waypoint = route needs the batch, and this is {pipeline.run.backend}. Leave it out, or choose --backend "
            "batch."
        )
    if bays and caves:
        raise InputError(f"{bays[0]} is a bay and {caves[0]} a cave: no network is for both. Train one for each.")
    if bays and any(lesson.mirrored or lesson.masked_observations for lesson in pipeline.lessons):
        raise InputError(f"mirrored and masked_observations are for caves, and {bays[0]} is a bay. Leave them out.")


def _initial(pipeline: Pipeline, scenario: AnyScenario) -> InitialPolicy | None:
    """Return the policy to begin with, as it fits the first lesson's task."""
    if pipeline.run.init is None:
        return None
    initial, lesson = read_initial(pipeline.run.init), fitted(pipeline.lessons[0])
    with closing(training_env(scenario, lesson)) as env:
        return fitted_initial(initial, env.observation_space, env.action_space, lesson)


def _learn_all(
    run: _Run,
    scenarios: list[list[AnyScenario]],
    checkpoint: Checkpoint | None,
    tell: Callable[[str], None],
) -> None:
    learned: _Learned | None = None
    first, lessons = 0, run.pipeline.lessons
    if checkpoint is not None:
        first = checkpoint.lesson
        if is_lesson_over(lessons[first], checkpoint):
            learned, first = _Learned(checkpoint.learner["parameters"], checkpoint.learner["spread"]), first + 1
            checkpoint = None
    total = run.journal.steps
    for number, lesson in enumerate(lessons[first:], first):
        done = checkpoint.learner["num_timesteps"] if checkpoint is not None and number == first else 0
        drawn = run.drawn[number]
        about = "" if drawn is None else f" {start_sentence(drawn)}"
        about += " The oracle finds its ways first, in about a second for each cave." if lesson.is_taught else ""
        tell(f"{_titled(number, lessons)} from {described(lesson, done)}{about}")
        total += decisions_of(lesson, done) - done
    # disable=None: no bar where stderr is no terminal
    with tqdm(total=total, initial=run.journal.steps, unit="step", disable=None if run.show_progress else True) as bar:
        for number in range(first, len(scenarios)):
            learned = _learn(run, number, scenarios[number], learned, checkpoint, bar)
            checkpoint = None


def _titled(number: int, lessons: Sequence[TrainSettings]) -> str:
    return "Learns" if len(lessons) == 1 else f"Lesson {number + 1} of {len(lessons)} learns"


def _learn(
    run: _Run,
    number: int,
    scenarios: list[AnyScenario],
    learned: _Learned | None,
    checkpoint: Checkpoint | None,
    bar: Any,
) -> _Learned:
    """Return what has been learned after one lesson."""
    settings, journal, general = run.pipeline.lessons[number], run.journal, run.pipeline.run
    opened = open_caves(general, settings, scenarios, run.drawn[number], checkpoint, show_progress=run.show_progress)
    with opened as caves, closing(_environments(general, settings, caves)) as envs:
        if caves.rotation is not None:
            caves.scenarios.clear()
        scale = VecNormalize(envs, norm_obs=False, norm_reward=True, gamma=settings.discount)
        done = 0 if checkpoint is None else checkpoint.learner["num_timesteps"]
        learner: Any = make_learner(scale, settings, _lesson_seed(run.seed, number), done)
        if settings.is_taught:
            assert not isinstance(envs, TrainingEnvs), "checked before"
            learner.teacher = envs.advice
        if checkpoint is not None:
            restore_learner(learner, envs, scale, checkpoint.learner)
        elif learned is not None:
            inherit(learner, learned.parameters, settings)
            set_return_statistics(scale, learned.returns)
            journal.curve.begin_lesson()
            journal.steps_before = journal.steps
        elif run.initial is not None:
            begin_with(learner, run.initial)
        is_last, folder = number == len(run.pipeline.lessons) - 1, run.record.folder
        if caves.rotation is not None:
            caves.rotation.begin()
        with open_trials(general, settings, run.validation, caves.final, folder, is_last=is_last) as trials:
            callback = TrainingCallback(run.pipeline, number, run.record, journal, trials, bar, caves.rotation)
            _go_on(learner, settings.steps - learner.num_timesteps, callback)
        return _Learned(parameters_of(learner), return_statistics(scale))


def _environments(
    run: RunSettings, settings: TrainSettings, caves: LessonCaves
) -> TrainingEnvs | BatchedEnvs | MirroredEnvs:
    envs: TrainingEnvs | BatchedEnvs
    if run.backend == "batch":
        envs = BatchedEnvs(caves.scenarios, settings, caves.rotation)
    else:
        envs = TrainingEnvs(caves.scenarios, settings, run.workers, run.ray, contacts_of(run.backend))
    return MirroredEnvs(envs, settings) if settings.mirrored else envs


def _go_on(learner: BaseAlgorithm, steps: int, callback: TrainingCallback) -> None:
    """Learn for a number of decisions; what diverging makes libraries raise becomes a sentence."""
    try:
        learner.learn(steps, callback=callback, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]
    except OwnCodeError as cause:
        raise OwnCodeError(f"{cause} {callback.kept}", cause.reasons) from cause
    except (ValueError, InputError) as cause:
        try:
            callback.check()
        except Exception as diverged:
            raise diverged from cause
        raise


@contextmanager
def _writable(folder: Path) -> Iterator[None]:
    """Hold the output folder, and tell of a full disk."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as cause:
        raise InputError(f"Cannot make the output folder {folder}: {cause}. Choose another with -o.") from cause
    with locked(folder), told_when_full(folder):
        yield


def _lesson_seed(seed: int, number: int) -> int:
    """Return the seed of a lesson: the run's own for the first."""
    if number == 0:
        return seed
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
