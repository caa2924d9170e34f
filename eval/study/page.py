"""The study as a page: questions with their answers, every policy in every cave, and plots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.evaluate.paired import probability_of_improvement
from aquanav_tools.evaluate.statistics import Estimate, stratified_iqm
from aquanav_tools.report.figures import BAD, BLUE, GOOD, IDLE, INK, MUTED, new_figure, save_figure
from aquanav_tools.types import Array
from eval.study.variants import CAVES, CURRENTS, QUESTIONS, VARIANTS, Question

Runs = list[dict[str, Any]]

COLOURS = dict(zip(VARIANTS, (BLUE, BAD, "#8338ec", IDLE, MUTED, GOOD), strict=True))
DPI = 110
CAVE_OF_SAFETY = "cave-test-3"
"""Where the paper compares the safe reward."""
TITLES = {"collision_free": "Collision-free success", "success": "Success"}
SAFETY = {"collisions": "collisions per episode", "mean_clearance": "mean distance to the wall, m"}
INTRODUCTION = """# The paper's questions

`python eval/study/run.py`. Pipelines as shipped (`paper`, `paper-end-to-end`, `paper-clip-01`, `paper-clip-02`,
`paper-sparse`, `paper-safe`: 3 million decisions each), learned on the batch with 512 vehicles; the last policy of each
run counts. Each is scored in {episodes} episodes per cave and current on the batch, acting without chance; a contact
ends no episode. "han" is the scan of Han-sur-Lesse, as aquanav-build-cave closes it.
Numbers of every run, with versions and hashes: [study.jsonl](study.jsonl). Runs, with seeds from 0:
{counts}.

IQM: interquartile mean over runs, caves and currents, with 95 % intervals from a bootstrap stratified by cave and
current (rliable's definitions). P: probability that a run of the first is better than one of the second, mean over
caves and currents.
"""


def write_page(runs: Runs, folder: Path) -> None:
    """Write study.md and its plots; nothing without runs."""
    if not runs:
        return
    folder.joinpath("study.md").write_text(markdown(runs), encoding="utf-8")
    draw_curves(runs, folder / "study-curves.png")
    draw_scores(runs, folder / "study-scores.png")


def markdown(runs: Runs) -> str:
    """Return the page."""
    kept = [name for name in VARIANTS if of(runs, name)]
    counts = ", ".join(f"{name} {len(of(runs, name))}" for name in kept)
    episodes = next(iter(runs[0]["scores"].values()))["full"]["episodes"]
    lines = [INTRODUCTION.format(episodes=episodes, counts=counts), "## Answers", ""]
    for question in QUESTIONS:
        if {question.first, question.second} <= set(kept):
            lines += [f"**{question.title}.** The paper: {question.claim}.", "", *answer(runs, question), ""]
    lines += ["![Learning curves](study-curves.png)", "", "![Scores](study-scores.png)", ""]
    lines += ["Below, means over runs with standard deviations; shares in percent.", ""]
    for metric, title in {**TITLES, **SAFETY}.items():
        lines += [f"## {title.capitalize()}", "", *table(runs, metric), ""]
    return "\n".join(lines).rstrip() + "\n"


def of(runs: Runs, variant: str) -> Runs:
    """Return the runs of a variant."""
    return [run for run in runs if run["variant"] == variant]


def scores(runs: Runs, variant: str, metric: str, caves: Sequence[str] = CAVES) -> Array:
    """Return a metric as (runs, tasks): caves that all runs have, each in all currents."""
    mine = of(runs, variant)
    common = [cave for cave in caves if all(cave in run["scores"] for run in runs)]
    return np.array([[run["scores"][cave][current][metric] for cave in common for current in CURRENTS] for run in mine])


def answer(runs: Runs, question: Question) -> list[str]:
    """Return what the runs say to a question, as a table."""
    pair = (question.first, question.second)
    rows = ["| | " + " | ".join(pair) + " | P |", "|---|---|---|---|"]
    for metric, title in TITLES.items():
        values = [scores(runs, name, metric) for name in pair]
        shown = [percent(stratified_iqm(value)) for value in values]
        rows.append(f"| {title.lower()}, IQM | {' | '.join(shown)} | {improvement(*values):.2f} |")
    for metric, title in SAFETY.items():
        values = [scores(runs, name, metric, (CAVE_OF_SAFETY,)) for name in pair]
        shown = [f"{value.mean():.2f} ± {spread(value.mean(axis=1)):.2f}" for value in values]
        better = improvement(*values) if metric != "collisions" else improvement(*(-value for value in values))
        rows.append(f"| {title}, {CAVE_OF_SAFETY} | {' | '.join(shown)} | {better:.2f} |")
    return rows


def improvement(first: Array, second: Array) -> float:
    """Return the probability that a run of the first has the larger value, mean over tasks."""
    return float(np.mean([probability_of_improvement(a, b) for a, b in zip(first.T, second.T, strict=True)]))


def percent(estimate: Estimate) -> str:
    """Return a share and its interval in percent."""
    return f"{estimate.mean:.0%} [{estimate.low:.0%}, {estimate.high:.0%}]"


def spread(values: Array) -> float:
    """Return the standard deviation over runs; that of one run is 0."""
    return float(values.std(ddof=1)) if len(values) > 1 else 0.0


def table(runs: Runs, metric: str) -> list[str]:
    """Return a metric of all variants by cave and current, as markdown."""
    caves = [cave for cave in CAVES if all(cave in run["scores"] for run in runs)]
    rows = ["| cave | current | " + " | ".join(VARIANTS) + " |", "|---|---|" + "---|" * len(VARIANTS)]
    for cave in caves:
        for column, current in enumerate(CURRENTS):
            cells = []
            for name in VARIANTS:
                mine = scores(runs, name, metric, (cave,)) if of(runs, name) else np.empty((0, len(CURRENTS)))
                cells.append(cell(mine[:, column], metric))
            rows.append(f"| {cave} | {current} | {' | '.join(cells)} |")
    return rows


def cell(values: Array, metric: str) -> str:
    """Return the mean of runs with its spread; nothing where there are none."""
    if not len(values):
        return ""
    if metric in TITLES:
        return f"{100.0 * values.mean():.0f} ± {100.0 * spread(values):.0f}"
    return f"{values.mean():.2f} ± {spread(values):.2f}"


def draw_curves(runs: Runs, path: Path) -> None:
    """Draw the learning curves: mean over runs, and from the least to the most of them."""
    figure = new_figure(11.0, 4.2)
    for place, (column, title) in enumerate(((1, "Success"), (2, "Collision-free success")), 1):
        axes = figure.add_subplot(1, 2, place)
        for name in VARIANTS:
            if mine := [run for run in of(runs, name) if run["curve"]]:  # empty where no episode came to an end
                steps, values = curves(mine, column)
                axes.plot(steps / 1e6, 100.0 * values.mean(axis=0), color=COLOURS[name], label=name, linewidth=1.8)
                low, high = 100.0 * values.min(axis=0), 100.0 * values.max(axis=0)
                axes.fill_between(steps / 1e6, low, high, color=COLOURS[name], alpha=0.12, linewidth=0.0)
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


def draw_scores(runs: Runs, path: Path) -> None:
    """Draw collision-free success in every cave and current: mean over runs, and each run as a dot."""
    caves = [cave for cave in CAVES if all(cave in run["scores"] for run in runs)]
    names = [name for name in VARIANTS if of(runs, name)]
    figure = new_figure(11.0, 2.3 * len(caves))
    for row, cave in enumerate(caves):
        axes = figure.add_subplot(len(caves), 1, row + 1)
        for number, name in enumerate(names):
            values = 100.0 * scores(runs, name, "collision_free", (cave,))
            centres = np.arange(len(CURRENTS)) + (number - (len(names) - 1) / 2.0) * 0.8 / len(names)
            axes.bar(centres, values.mean(axis=0), 0.72 / len(names), color=COLOURS[name], alpha=0.55, label=name)
            for centre, dots in zip(centres, values.T, strict=True):
                axes.plot(np.full(len(dots), centre), dots, ".", color=INK, markersize=3.5)
        axes.set(title=cave, ylim=(0.0, 103.0), ylabel="Collision-free, %")
        axes.set_xticks(range(len(CURRENTS)), [f"{current} current" for current in CURRENTS])
        axes.spines[["top", "right"]].set_visible(False)
        axes.title.set_fontsize(10)
    figure.axes[0].legend(frameon=False, ncols=len(names), loc="lower center", bbox_to_anchor=(0.5, 1.1), fontsize=9)
    figure.tight_layout()
    save_figure(figure, path, DPI)
