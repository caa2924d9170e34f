"""Report on a finished run, its recording, and the policy in other forms."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from aquanav_tools import __version__
from aquanav_tools.errors import InputError
from aquanav_tools.policy.run_folder import best_policy
from aquanav_tools.report.html import Fact, Figure, Notice, Page, Table, write_page
from aquanav_tools.report.learning_plot import Learning, plot_learning
from aquanav_tools.report.recording.learning import record_learning
from aquanav_tools.report.recording.stream import NO_RECORDING, lack_of_recorder
from aquanav_tools.train.cave_rotation import FLOWN, TAKING, WAITING
from aquanav_tools.train.episodes import CurvePoint
from aquanav_tools.train.export import export
from aquanav_tools.train.journal import TRIAL_TAGS, RunJournal
from aquanav_tools.train.learners import class_of
from aquanav_tools.train.pipeline import Pipeline

REPORT_FILE, RECORDING_FILE = "report.html", "curve.rrd"
COLUMNS = ("lesson", "scenario", "water", "decisions", "learning rate", "clip", "reward", "success", "collision-free")


def write_artifacts(folder: Path, pipeline: Pipeline, journal: RunJournal) -> None:
    """Write the policy as ONNX and TorchScript, the recording, and last the report."""
    notices = list(_export(folder, pipeline))
    if lack := lack_of_recorder():
        notices.append(Notice(NO_RECORDING, f"There is no {RECORDING_FILE}. {lack}"))
    else:
        record_learning(_series(journal), str(folder.resolve()), folder / RECORDING_FILE)
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    plot_learning(_learning(journal), pictures / "learning.png")
    point, best, final = journal.curve.points[-1], journal.best, journal.final
    facts = [
        Fact("decisions", f"{point.steps:,}", f"{point.episodes:,} episodes"),
        Fact(
            "wall time", f"{point.seconds / 60:.0f} min", f"{point.steps / max(point.seconds, 1e-9):,.0f} decisions/s"
        ),
    ]
    if final is not None:
        about = f"of the last policy, in {final.episodes} whole episodes of the last lesson"
        facts.insert(1, Fact("collision-free success", f"{final.collision_free_success:.0%}", about))
    if best is not None:
        facts.insert(
            1, Fact("best in validation", f"{best.collision_free_success:.0%}", f"after {best.steps:,} decisions")
        )
    facts += _cave_facts(point)
    caves = dict.fromkeys(name for lesson in pipeline.lessons for name in lesson.all_scenarios)
    page = Page(
        title=f"Training in {' and '.join(caves)}",
        summary=f"{pipeline.lessons[0].algorithm} learned from {point.steps:,} decisions.",
        facts=tuple(facts),
        warnings=(*notices, *([Notice("cut-short", point.caveat)] if point.caveat else ())),
        figures=(Figure(pictures / "learning.png", "The last 100 episodes; dotted where a lesson ends."),),
        tables=(_lessons(pipeline, journal.curve.points),),
        footer=f"aquanav {__version__}. Numbers for programs: train.json, curve.csv, validation.csv.",
    )
    write_page(page, folder / REPORT_FILE)


def _cave_facts(point: CurvePoint) -> list[Fact]:
    """Return what drawn caves cost; nothing where there are none."""
    learner = point.learner
    if WAITING not in learner:
        return []
    about = f"of the last lesson, for drawn caves; {learner[TAKING]:.2%} on taking them in"
    return [
        Fact("waiting time", f"{learner[WAITING]:.2%}", about),
        Fact("caves", f"{learner[FLOWN]:.0f}", "drawn so far"),
    ]


def _export(folder: Path, pipeline: Pipeline) -> tuple[Notice, ...]:
    """Export the best policy, or the last where none was tried; return what the reader should know of it."""
    path = best_policy(folder)
    try:
        export(class_of(pipeline.lessons[0].algorithm).load(path, device="cpu"), folder)
    except InputError as error:
        return (Notice("not-exported", f"There is no policy.onnx and no policy.pt. {error}"),)
    return ()


def _learning(journal: RunJournal) -> Learning:
    points = journal.curve.points
    return Learning(
        reward=[(point.steps, point.mean_reward) for point in points],
        success=[(point.steps, point.success_rate) for point in points],
        collision_free_success=[(point.steps, point.collision_free_success) for point in points],
        validation=[(trial.steps, trial.collision_free_success) for trial in journal.trials],
        lesson_ends=[one.steps for one, two in pairwise(points) if two.lesson != one.lesson],
    )


def _series(journal: RunJournal) -> dict[str, list[tuple[int, float]]]:
    """Return every curve by its name, without nan."""
    series: dict[str, list[tuple[int, float]]] = {}
    for point in journal.curve.points:
        for name, value in point.row.items():
            if name != "steps" and value == value:
                series.setdefault(name if "/" in name else f"rollout/{name}", []).append((point.steps, float(value)))
    for trial in journal.trials:
        for name in TRIAL_TAGS:
            series.setdefault(f"validation/{name}", []).append((trial.steps, getattr(trial, name)))
    return series


def _lessons(pipeline: Pipeline, points: Sequence[CurvePoint]) -> Table:
    rows = []
    for number, lesson in enumerate(pipeline.lessons, 1):
        last = [point for point in points if point.lesson == number][-1]
        water = "its own" if lesson.current is None else str(lesson.current)
        rates = (f"{last.success_rate:.0%}", f"{last.collision_free_success:.0%}")
        numbers = (f"{lesson.steps:,}", f"{lesson.learning_rate:g}", f"{lesson.clip:g}")
        rows.append((str(number), ", ".join(lesson.all_scenarios), water, *numbers, lesson.reward, *rates))
    return Table("Lessons, with the rates of their last episodes", COLUMNS, tuple(rows))
