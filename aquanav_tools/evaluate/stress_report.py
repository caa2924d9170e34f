"""The one-page report of a search for failures."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import Case, StressOptions
from aquanav_tools.evaluate.own_files import OwnFiles, names_code
from aquanav_tools.evaluate.reporting import task_words
from aquanav_tools.evaluate.statistics import Proportion, wilson
from aquanav_tools.evaluate.summary_text import fraction_text, metres, percent
from aquanav_tools.report.html import Fact, Figure, Notice, Page, Table, write_page
from aquanav_tools.report.plots import plot_cases
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import choices_of
from aquanav_tools.types import Array

NUM_PARTS = 4
"""Of each range in the table of where it fails."""
NUM_SHOWN = 20
"""Worst cases in the table."""
FAILS_ANYWAY = 0.8
"""Share of failures at random beyond which there is hardly anything to search for."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A case and how it went."""

    case: Case
    metrics: EpisodeMetrics
    danger: float
    """As `search.danger` has it: above 0 for a failure."""
    path_length: float
    """From the start to the goal, m."""

    @property
    def is_failure(self) -> bool:
        """Whether it was anything but a success without contact."""
        return self.danger > 0.0


@dataclass(frozen=True, eq=False)
class Stress:
    """What a search found."""

    policy: str
    scenario: Scenario
    own_files: OwnFiles
    """Code and ranges of the user's own, with the SHA-256 of their files."""
    drawn: tuple[Trial, ...]
    """At random."""
    searched: tuple[Trial, ...]
    """By the optimiser."""
    worst: tuple[Trial, ...]
    """The most dangerous of both, each case once."""
    report: Path


@dataclass(frozen=True)
class Axis:
    """One of the values that make a case."""

    name: str
    short: str
    """For a narrow column."""
    value: Callable[[Trial], float]


AXES = (
    Axis("shortest path from the start to the goal, m", "path, m", lambda trial: trial.path_length),
    Axis("fraction of the current", "current", lambda trial: trial.case.current),
    Axis("sensor noise, m", "noise, m", lambda trial: trial.case.sensor_noise),
)


def failure_rate(trials: Sequence[Trial]) -> Proportion:
    """Return the fraction of failures among the trials that differ to the bit, with its 95 % Wilson interval."""
    return _rate({trial.metrics.digest: trial.is_failure for trial in trials})


def miss_rate(trials: Sequence[Trial]) -> Proportion:
    """Return the fraction of trials that did not reach the goal, as `failure_rate` has it: failures at their worst."""
    return _rate({trial.metrics.digest: not trial.metrics.is_success for trial in trials})


def _rate(are_hits: dict[str, bool]) -> Proportion:
    return wilson(sum(are_hits.values()), len(are_hits))


def verdict(found: Stress) -> str:
    """Return in a few sentences what the search found."""
    drawn, searched = failure_rate(found.drawn), failure_rate(found.searched)
    failures = sum(trial.is_failure for trial in (*found.drawn, *found.searched))
    if not failures:
        return f"None of {2 * len(found.drawn)} episodes failed, neither searched nor drawn at random."
    times = f"{searched.rate / drawn.rate:.1f} times as many" if drawn.rate else "where drawing at random found none"
    return (
        f"It failed in {percent(drawn)} of {len(found.drawn)} cases drawn at random. The search, with as many "
        f"episodes, found failures in {fraction_text(searched.rate)} of its cases: {times}. It missed the goal in "
        f"{percent(miss_rate(found.drawn))} of those drawn, in {percent(miss_rate(found.searched))} of those searched."
    )


def write_stress_report(found: Stress, options: StressOptions) -> None:
    """Write the plot and the page."""
    pictures = found.report.parent / "pictures"
    pictures.mkdir(exist_ok=True)
    panels = {"drawn at random": _panel(found.drawn), "searched": _panel(found.searched)}
    names = (AXES[0].name, AXES[1].name, AXES[2].name)
    plot_cases(panels, names, pictures / "cases.png")
    caption = "A point per episode, by how it ended; a success that touched the wall counts as a collision."
    page = Page(
        title=f"What breaks {found.policy} in {found.scenario.name}",
        summary=verdict(found),
        facts=_facts(found),
        warnings=_warnings(found, options),
        figures=(Figure(pictures / "cases.png", caption),),
        tables=(_region_table(found), _worst_table(found), _repeat_table(found, options)),
        footer=f"aquanav {__version__}. Numbers for programs: stress.json. The worst cases as a protocol: worst.toml.",
    )
    write_page(page, found.report)


def _panel(trials: Sequence[Trial]) -> tuple[Array, list[str]]:
    values = np.array([[axis.value(trial) for axis in AXES] for trial in trials])
    return values, [_outcome(trial) for trial in trials]


def _outcome(trial: Trial) -> str:
    metrics = trial.metrics
    return "collision" if metrics.is_success and trial.is_failure else metrics.outcome


def _facts(found: Stress) -> tuple[Fact, ...]:
    drawn, searched = failure_rate(found.drawn), failure_rate(found.searched)
    most = found.worst[0]
    return (
        Fact("failures at random", fraction_text(drawn.rate), f"95 % interval {drawn.low:.0%} to {drawn.high:.0%}"),
        Fact(
            "failures searched",
            fraction_text(searched.rate),
            f"95 % interval {searched.low:.0%} to {searched.high:.0%}",
        ),
        Fact(
            "goal missed, at random and searched",
            f"{fraction_text(miss_rate(found.drawn).rate)}, {fraction_text(miss_rate(found.searched).rate)}",
            f"of {len(found.drawn)} episodes each",
        ),
        Fact("worst", _outcome(most), f"{most.metrics.collisions} contacts, start {most.case.start}"),
    )


def _warnings(found: Stress, options: StressOptions) -> tuple[Notice, ...]:
    notices = [
        Notice(
            "searched-rate",
            "The rate at random estimates how often the policy fails when all cases are equally likely. The rate of "
            "the search does not: it goes where failures are, and its episodes depend on each other. It says how well "
            "the search finds them.",
        )
    ]
    drawn = failure_rate(found.drawn)
    if drawn.rate > FAILS_ANYWAY:
        text = (
            f"The policy fails in {fraction_text(drawn.rate)} of cases drawn at random, so that the search has little "
            "to find but how badly. Train it further, or search where it is better: with a smaller --max-current or "
            "--max-noise, or in an easier scenario."
        )
        notices.append(Notice("fails-anyway", text))
    water = found.scenario.settings.water.current if options.current is None else options.current
    if water in ("still", 0.0):
        text = (
            "The water is still, so the fraction of the current changes nothing. Add --current half to search currents."
        )
        notices.append(Notice("still-water", text))
    return tuple(notices)


def _region_table(found: Stress) -> Table:
    rows: list[tuple[str, ...]] = []
    trials = (*found.drawn, *found.searched)
    failures = [trial for trial in trials if trial.is_failure]
    for axis in AXES:
        values = [axis.value(trial) for trial in trials]
        edges = np.linspace(min(values), max(values), NUM_PARTS + 1)
        if edges[0] == edges[-1]:
            continue
        for part in range(NUM_PARTS):
            low, high = edges[part], edges[part + 1]
            rows.append((f"{axis.short}: {low:.2f} to {high:.2f}", *_part(found, axis, low, high, part == 0)))
        if failures:
            low, high = np.percentile([axis.value(trial) for trial in failures], [5.0, 95.0])
            rows.append((f"{axis.short}: nine in ten failures", f"{low:.2f} to {high:.2f}", "", ""))
    return Table(
        "Where it fails", ("", "fails, at random", "misses the goal, at random", "fails, searched"), tuple(rows)
    )


def _part(found: Stress, axis: Axis, low: float, high: float, is_first: bool) -> tuple[str, str, str]:
    def inside(trial: Trial) -> bool:
        return low < axis.value(trial) <= high or (is_first and axis.value(trial) == low)

    drawn = [trial for trial in found.drawn if inside(trial)]
    searched = [trial for trial in found.searched if inside(trial)]
    count = f"{sum(trial.is_failure for trial in searched)} of {len(searched)}"
    if not drawn:
        return "no episode", "", count
    return percent(failure_rate(drawn)), percent(miss_rate(drawn)), count


def _worst_table(found: Stress) -> Table:
    rows = tuple(
        (
            str(number), str(trial.case.start), f"{trial.path_length:.1f}", str(trial.case.seed),
            f"{trial.case.current:g}", f"{trial.case.sensor_noise:g}", _outcome(trial), str(trial.metrics.collisions),
            f"{trial.metrics.progress:.1f}", metres(trial.metrics.min_clearance),
        )
        for number, trial in enumerate(found.worst[:NUM_SHOWN])
    )  # fmt: skip
    columns = (
        "case", "start", "path, m", "seed", "current", "noise, m", "outcome", "contacts", "progress, m",
        "min clearance, m",
    )  # fmt: skip
    return Table("The worst cases", columns, rows)


def _repeat_table(found: Stress, options: StressOptions) -> Table:
    trust = ["--trust"] if options.trust else []
    where = ["--scenario", options.scenario, *(["--vehicle", options.vehicle] if options.vehicle else [])]
    # A protocol's code runs with --trust only, whoever wrote the protocol.
    again_trust = ["--trust"] if names_code(found.own_files) else trust
    again = ["aquanav-eval", options.policy, *where, "--protocol", "worst.toml", *again_trust]
    search: list[Any] = ["aquanav-eval", "stress", options.policy, *where, *trust]
    search += ["--observation", options.observation] if options.observation else []
    for name in ("budget", "seed", "max_noise", "max_current", "seeds"):
        search += ["--" + name.replace("_", "-"), getattr(options, name)]
    search += task_words({"max_decisions": options.max_decisions, **choices_of(options)})
    rows = [
        ("run the worst cases again", shlex.join(map(str, again))),
        ("search again", shlex.join(map(str, search))),
        ("scenario, content hash", found.scenario.content_hash),
    ]
    for name, parts in found.own_files.items():
        rows += [(f"{name}, SHA-256 of {part}", sha256) for part, sha256 in parts.items()]
    return Table("To repeat it", ("", ""), tuple(rows))
