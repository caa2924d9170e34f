"""Runs of each variant by later code, held against those that a study has kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import mannwhitneyu, t

from aquanav_tools.types import Array
from eval.study.page import RATES, SAFETY, Runs, kept_variants, of, scores
from eval.study.studies import Question, Study

LEVEL = 0.95
TEXT = """Runs with seeds from 0, as many as the table says, trained and scored by later code (`run.py {name} --again`):
one of each variant, and more (`--seeds`) of those whose first one had a figure outside.
[study-{name}-again.jsonl](study-{name}-again.jsonl) has their versions and hashes. Figures are means over these runs.
In brackets the {level:.0%} interval for the mean of so many more runs, from the n kept ones:
mean -+ t s sqrt(1/m + 1/n), and not less than an episode of {episodes}, or 5 mm. What is outside is in bold. One in
twenty would be by chance if runs were normal; they are not, as some variants fail in one run of ten: below the table
are all runs of such a figure, with a test that takes none to be normal. Success is the mean over places and
currents."""


def section(name: str, study: Study, runs: Runs, again: Runs) -> list[str]:
    """Return the part of the page on runs that were done again; nothing where none was."""
    if not again or not runs:
        return []
    variants = [variant for variant in kept_variants(study, runs) if of(again, variant)]
    places = [place for place in study.places if all(place in run["scores"] for run in (*runs, *again))]
    lines = ["## Run again", "", *TEXT.format(name=name, level=LEVEL, episodes=study.episodes).splitlines(), ""]
    lines += [
        "| | runs | " + " | ".join(headlines(study)) + " | within, of all places and currents |",
        "|---|---|---|---|---|---|---|",
    ]
    within = total = 0
    for variant in variants:
        cells = [headline(study, of(runs, variant), of(again, variant), metric, places) for metric in (*RATES, *SAFETY)]
        inside = [is_within(*pair) for pair in _columns(study, runs, again, variant, places)]
        within, total = within + sum(inside), total + len(inside)
        num_again = len(of(again, variant))
        lines.append(f"| {variant} | {num_again} | {' | '.join(cells)} | {sum(inside)} of {len(inside)} |")
    lines += ["", f"Within: {within} of {total}.", ""]
    lines += [line for variant in variants for line in _outside(study, of(runs, variant), of(again, variant), places)]
    missing = [variant for variant in kept_variants(study, runs) if variant not in variants]
    if missing:
        lines += [f"Not run again: {', '.join(missing)}.", ""]
    asked = [question for question in study.questions if {question.first, question.second} <= set(variants)]
    return lines + [line for question in asked for line in _directions(study, runs, again, question, places)]


def headlines(study: Study) -> list[str]:
    """Return what the four figures of a variant are, as a table's header."""
    return [*RATES.values(), *(f"{title}, {study.safety_place}" for title in SAFETY.values())]


def finest(study: Study, metric: str) -> float:
    """Return what one episode changes of a metric, or of the distance what is not worth telling."""
    return 0.005 if metric == "mean_clearance" else 1.0 / study.episodes


def interval(values: Array, step: float, more: int = 1) -> tuple[float, float]:
    """Return where the mean of more runs would lie by (N,) of a normal distribution, at least a step around their mean.

    The interval of Student's t for the difference of two means, with the spread of the N runs for both.
    """
    reach = t.ppf(0.5 + LEVEL / 2, len(values) - 1) * values.std(ddof=1) * np.sqrt(1 / more + 1 / len(values))
    reach = max(float(reach), step)
    return float(values.mean()) - reach, float(values.mean()) + reach


def is_within(values: Array, again: Array, step: float) -> bool:
    """Return whether the mean of (M,) runs lies where it would by (N,) others."""
    low, high = interval(values, step, len(again))
    return bool(low - 1e-9 <= again.mean() <= high + 1e-9)


def headline(study: Study, kept: Runs, again: Runs, metric: str, places: Sequence[str]) -> str:
    """Return a figure of a variant's new runs and the interval by those that are kept, as a cell."""
    values, new, step = _figure(study, kept, again, metric, places)
    low, high = interval(values, step, len(new))
    if metric in RATES:
        text, bounds = f"{100 * new.mean():.0f} %", f"[{max(0.0, 100 * low):.0f}, {min(100.0, 100 * high):.0f}]"
    else:
        text, bounds = f"{new.mean():.2f}", f"[{max(0.0, low):.2f}, {high:.2f}]"
    return f"{text} {bounds}" if is_within(values, new, step) else f"**{text}** {bounds}"


def _outside(study: Study, kept: Runs, again: Runs, places: Sequence[str]) -> list[str]:
    """Return a sentence for each figure of a variant that is outside: its runs, and a test that asks their order."""
    lines = []
    for metric, title in zip((*RATES, *SAFETY), headlines(study), strict=True):
        values, new, step = _figure(study, kept, again, metric, places)
        if is_within(values, new, step):
            continue
        each, before = (", ".join(f"{value:.2f}" for value in sorted(some)) for some in (new, values))
        test = f"Mann-Whitney's p is {mannwhitneyu(new, values).pvalue:.2f}"
        lines += [f"Outside, of {kept[0]['variant']}, {title}: runs now {each}, before {before}; {test}.", ""]
    return lines


def _figure(study: Study, kept: Runs, again: Runs, metric: str, places: Sequence[str]) -> tuple[Array, Array, float]:
    """Return a headline figure of (N,) runs and of (M,) new ones, and the finest step that an episode makes in it."""
    where = places if metric in RATES else (study.safety_place,)
    variant = kept[0]["variant"]
    values, new = (scores(study, runs, variant, metric, where).mean(axis=1) for runs in (kept, again))
    return values, new, finest(study, metric)


def _columns(
    study: Study, runs: Runs, again: Runs, variant: str, places: Sequence[str]
) -> list[tuple[Array, Array, float]]:
    """Return for each metric, place and current the (N,) kept runs, the (M,) new ones, and the step of an episode."""
    found = []
    for metric in (*RATES, *SAFETY):
        kept, new = (scores(study, some, variant, metric, places) for some in (runs, again))
        found += [(*columns, finest(study, metric)) for columns in zip(kept.T, new.T, strict=True)]
    return found


def _directions(study: Study, runs: Runs, again: Runs, question: Question, places: Sequence[str]) -> list[str]:
    """Return a sentence on which of two variants did better, by the kept runs' means and by the new ones."""
    said: dict[str, list[str]] = {"the same as before by": [], "the other by": [], "neither by": []}
    same, other, neither = said.values()
    for metric, title in {**RATES, **SAFETY}.items():
        pairs = [
            _figure(study, of(runs, variant), of(again, variant), metric, places)
            for variant in (question.first, question.second)
        ]
        (before, now), (before_second, now_second) = ((old.mean(), new.mean()) for old, new, _ in pairs)
        before, now = before - before_second, now - now_second
        (neither if now == 0.0 else same if before * now > 0.0 else other).append(title.split(",")[0])
    text = "; ".join(f"{start} {', '.join(titles)}" for start, titles in said.items() if titles)
    return [f"**{question.title}.** Which has the more: {text}.", ""]
