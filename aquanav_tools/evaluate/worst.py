"""The worst episodes of each condition as stills and films, with a page that has their numbers beside them.

In a benchmark a condition is a tier. Each episode is run again, and the moments before its first contact are shown, or
before its end where it touched nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from PIL import Image

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.envs.pictures.film import Frame, annotate, film
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.journal import worst_first
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import View, WorstOptions
from aquanav_tools.evaluate.policies import LoadedPolicy
from aquanav_tools.evaluate.recording import frames_of
from aquanav_tools.evaluate.replaying import Repeater
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.html import Figure, Film, Page, Section, Table, write_page
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.types import Progress, ignore_progress

FOLDER, PAGE = "worst", "worst.html"
SIZE = (400, 300)
"""Of a still and of a film's picture, px: that of films for browsers."""
AFTER = 1.5
"""What is shown after the moment that matters, s."""
MOMENTS = (1.0, 0.4, 0.15, 0.0)
"""Of the stills: fractions of `WorstOptions.seconds` before the moment that matters."""


@dataclass(frozen=True)
class Shown:
    """An episode that was run again and looked at."""

    episode: EpisodeMetrics
    still: Path
    film: Path | None
    """None where none was asked for."""
    difference: str
    """How it came out differently than in the results; empty where it is the same to the bit."""


@dataclass(frozen=True)
class Worst:
    """What was looked at, and where it lies."""

    shown: dict[str, tuple[Shown, ...]]
    """By condition."""
    page: Path


def show_worst(
    options: WorstOptions, progress: Progress = ignore_progress, load: Callable[[str], LoadedPolicy] | None = None
) -> Worst:
    """Run the worst episodes of each condition again; write a still and a film of each, and a page of all.

    Args:
        options: Which episodes, and how they are shown.
        progress: Called with (episodes shown, episodes in all).
        load: Loads the policy by its name; None takes `load_policy`.

    Raises:
        InputError: no such results, no episode failed or touched a wall, or the policy, a scenario or code of the
            user's own is missing or another one.
    """
    check_choice("view", options.view, get_args(View))
    repeater = Repeater(options, load)
    chosen = worst_of(repeater.episodes, options.worst)
    total = sum(map(len, chosen.values()))
    if not total:
        raise InputError(
            f"None of the {len(repeater.episodes)} episodes in {repeater.path} failed or touched a wall: there is "
            "nothing to look at. Evaluate where it is harder, or search for failures with aquanav-eval stress."
        )
    folder = options.output or repeater.path.with_name(FOLDER)
    folder.mkdir(parents=True, exist_ok=True)
    shown: dict[str, tuple[Shown, ...]] = {}
    progress(0, total)
    done = 0
    for condition, indices in chosen.items():
        rows: dict[int, Shown] = {}
        # Sorted, so that episodes in one scenario follow each other and it is read once.
        for index in sorted(indices):
            rows[index] = _show(repeater, index, options, folder)
            done += 1
            progress(done, total)
        shown[condition] = tuple(rows[index] for index in indices)
    page = folder / PAGE
    write_page(_page(shown, len(repeater.episodes), options.seconds), page)
    return Worst(shown, page)


def worst_of(episodes: Sequence[EpisodeMetrics], count: int) -> dict[str, list[int]]:
    """Return the numbers of so many episodes of each condition, the worst first, of those that failed or touched."""
    by_condition: dict[str, list[EpisodeMetrics]] = {}
    for episode in episodes:
        by_condition.setdefault(episode.condition, []).append(episode)
    chosen = {}
    for condition, own in by_condition.items():
        ordered = [own[place] for place in worst_first(EpisodeTable(own))]
        chosen[condition] = [one.index for one in ordered if not one.is_collision_free_success][:count]
    return chosen


def shown_rows(trajectory: Trajectory, seconds: float) -> tuple[int, int, int]:
    """Return the first state that is shown, the one that matters, and the last: first contact, or the end."""
    contacts, times = trajectory.contact_states, trajectory.times
    last = len(times) - 1
    at = int(contacts[0]) if len(contacts) else last
    first = int(np.searchsorted(times, times[at] - seconds - 1e-9))
    end = int(np.searchsorted(times, times[at] + AFTER + 1e-9, side="right")) - 1
    return first, at, min(end, last)


def _show(repeater: Repeater, index: int, options: WorstOptions, folder: Path) -> Shown:
    once = repeater.run(index)
    frames, trajectory = frames_of(once.trajectory), once.trajectory
    first, at, end = shown_rows(trajectory, options.seconds)
    name = f"{_as_name(once.episode.condition)}-{index:05d}-{_as_name(once.episode.scenario)}"
    before = trajectory.times[at] - options.seconds * np.array(MOMENTS)
    rows = np.clip(np.searchsorted(trajectory.times, before - 1e-9), first, at)
    still = folder / f"{name}.png"
    _write_still(once.scenario, trajectory, [frames[row] for row in rows], options.view, still)
    path = None
    if options.films:
        path = folder / f"{name}.webm"
        camera = adapter_of(once.scenario).camera(trajectory, options.view, SIZE)
        rate = round(1.0 / float(trajectory.times[1] - trajectory.times[0])) if len(frames) > 1 else 1
        film(camera, frames[first : end + 1], path, rate)
    return Shown(once.episode, still, path, once.difference)


def _write_still(scenario: AnyScenario, trajectory: Trajectory, frames: Sequence[Frame], view: str, path: Path) -> None:
    camera = adapter_of(scenario).camera(trajectory, view, SIZE)
    pictures = [annotate(camera.picture(frame.state, frame.time), frame) for frame in frames]
    Image.fromarray(np.concatenate(pictures, axis=1)).save(path)


def _as_name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9.]+", "-", text).strip("-") or "all"


def _page(shown: dict[str, tuple[Shown, ...]], total: int, seconds: float) -> Page:
    num = sum(map(len, shown.values()))
    moments = ", ".join(f"{seconds * fraction:.1f}" for fraction in MOMENTS)
    return Page(
        title="The worst episodes",
        summary=(
            f"{num} of {total} episodes: failures first, then those with most collisions. Each still shows the vehicle "
            f"{moments} s before its first contact with the wall, or before the end where it touched nothing."
        ),
        sections=tuple(_section(condition, rows) for condition, rows in shown.items() if rows),
    )


def _section(condition: str, rows: Sequence[Shown]) -> Section:
    columns = ("episode", "scenario", "outcome", "collisions", "progress, m", "time, s", "repeats")
    lines = tuple(
        (
            str(row.episode.index), row.episode.scenario, row.episode.outcome, str(row.episode.collisions),
            f"{row.episode.progress:.1f}", f"{row.episode.time:.1f}", row.difference or "to the bit",
        )
        for row in rows
    )  # fmt: skip
    captions = [f"Episode {row.episode.index} in {row.episode.scenario}: {row.episode.outcome}." for row in rows]
    figures = tuple(Figure(row.still, caption) for row, caption in zip(rows, captions, strict=True))
    films = tuple(Film(row.film, caption) for row, caption in zip(rows, captions, strict=True) if row.film)
    return Section(f"The worst of {condition}", figures=figures, films=films, tables=(Table("", columns, lines),))
