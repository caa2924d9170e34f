"""The one-page report of an evaluation: its pictures, its plots and its tables."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.evaluate.dynamics_table import dynamics_tables
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.episode_worker import FILM_SUFFIX
from aquanav_tools.evaluate.failures import failure_text
from aquanav_tools.evaluate.journal import Journal, worst_first
from aquanav_tools.evaluate.metrics import INFEASIBLE, EpisodeMetrics
from aquanav_tools.evaluate.observed import named_observation
from aquanav_tools.evaluate.own_files import names_code
from aquanav_tools.evaluate.results import Provenance, vehicle_text
from aquanav_tools.evaluate.shield import CAVEAT
from aquanav_tools.evaluate.shielding import SHIELD
from aquanav_tools.evaluate.statistics import Estimate, Proportion, wilson
from aquanav_tools.evaluate.summary import GROUPINGS, Group, Summary
from aquanav_tools.evaluate.summary_text import (
    bound,
    estimate_text,
    figure,
    infeasible_text,
    metres,
    percent,
    rate_text,
    sentence,
    variety_text,
)
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.html import Fact, Figure, Film, Link, Notice, Page, Section, Table, write_page
from aquanav_tools.report.plots import plot_clearance, plot_outcomes, plot_progress
from aquanav_tools.report.trajectory import FAILED, TrajectorySummary
from aquanav_tools.task import TaskOptions, choices_of

NUM_CHARTS = 6
"""Episodes that are drawn each by itself, the worst first, where each had a place of its own."""

NUM_FILMS = 6
"""Shown in the report, the worst first."""
FILM_NAMES = "episode-*.webm"
FEW_EPISODES = 30
"""Below this a rate's interval is wider than about +-17 points at 50 %."""
MAX_TRAJECTORIES = 100
"""Drawn and plotted at most; a report does not grow with the number of episodes."""
NUM_WORST = 10
MAX_ROWS = 500
"""Of the table of episodes; the rest is in episodes.parquet."""
MEAN_ROWS = {
    "spl": ("SPL, success weighted by path length", "2f", ""),
    "progress": ("progress along the route", "1f", "m"),
    "collisions": ("collisions per episode", "2f", ""),
    "min_clearance": ("clearance, least of an episode", "2f", "m"),
    "clearance_p5": ("clearance, 5th percentile over time", "2f", "m"),
    "mean_clearance": ("clearance, mean over time", "2f", "m"),
    "time_close": ("time closer to a wall than the vehicle is wide", "1f", "s"),
    "time": ("time", "1f", "s"),
    "time_ratio": ("time over the shortest path's at top speed, successes", "2f", ""),
    "path_length": ("path length", "1f", "m"),
    "reward": ("return, the sum of the reward", "1f", ""),
    "cost": ("safety cost, decisions in contact", "1f", ""),
    "control_effort": ("control effort, 0 idle to 1 full", "2f", ""),
    "control_change": ("change of the controls between decisions", "2f", ""),
    "energy": ("energy, work done against the water's drag", "0f", "J"),
    "jerk": ("jerk, root mean square", "1f", "m/s³"),
    "interventions": ("actions that the safety shield replaced, per episode", "1f", ""),
}
EPISODE_COLUMNS = (
    "episode", "scenario", "condition", "seed", "start", "outcome", "collisions", "min clearance, m",
    "5 % clearance, m", "time, s", "path, m", "SPL", "energy, J", "reason",
)  # fmt: skip


def write_report(
    scenarios: Sequence[AnyScenario],
    journal: Journal,
    results: tuple[Summary, tuple[Group, ...]],
    provenance: Provenance,
    recordings: Mapping[int, str],
    folder: Path,
) -> Path:
    """Draw the pictures and plots into `folder`/pictures and write `folder`/report.html; return the report's path."""
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    summary, groups = results
    episodes = journal.episodes
    sections = tuple(_place_section(scenario, journal, episodes, pictures) for scenario in scenarios)
    page = Page(
        title=f"{provenance.policy['name']} in {' and '.join(scenario.name for scenario in scenarios)}",
        summary=f"{sentence(summary)} {variety_text(episodes, summary, provenance.possible_episodes)}",
        facts=_facts(summary),
        warnings=_warnings(summary, episodes, provenance),
        figures=_plots(scenarios, journal, summary, pictures),
        tables=(
            _worst_table(episodes, recordings, provenance),
            _mean_table(summary, provenance.protocol["reward"]),
            *_group_tables(groups),
            *dynamics_tables(episodes),
        ),
        sections=(
            *_film_section(episodes, recordings, folder),
            *sections,
            Section("Every episode", tables=(_episode_table(episodes, recordings),)),
            Section("To repeat it", _repetition(), tables=(_repeat_table(provenance, journal),)),
        ),
        footer=f"aquanav {__version__}. Numbers for programs: results.json, episodes.parquet. Recordings: rerun *.rrd.",
    )
    path = folder / "report.html"
    write_page(page, path)
    return path


def _place_section(scenario: AnyScenario, journal: Journal, episodes: EpisodeTable, pictures: Path) -> Section:
    own = episodes.rows(episodes.are("scenario", scenario.name))
    picture = adapter_of(scenario).picture()
    if not picture.is_shared:
        charts = []
        for episode in [own[index] for index in worst_first(own)[:NUM_CHARTS]]:
            path = pictures / f"{scenario.name}-{episode.index:05d}.png"
            picture.draw(path, [journal.trajectory(episode.index)])
            charts.append(Figure(path, f"One of the worst: {_describe(episode)}."))
        return Section(f"In {scenario.name}, where each episode has another map", figures=tuple(charts))
    worst = own[worst_first(own)[0]]
    paths = {kind: pictures / f"{scenario.name}-{kind}.png" for kind in ("worst", "trails", "collisions")}
    picture.draw(paths["worst"], [journal.trajectory(worst.index)])
    indices = own.column("index").tolist()
    shown = [journal.trajectory(index) for index in _drawn(indices)]
    picture.draw(paths["trails"], shown)
    contacts = [
        trajectory.positions[trajectory.contact_states]
        for trajectory in (journal.trajectory(index) for index in compress(indices, own.column("collisions")))
    ]
    figures = [Figure(paths["worst"], f"The worst episode: {_describe(worst)}.")]
    if contacts:
        together = np.concatenate(contacts)
        picture.draw(paths["collisions"], contacts=together)
        figures.insert(
            0, Figure(paths["collisions"], f"Where the {len(together)} collisions of all episodes happened.")
        )
    count = f"all {len(own)}" if len(shown) == len(own) else f"{len(shown)} of {len(own)}"
    figures.append(Figure(paths["trails"], f"The trails of {count} episodes."))
    model = adapter_of(scenario).model(pictures / f"{scenario.name}.glb", shown, len(own))
    return Section(f"In {scenario.name}", figures=tuple(figures), models=() if model is None else (model,))


def _film_section(episodes: EpisodeTable, recordings: Mapping[int, str], folder: Path) -> tuple[Section, ...]:
    """Return the films of the worst recorded episodes, where there are films."""
    paths = {index: (folder / name).with_suffix(FILM_SUFFIX) for index, name in recordings.items()}
    filmed = [index for index in worst_first(episodes) if index in paths and paths[index].is_file()]
    films = tuple(Film(paths[index], f"{_describe(episodes[index])}.".capitalize()) for index in filmed[:NUM_FILMS])
    text = f"The worst first, {len(films)} of {len(filmed)}. Each film is also a file beside this page, {FILM_NAMES}."
    return (Section("Films", text, films=films),) if films else ()


def _drawn(indices: Sequence[int]) -> list[int]:
    """Return at most MAX_TRAILS of the indices, evenly spread."""
    count = min(len(indices), MAX_TRAJECTORIES)
    return [indices[n * len(indices) // count] for n in range(count)]


def _plots(scenarios: Sequence[AnyScenario], journal: Journal, summary: Summary, pictures: Path) -> tuple[Figure, ...]:
    indices = journal.episodes.column("index").tolist()
    trajectories: list[TrajectorySummary] = [journal.trajectory(index) for index in _drawn(indices)]
    plot_outcomes(_rates(summary), pictures / "outcomes.png")
    plot_progress(trajectories, _longest(scenarios, trajectories), pictures / "progress.png")
    plot_clearance(trajectories, pictures / "clearance.png")
    which = (
        "episode" if len(trajectories) == summary.episodes else f"episode, {len(trajectories)} of {summary.episodes}"
    )
    return (
        Figure(pictures / "outcomes.png", "Share of episodes with 95 % Wilson intervals.", columns=1),
        Figure(pictures / "progress.png", f"A line per {which}; it ends where the episode ended.", columns=1),
        Figure(
            pictures / "clearance.png", f"From the hull to the nearest wall, {len(trajectories)} episodes.", columns=1
        ),
    )


def _longest(scenarios: Sequence[AnyScenario], trajectories: Sequence[TrajectorySummary]) -> float:
    """Return the length of the longest route, m; without routes, the most that was gained."""
    lengths = [adapter_of(scenario).reference.route_length for scenario in scenarios]
    return max(
        [length for length in lengths if length]
        or [float(trajectory.progress.max()) for trajectory in trajectories]
        or [1.0]
    )


def _describe(episode: EpisodeMetrics) -> str:
    start = "start drawn anywhere" if episode.start < 0 else f"start {episode.start}"
    contacts = f"{episode.collisions} collision" + ("" if episode.collisions == 1 else "s")
    return f"episode {episode.index}, seed {episode.seed}, {start}, {episode.outcome}, {contacts}"


def _rates(summary: Summary) -> dict[str, tuple[float, tuple[float, float]]]:
    rates = {"collision-free": summary.collision_free_success}
    for outcome, count in summary.outcomes.items():
        if outcome not in (FAILED, INFEASIBLE) or count:
            rates[outcome] = wilson(count, summary.episodes)
    return {name: (rate.rate, (rate.low, rate.high)) for name, rate in rates.items()}


def _facts(summary: Summary) -> tuple[Fact, ...]:
    def interval(rate: Proportion) -> str:
        return f"95 % interval {rate.low:.0%} to {rate.high:.0%}"

    free, success, means = summary.collision_free_success, summary.success, summary.means
    per_100m = summary.collisions_per_100m
    return (
        Fact("collision-free success", rate_text(free), interval(free)),
        Fact(*bound(summary), "of episodes, at 95 % confidence"),
        Fact("success", rate_text(success), interval(success)),
        Fact("SPL", f"{means['spl'].mean:.2f}", "success weighted by path length"),
        Fact(
            "collisions per 100 m", f"{per_100m.mean:.2f}", f"95 % interval {per_100m.low:.2f} to {per_100m.high:.2f}"
        ),
        Fact("clearance", f"{metres(means['mean_clearance'].mean)} m", f"smallest {metres(summary.min_clearance)} m"),
        Fact("time", f"{means['time'].mean:.0f} s", f"path {means['path_length'].mean:.1f} m"),
    )


def _warnings(summary: Summary, episodes: EpisodeTable, provenance: Provenance) -> tuple[Notice, ...]:
    notices = []
    free = summary.collision_free_success
    if summary.infeasible_episodes:
        notices.append(Notice("infeasible-episodes", infeasible_text(summary)))
    if summary.distinct_episodes < summary.episodes:
        text = (
            f"Only {summary.distinct_episodes} of the {summary.episodes} episodes differ; the others repeat them to "
            "the bit. The intervals count each once."
        )
        notices.append(Notice("repeated-episodes", text))
    if summary.distinct_episodes < FEW_EPISODES:
        width = 100 * (free.high - free.low)
        text = (
            f"{summary.distinct_episodes} different episodes were run, so the rate of collision-free success is only "
            f"known to within {width:.0f} points."
        )
        notices.append(Notice("few-episodes", text))
    if provenance.policy["name"].startswith(SHIELD):
        notices.append(Notice("shielded", CAVEAT))
    if summary.outcomes["failed"]:
        text = failure_text(provenance.policy["name"], episodes)
        notices.append(
            Notice("policy-failed", f"{text} They count as failures; the table of episodes has the reasons.")
        )
    return tuple(notices)


def _worst_table(episodes: EpisodeTable, recordings: Mapping[int, str], provenance: Provenance) -> Table:
    rows, trust = [], " --trust" if provenance.policy["is_trusted"] or names_code(provenance.own_files) else ""
    for index in worst_first(episodes)[:NUM_WORST]:
        episode = episodes[index]
        rows.append(
            (
                _link(episode, recordings), episode.scenario, episode.outcome, str(episode.collisions),
                metres(episode.min_clearance), f"{episode.progress:.1f}", f"{episode.time:.0f}",
                f"aquanav-eval replay results.json --episode {episode.index}{trust}",
            )
        )  # fmt: skip
    columns = (
        "recording", "scenario", "outcome", "collisions", "min clearance, m", "progress, m", "time, s", "to watch it",
    )  # fmt: skip
    return Table("The worst episodes", columns, tuple(rows))


def _link(episode: EpisodeMetrics, recordings: Mapping[int, str]) -> str:
    label = f"episode {episode.index}"
    return Link(label, recordings[episode.index]) if episode.index in recordings else label


def _mean_table(summary: Summary, reward: str) -> Table:
    rows: list[tuple[str, ...]] = [
        ("collisions per 100 m", f"{summary.collisions_per_100m.mean:.2f}", _ends(summary.collisions_per_100m, "2f"))
    ]
    for name, estimate in summary.means.items():
        label, form, unit = mean_row(name, reward)
        rows.append((label, f"{figure(estimate.mean, form)} {unit}".strip(), _ends(estimate, form)))
    return Table("On average over episodes", ("", "mean", "95 % interval"), tuple(rows))


def mean_row(name: str, reward: str) -> tuple[str, str, str]:
    """Return the label, the form and the unit of a mean; the return with the name of its reward, on which it rests."""
    label, form, unit = MEAN_ROWS[name]
    return f'{label} "{reward}"' if name == "reward" else label, form, unit


def _ends(estimate: Estimate, form: str) -> str:
    return f"{figure(estimate.low, form)} to {figure(estimate.high, form)}"


def _group_tables(groups: Sequence[Group]) -> tuple[Table, ...]:
    tables = []
    columns = (
        "", "episodes", "collision-free success", "success", "SPL", "collisions per 100 m", "clearance, 5 %, m",
        "energy, J",
    )  # fmt: skip
    for by in GROUPINGS:
        own = [group for group in groups if group.by == by]
        if len(own) < 2:
            continue
        rows = tuple(
            (
                group.name, str(group.summary.distinct_episodes), percent(group.summary.collision_free_success),
                percent(group.summary.success), estimate_text(group.summary.means["spl"]),
                estimate_text(group.summary.collisions_per_100m),
                estimate_text(group.summary.means["clearance_p5"]),
                estimate_text(group.summary.means["energy"], "0f") if "energy" in group.summary.means else "",
            )
            for group in own
        )  # fmt: skip
        title = {"scenario": "By scenario", "region": "By start on the route", "condition": "By condition"}[by]
        tables.append(Table(title, columns, rows))
    return tuple(tables)


def _episode_table(episodes: Sequence[EpisodeMetrics], recordings: Mapping[int, str]) -> Table:
    rows = tuple(
        (
            _link(episode, recordings), episode.scenario, episode.condition, str(episode.seed), str(episode.start),
            episode.outcome, str(episode.collisions), metres(episode.min_clearance), metres(episode.clearance_p5),
            f"{episode.time:.1f}", f"{episode.path_length:.1f}", f"{episode.spl:.2f}",
            "" if episode.energy is None else f"{episode.energy:.0f}",
            episode.reason,
        )
        for episode in episodes[:MAX_ROWS]
    )  # fmt: skip
    rest = f", the first {MAX_ROWS} of {len(episodes)}; all are in episodes.parquet" if len(episodes) > MAX_ROWS else ""
    return Table(f"Episodes{rest}", EPISODE_COLUMNS, rows)


def _repetition() -> str:
    return (
        "The same policy, scenarios and options give the same results.json to the byte on the same machine. "
        "aquanav-eval replay runs one episode again and checks that it repeats to the bit."
    )


def _repeat_table(provenance: Provenance, journal: Journal) -> Table:
    policy, protocol = provenance.policy, provenance.protocol
    rows: list[tuple[str, str]] = [
        ("command", repeat_command(provenance)),
        ("policy", str(policy["name"])),
        ("policy, SHA-256", policy["sha256"] or "none: a baseline"),
    ]
    for scenario in provenance.scenarios:
        rows.append((f"scenario {scenario['name']}, content hash", scenario["content_hash"]))
        if "vehicle" in scenario:
            rows.append((f"vehicle in {scenario['name']}", vehicle_text(scenario["vehicle"])))
    for name, parts in provenance.own_files.items():
        rows += [(f"{name}, SHA-256 of {part}", sha256) for part, sha256 in parts.items()]
    rows += [(name, str(value)) for name, value in protocol.items() if name not in ("conditions", "grid", "cases")]
    rows += [("condition", f"{item['name']}: {item['changes']}") for item in protocol["conditions"] if item["changes"]]
    rows.append(("episodes run", str(len(journal))))
    return Table("What was evaluated", ("", ""), tuple(rows))


def repeat_command(provenance: Provenance) -> str:
    """Return the command line that repeats an evaluation."""
    protocol = provenance.protocol
    words: list[Any] = ["aquanav-eval", provenance.policy["path"], "--scenario"]
    words += [scenario["path"] for scenario in provenance.scenarios]
    others = [scenario["vehicle"]["path"] for scenario in provenance.scenarios if "vehicle" in scenario]
    words += ["--vehicle", others[0]] if others else []
    words += ["--backend", protocol["backend"]]
    if "cases" in protocol:
        trust = ["--trust"] if provenance.policy["is_trusted"] or names_code(provenance.own_files) else []
        return shlex.join(map(str, [*words, "--protocol", "cases.toml", *trust]))
    observation = named_observation(protocol["observation"], protocol["sensors"], protocol["history"])
    words += ["--observation", observation] if observation else []
    words += ["--episodes", protocol["episodes"]] if protocol["episodes"] else []
    words += ["--seed", protocol["seed"]]
    words += task_words({name: protocol[name] for name in ("max_decisions", *choices_of(TaskOptions()))})
    words += ["--trust"] if provenance.policy["is_trusted"] else []
    for name, values in protocol["grid"].items():
        words += ["--grid." + name.replace("_", "-"), *values] if values else []
    return shlex.join(map(str, words))


def task_words(choices: Mapping[str, Any]) -> list[Any]:
    """Return the words of a command line for what is not as usual about the task."""
    usual, words = choices_of(TaskOptions()), []
    for name, value in choices.items():
        if value is not None and value != usual.get(name):
            words += ["--" + name.replace("_", "-"), *(value if isinstance(value, list | tuple) else [value])]
    return words
