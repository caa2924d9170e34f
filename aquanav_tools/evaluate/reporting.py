"""The one-page report of an evaluation: its pictures, its plots and its tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from aquanav_tools import __version__
from aquanav_tools.evaluate.metrics import EpisodeMetrics, Summary
from aquanav_tools.evaluate.results import Provenance
from aquanav_tools.evaluate.statistics import Proportion, wilson
from aquanav_tools.report.html import Fact, Figure, Notice, Page, Table, write_page
from aquanav_tools.report.picture import CavePicture
from aquanav_tools.report.plots import plot_clearance, plot_outcomes, plot_progress
from aquanav_tools.report.track import Track

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

FEW_EPISODES = 30
"""Below this a rate's interval is wider than about +-17 points at 50 %."""
EPISODE_COLUMNS = (
    "seed", "start", "outcome", "collisions", "min clearance, m", "mean clearance, m", "time, s", "path, m",
    "progress, m", "SPL", "reward", "cost",
)  # fmt: skip


def write_report(
    scenario: Scenario,
    tracks: Sequence[Track],
    episodes: Sequence[EpisodeMetrics],
    summary: Summary,
    provenance: Provenance,
    folder: Path,
) -> Path:
    """Draw the pictures and plots into `folder`/pictures and write `folder`/report.html; return the report's path."""
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    shown = worst_track(tracks, episodes)
    picture = CavePicture(scenario)
    picture.draw(pictures / "trail.png", [shown])
    picture.draw(pictures / "trails.png", tracks)
    plot_outcomes(_rates(summary), pictures / "outcomes.png")
    plot_progress(tracks, scenario.guide.length, pictures / "progress.png")
    plot_clearance(tracks, pictures / "clearance.png")
    figures = (
        Figure(pictures / "trail.png", f"The cave, cut open, with the trail of the worst episode: {_describe(shown)}."),
        Figure(pictures / "outcomes.png", "Share of episodes with 95 % Wilson intervals.", columns=1),
        Figure(pictures / "progress.png", "A line per episode; it ends where the episode ended.", columns=1),
        Figure(pictures / "clearance.png", "From the hull to the nearest wall, over all episodes.", columns=1),
        Figure(pictures / "trails.png", f"The trails of all {len(tracks)} episodes."),
    )
    page = Page(
        title=f"{provenance.policy} in {scenario.name}",
        summary=sentence(summary),
        facts=_facts(summary),
        warnings=_warnings(summary),
        figures=figures,
        tables=(_episode_table(episodes), _provenance_table(provenance)),
        footer=f"aquanav {__version__}. Numbers for programs: results.json. Recordings: rerun episodes/*.rrd.",
    )
    path = folder / "report.html"
    write_page(page, path)
    return path


def worst_track(tracks: Sequence[Track], episodes: Sequence[EpisodeMetrics]) -> Track:
    """Return the episode most worth a look: a failure before a success, then most collisions, then least clearance."""
    order = [(episode.is_success, -episode.collisions, episode.min_clearance) for episode in episodes]
    return tracks[order.index(min(order))]


def sentence(summary: Summary) -> str:
    """Return how it went, in one sentence."""
    free = round(summary.collision_free_success.rate * summary.episodes)
    return (
        f"It reached the goal in {summary.outcomes['success']} of {summary.episodes} episodes, in {free} of them "
        f"without touching the wall, and kept {summary.mean_clearance:.2f} m from the walls on average."
    )


def percent(proportion: Proportion) -> str:
    """Return a rate with its interval: 80 % [66, 89]."""
    return f"{proportion.rate:.0%} [{100 * proportion.low:.0f}, {100 * proportion.high:.0f}]".replace("%", " %")


def _describe(track: Track) -> str:
    return f"seed {track.seed}, start {track.start_index}, {track.outcome}, {track.num_collisions} collisions"


def _rates(summary: Summary) -> dict[str, tuple[float, tuple[float, float]]]:
    rates = {"collision-free": summary.collision_free_success}
    rates |= {outcome: wilson(count, summary.episodes) for outcome, count in summary.outcomes.items()}
    return {name: (share.rate, (share.low, share.high)) for name, share in rates.items()}


def _facts(summary: Summary) -> tuple[Fact, ...]:
    def interval(share: Proportion) -> str:
        return f"95 % interval {share.low:.0%} to {share.high:.0%}"

    free, success = summary.collision_free_success, summary.success
    return (
        Fact("collision-free success", f"{free.rate:.0%}", interval(free)),
        Fact("success", f"{success.rate:.0%}", interval(success)),
        Fact("SPL", f"{summary.spl:.2f}", "success weighted by path length"),
        Fact("collisions per episode", f"{summary.collisions_per_episode:.2f}"),
        Fact("clearance", f"{summary.mean_clearance:.2f} m", f"smallest {summary.min_clearance:.2f} m"),
        Fact("time", f"{summary.time:.0f} s", f"path {summary.path_length:.1f} m"),
    )


def _warnings(summary: Summary) -> tuple[Notice, ...]:
    if summary.episodes >= FEW_EPISODES:
        return ()
    width = 100 * (summary.success.high - summary.success.low)
    text = (
        f"Only {summary.episodes} episodes were run, so the success rate is only known to within {width:.0f} points. "
        f"Run {FEW_EPISODES} or more before comparing policies."
    )
    return (Notice("few-episodes", text),)


def _episode_table(episodes: Sequence[EpisodeMetrics]) -> Table:
    rows = tuple(
        (
            str(episode.seed), str(episode.start), episode.outcome, str(episode.collisions),
            f"{episode.min_clearance:.2f}", f"{episode.mean_clearance:.2f}", f"{episode.time:.1f}",
            f"{episode.path_length:.1f}", f"{episode.progress:.1f}", f"{episode.spl:.2f}", f"{episode.reward:.1f}",
            f"{episode.cost:.1f}",
        )
        for episode in episodes
    )  # fmt: skip
    return Table("Episodes", EPISODE_COLUMNS, rows)


def _provenance_table(provenance: Provenance) -> Table:
    rows = (
        ("policy", provenance.policy),
        ("policy, SHA-256", provenance.policy_sha256 or "none: a baseline"),
        ("scenario", provenance.scenario),
        ("scenario, content hash", provenance.scenario_hash),
        *((name, str(value)) for name, value in provenance.options.items()),
    )
    return Table("What was evaluated", ("", ""), rows)
