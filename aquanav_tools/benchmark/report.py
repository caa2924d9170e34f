"""What a benchmark's run looks like: lines for the terminal, and a page of the tiers, the caves and the worst dives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.benchmark.definition import Benchmark
from aquanav_tools.benchmark.score import CaveScore, Score, TierScore
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.journal import worst_first
from aquanav_tools.evaluate.statistics import Estimate
from aquanav_tools.evaluate.summary_text import estimate_text, fraction_text, metres
from aquanav_tools.report.figures import BAD, BLUE, GOOD, IDLE, INK, MUTED, PORTAL, new_figure, save_figure
from aquanav_tools.report.html import Fact, Figure, Notice, Page, Section, Table, write_page

NUM_WORST = 10
"""Dives of each tier that the page names."""
COLUMNS = (
    "", "caves", "collision-free success, mean", "interquartile mean", "worst cave", "success", "SPL",
    "collisions per 100 m", "clearance, mean, m", "time, s",
)  # fmt: skip
PLOT = "tiers.png"
COLOURS = (BLUE, GOOD, IDLE, BAD, PORTAL, MUTED)


def points(estimate: Estimate) -> str:
    """Return a rate in per cent with its interval, to a tenth: there are thousands of dives."""
    return f"{100 * estimate.mean:.1f} % [{100 * estimate.low:.1f}, {100 * estimate.high:.1f}]"


def tier_row(tier: TierScore) -> tuple[str, ...]:
    """Return the texts of a tier under COLUMNS."""
    means = tier.means
    return (
        tier.name, str(tier.caves), points(tier.mean), points(tier.iqm), fraction_text(tier.worst),
        fraction_text(means["success"]), f"{means['spl']:.2f}", estimate_text(tier.collisions_per_100m),
        metres(means["mean_clearance"]), f"{means['time']:.0f}",
    )  # fmt: skip


def score_text(benchmark: Benchmark, policy: str, score: Score) -> str:
    """Return the score for the terminal."""
    total = score.total
    lines = [
        f"{policy} in {benchmark.name}: {total.caves} caves, {benchmark.episodes} dives in each, 95 % intervals over "
        "caves in brackets",
        f"  collision-free success, mean                 {points(total.mean)}",
        f"  collision-free success, interquartile mean   {points(total.iqm)}",
    ]
    for tier in score.tiers:
        means, mean = tier.means, points(tier.mean)
        lines.append(
            f"  {tier.name:<11} {tier.caves:>3} caves  {mean:<24} worst cave {fraction_text(tier.worst):>5}"
            f"   success {fraction_text(means['success']):>5}   SPL {means['spl']:.2f}   collisions per 100 m "
            f"{tier.collisions_per_100m.mean:.2f}   clearance {metres(means['mean_clearance'])} m"
            f"   {means['time']:.0f} s"
        )
    return "\n".join(lines)


def changed_text(changed: Sequence[str]) -> str:
    """Return what is said of caves that are not those of the published set; empty where all are."""
    if not changed:
        return ""
    some = f"{', '.join(changed[:3])}{' and others' if len(changed) > 3 else ''}"
    return (
        f"{len(changed)} caves are not to the millimetre those of the published set ({some}): this machine's libraries "
        "build them otherwise. Scores are only comparable where all are the same; install the versions in "
        "constraints.txt."
    )


def write_report(
    benchmark: Benchmark, policy: str, score: Score, episodes: EpisodeTable, changed: Sequence[str], path: Path
) -> Path:
    """Write the page and the plot beside it; return the page's path."""
    plot = path.with_name(PLOT)
    plot_tiers({policy: score}, plot)
    total, text = score.total, changed_text(changed)
    page = Page(
        title=f"{policy} in {benchmark.name}",
        summary=(
            f"{policy} ended {points(total.mean)} of its dives at the goal without a collision, on average over "
            f"{total.caves} caves; the interquartile mean is {points(total.iqm)}. Intervals are over caves."
        ),
        facts=(
            Fact("mean", _rate(total.mean), f"95 % interval {_ends(total.mean)}"),
            Fact("interquartile mean", _rate(total.iqm), f"95 % interval {_ends(total.iqm)}"),
            *(Fact(tier.name, _rate(tier.mean), _ends(tier.mean)) for tier in score.tiers),
        ),
        warnings=(Notice("changed-caves", text),) if text else (),
        figures=(Figure(plot, "Each dot is a cave; bars are means with 95 % intervals over caves.", columns=2),),
        tables=(Table("By tier", COLUMNS, tuple(map(tier_row, (*score.tiers, total)))),),
        sections=(
            *(_worst(tier, score, episodes) for tier in score.tiers),
            Section("Every cave", tables=(_cave_table(score.caves),)),
        ),
        footer=f"aquanav {__version__}. Numbers for programs: score.json, results.json, episodes.parquet.",
    )
    write_page(page, path)
    return path


def plot_tiers(scores: dict[str, Score], path: Path) -> None:
    """Write the collision-free success of each policy in each tier, with a dot for each cave."""
    names = list(dict.fromkeys(tier.name for score in scores.values() for tier in score.tiers))
    figure = new_figure(max(5.0, 1.3 * len(names)), 3.6)
    axes = figure.subplots()
    width, rng = 0.8 / len(scores), np.random.default_rng(0)
    for number, score in enumerate(scores.values()):
        for tier in score.tiers:
            place = names.index(tier.name) + (number - (len(scores) - 1) / 2.0) * width
            colour, fade = COLOURS[number % len(COLOURS)], 1.0 if number < len(COLOURS) else 0.5
            axes.bar(place, tier.mean.mean, 0.9 * width, color=colour, alpha=fade, zorder=1)
            error = [[tier.mean.mean - tier.mean.low], [tier.mean.high - tier.mean.mean]]
            axes.errorbar(place, tier.mean.mean, yerr=error, color=INK, capsize=3, linewidth=1.2, zorder=3)
            own = [cave.collision_free_success for cave in score.caves if cave.tier == tier.name]
            spread = place + 0.35 * width * rng.uniform(-1.0, 1.0, len(own))
            axes.scatter(spread, own, s=4, color=INK, alpha=0.35, zorder=2)
    if len(scores) > 1:
        from matplotlib.patches import Patch

        labels = [Patch(color=COLOURS[n % len(COLOURS)], label=name) for n, name in enumerate(scores)]
        axes.legend(handles=labels, frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axes.set_xticks(range(len(names)), names)
    axes.set_ylim(0.0, 1.03)
    axes.set_yticks(np.linspace(0.0, 1.0, 6), [f"{100 * share:.0f} %" for share in np.linspace(0.0, 1.0, 6)])
    axes.set_title("Collision-free success", loc="left", fontweight="bold")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.tight_layout()
    save_figure(figure, path, 140)


def _rate(estimate: Estimate) -> str:
    return f"{100 * estimate.mean:.1f} %"


def _ends(estimate: Estimate) -> str:
    return f"{100 * estimate.low:.1f} to {100 * estimate.high:.1f} %"


def _worst(tier: TierScore, score: Score, episodes: EpisodeTable) -> Section:
    names = {cave.scenario for cave in score.caves if cave.tier == tier.name}
    own = episodes.rows(np.array([episode.scenario in names for episode in episodes]))
    rows = []
    for index in worst_first(own)[:NUM_WORST]:
        dive = own[index]
        rows.append(
            (
                dive.scenario, dive.outcome, str(dive.collisions), metres(dive.min_clearance), f"{dive.progress:.1f}",
                f"{dive.time:.0f}", f"aquanav-eval replay results.json --episode {dive.index} --film dive.mp4",
            )
        )  # fmt: skip
    columns = ("cave", "outcome", "collisions", "min clearance, m", "progress, m", "time, s", "to watch it")
    return Section(f"The worst dives of {tier.name}", tables=(Table("", columns, tuple(rows)),))


def _cave_table(caves: Sequence[CaveScore]) -> Table:
    ordered = sorted(caves, key=lambda cave: cave.collision_free_success)
    rows = tuple(
        (
            cave.scenario, cave.tier, str(cave.episodes), fraction_text(cave.collision_free_success),
            fraction_text(cave.means["success"]), f"{cave.means['spl']:.2f}", metres(cave.means["min_clearance"]),
            f"{cave.means['time']:.0f}",
        )
        for cave in ordered
    )  # fmt: skip
    columns = (
        "cave", "tier", "dives", "collision-free success", "success", "SPL", "least clearance, mean, m", "time, s",
    )  # fmt: skip
    return Table("From the worst to the best", columns, rows)
