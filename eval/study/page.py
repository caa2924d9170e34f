"""A study as a page: questions with their answers, every variant in every place, and plots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.evaluate.paired import probability_of_improvement
from aquanav_tools.evaluate.statistics import BOOTSTRAP_SEED, Estimate, stratified_iqm
from aquanav_tools.report.figures import BAD, BLUE, GOOD, IDLE, INK, MUTED, new_figure, save_figure
from aquanav_tools.types import Array
from eval.study.studies import AS_GIVEN, Question, Study

Runs = list[dict[str, Any]]

COLOURS = {
    "curriculum": BLUE,
    "end-to-end": BAD,
    "clip-0.1": "#8338ec",
    "clip-0.2": IDLE,
    "sparse": MUTED,
    "careful": "#d6336c",
    "standard": "#d6336c",
    "31-values": "#9c6b30",
    "safe": GOOD,
}
DPI = 110
RESAMPLES = 2000
MIN_RUNS = 3
"""Of a variant; fewer say nothing of how runs differ."""
RATES = {"collision_free_success": "collision-free success", "success": "success"}
SAFETY = {"collisions": "collisions per episode", "mean_clearance": "mean distance to walls, m"}
HEADER = """# {title}

`python eval/study/run.py {name}`.
{method}

Runs, with seeds from 0: {counts}. Numbers, versions and hashes of each:
[study-{name}.jsonl](study-{name}.jsonl).
IQM: interquartile mean over runs and everything flown. P: probability that a run of the first is better than one of the
second, mean over places and currents. Both with 95 % intervals from a bootstrap over runs, stratified by place and
current (rliable's definitions). A conclusion holds by a measure where P's interval lies above a half; below it, the
contrary does.
"""


def write_page(name: str, study: Study, runs: Runs, last: Sequence[str], folder: Path) -> None:
    """Write study-NAME.md, with `last` as its last lines, and its plots; nothing without runs."""
    if not runs:
        return
    text = "\n".join([markdown(name, study, runs), *last]).rstrip() + "\n"
    folder.joinpath(f"study-{name}.md").write_text(text, encoding="utf-8")
    draw_curves(study, runs, folder / f"study-{name}-curves.png")
    draw_scores(study, runs, folder / f"study-{name}-scores.png")


def markdown(name: str, study: Study, runs: Runs) -> str:
    """Return the page."""
    kept = kept_variants(study, runs)
    counts = ", ".join(f"{variant} {len(of(runs, variant))}" for variant in kept)
    lines = [HEADER.format(title=study.title, name=name, method=study.method, counts=counts), "## Answers", ""]
    for question in study.questions:
        if {question.first, question.second} <= set(kept):
            lines += [f"**{question.title}.** {question.source}: {question.claim}.", ""]
            lines += [*answer(study, runs, question), ""]
    lines += [f"![Learning curves](study-{name}-curves.png)", "", f"![Scores](study-{name}-scores.png)", ""]
    lines += ["Below, means over runs with standard deviations; shares in percent.", ""]
    for metric, title in {**RATES, **SAFETY}.items():
        lines += [f"## {title.capitalize()}", "", *table(study, runs, metric), ""]
    return "\n".join(lines).rstrip() + "\n"


def of(runs: Runs, variant: str) -> Runs:
    """Return the runs of a variant."""
    return [run for run in runs if run["variant"] == variant]


def kept_variants(study: Study, runs: Runs) -> list[str]:
    """Return the variants that have runs."""
    return [variant for variant in study.variants if of(runs, variant)]


def common_places(study: Study, runs: Runs) -> list[str]:
    """Return the places in which all runs were scored."""
    return [place for place in study.places if all(place in run["scores"] for run in runs)]


def scores(study: Study, runs: Runs, variant: str, metric: str, places: Sequence[str]) -> Array:
    """Return a metric of a variant as (runs, places x currents)."""
    columns = [(place, current) for place in places for current in study.currents]
    return np.array([[run["scores"][p][c][metric] for p, c in columns] for run in of(runs, variant)])


def answer(study: Study, runs: Runs, question: Question) -> list[str]:
    """Return what the runs say to a question, as a table and a sentence."""
    pair, places = (question.first, question.second), common_places(study, runs)
    rows = ["| | " + " | ".join(pair) + " | P |", "|---|---|---|---|"]
    measures = {}
    for metric, title in RATES.items():
        values = [scores(study, runs, variant, metric, places) for variant in pair]
        shown = [percent(stratified_iqm(value)) for value in values]
        measures[title] = better = improvement(*values)
        rows.append(f"| {title}, IQM | {' | '.join(shown)} | {chance(better)} |")
    for metric, title in SAFETY.items():
        values = [scores(study, runs, variant, metric, (study.safety_place,)) for variant in pair]
        shown = [f"{value.mean():.2f} ± {spread(value.mean(axis=1)):.2f}" for value in values]
        measures[title.split(",")[0]] = better = improvement(
            *(-value for value in values) if metric == "collisions" else values
        )
        rows.append(f"| {title}, {study.safety_place} | {' | '.join(shown)} | {chance(better)} |")
    few = [variant for variant in pair if len(of(runs, variant)) < MIN_RUNS]
    answer = f"Nothing is concluded from fewer than {MIN_RUNS} runs: {', '.join(few)}." if few else verdict(measures)
    return [*rows, "", answer]


def verdict(measures: dict[str, Estimate]) -> str:
    """Return by which measures a conclusion holds, given the first's probability of being better by each."""
    said: dict[str, list[str]] = {"It holds here by": [], "The contrary holds by": [], "Nothing is shown by": []}
    holds, contrary, nothing = said.values()
    for title, better in measures.items():
        (holds if better.low > 0.5 else contrary if better.high < 0.5 else nothing).append(title)
    return " ".join(f"{text} {', '.join(titles)}." for text, titles in said.items() if titles)


def improvement(first: Array, second: Array) -> Estimate:
    """Return the probability that a run of the first has the larger value, mean over columns of (runs, columns)."""
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    columns = np.arange(first.shape[1])

    def resampled(values: Array) -> Array:
        drawn: Array = values[rng.integers(len(values), size=values.shape), columns]
        return drawn

    drawn = [_mean_improvement(resampled(first), resampled(second)) for _ in range(RESAMPLES)]
    low, high = np.percentile(drawn, [2.5, 97.5])
    return Estimate(_mean_improvement(first, second), float(low), float(high))


def _mean_improvement(first: Array, second: Array) -> float:
    return float(np.mean([probability_of_improvement(a, b) for a, b in zip(first.T, second.T, strict=True)]))


def chance(estimate: Estimate) -> str:
    """Return a probability and its interval."""
    return f"{estimate.mean:.2f} [{estimate.low:.2f}, {estimate.high:.2f}]"


def percent(estimate: Estimate) -> str:
    """Return a share and its interval in percent."""
    return f"{100 * estimate.mean:.0f} % [{100 * estimate.low:.0f}, {100 * estimate.high:.0f}]"


def spread(values: Array) -> float:
    """Return the standard deviation over runs; that of one run is 0."""
    return float(values.std(ddof=1)) if len(values) > 1 else 0.0


def table(study: Study, runs: Runs, metric: str) -> list[str]:
    """Return a metric of all variants by place and current, as markdown."""
    kept = kept_variants(study, runs)
    rows = ["| | " + " | ".join(kept) + " |", "|---|" + "---|" * len(kept)]
    for place in common_places(study, runs):
        values = [scores(study, runs, variant, metric, (place,)) for variant in kept]
        for column, current in enumerate(study.currents):
            name = place if current == AS_GIVEN else f"{place}, {current}"
            rows.append(f"| {name} | {' | '.join(cell(value[:, column], metric) for value in values)} |")
    return rows


def cell(values: Array, metric: str) -> str:
    """Return the mean of runs with its spread."""
    if metric in RATES:
        return f"{100 * values.mean():.0f} ± {100 * spread(values):.0f}"
    return f"{values.mean():.2f} ± {spread(values):.2f}"


def draw_curves(study: Study, runs: Runs, path: Path) -> None:
    """Draw the learning curves: mean over runs, and from the least to the most of them."""
    figure = new_figure(11.0, 4.2)
    for place, (column, title) in enumerate(((1, "Success"), (2, "Collision-free success")), 1):
        axes = figure.add_subplot(1, 2, place)
        for variant in study.variants:
            colour = COLOURS[variant]
            mine = [run for run in of(runs, variant) if run["curve"]]  # empty where no episode came to an end
            if mine:
                steps, values = curves(mine, column)
                axes.plot(steps / 1e6, 100.0 * values.mean(axis=0), color=colour, label=variant, linewidth=1.8)
                low, high = 100.0 * values.min(axis=0), 100.0 * values.max(axis=0)
                axes.fill_between(steps / 1e6, low, high, color=colour, alpha=0.12, linewidth=0.0)
        axes.set(title=f"{title} while learning", xlabel="Decisions, millions", ylim=(-3.0, 103.0))
        axes.set_ylabel("Of the last 100 episodes, %")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize=9)
    figure.tight_layout()
    save_figure(figure, path, DPI)


def curves(runs: Runs, column: int) -> tuple[Array, Array]:
    """Return decisions, and (runs, points) values at them."""
    first = max(run["curve"][0][0] for run in runs)
    last = min(run["curve"][-1][0] for run in runs)
    steps = np.linspace(first, last, 60)
    points = [np.array(run["curve"]) for run in runs]
    return steps, np.array([np.interp(steps, point[:, 0], point[:, column]) for point in points])


def draw_scores(study: Study, runs: Runs, path: Path) -> None:
    """Draw collision-free success and collisions everywhere: mean over runs, and each run as a dot."""
    places, kept = common_places(study, runs), kept_variants(study, runs)
    groups = [(place, current) for place in places for current in study.currents]
    if len(study.currents) == 1:
        rows = [groups]
    else:
        rows = [[group for group in groups if group[0] == place] for place in places]
    figure = new_figure(13.0, 2.3 * max(len(rows), 1.6))
    for number, row in enumerate(rows):
        shares = figure.add_subplot(len(rows), 2, 2 * number + 1)
        draw_bars(shares, runs, kept, row, lambda score: 100.0 * score["collision_free_success"])
        shares.set(ylim=(0.0, 103.0), ylabel="Collision-free, %")
        counts = figure.add_subplot(len(rows), 2, 2 * number + 2)
        draw_bars(counts, runs, kept, row, lambda score: score["collisions"])
        counts.set(ylim=(0.0, None), ylabel="Collisions per episode")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.3 / figure.get_figheight()))
    figure.legend(handles, labels, frameon=False, ncols=len(kept), loc="upper center", fontsize=9)
    save_figure(figure, path, DPI)


def draw_bars(
    axes: Any, runs: Runs, kept: Sequence[str], row: Sequence[tuple[str, str]], measure: Callable[[Any], float]
) -> None:
    """Draw a group of bars for each place and current in `row`, a bar for each variant."""
    for turn, variant in enumerate(kept):
        values = np.array(
            [[measure(run["scores"][place][current]) for place, current in row] for run in of(runs, variant)]
        )
        centres = np.arange(len(row)) + (turn - (len(kept) - 1) / 2.0) * 0.8 / len(kept)
        axes.bar(centres, values.mean(axis=0), 0.72 / len(kept), color=COLOURS[variant], alpha=0.55, label=variant)
        for centre, dots in zip(centres, values.T, strict=True):
            axes.plot(np.full(len(dots), centre), dots, ".", color=INK, markersize=3.5)
    axes.set_xticks(range(len(row)), [p if c == AS_GIVEN else f"{p}, {c}" for p, c in row])
    axes.spines[["top", "right"]].set_visible(False)
