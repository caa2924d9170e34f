"""The card of a policy: what it is, how it was made, what it scored, where it fails (Mitchell et al., FAT* 2019).

Nothing in it is written by hand: it says what the policy's file and the evaluations of that very file hold.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from aquanav_tools import __version__
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.policies import PREFIX, LoadedPolicy, load_policy
from aquanav_tools.evaluate.results import episodes_of, read_results
from aquanav_tools.evaluate.summary import summarise
from aquanav_tools.evaluate.summary_text import estimate_text, fraction_text, percent
from aquanav_tools.policy.architecture import read_kind, read_options
from aquanav_tools.policy.archive import TRAINED, read_archive
from aquanav_tools.shipped import shipped_path

RESULTS = "results.json"
SETTINGS = ("n_envs", "n_steps", "batch_size", "n_epochs", "gamma", "gae_lambda", "ent_coef")
"""Of the algorithm, as Stable-Baselines3 calls them."""
WORST_STARTS = 5
UNKNOWN = "not recorded in the file"


def policy_card(spec: str, evaluations: Sequence[Path]) -> str:
    """Return the card of a Stable-Baselines3 zip or of a baseline that was trained, in Markdown.

    Args:
        spec: A path, or baseline:NAME.
        evaluations: Folders of evaluations of it, with results.json.

    Raises:
        InputError: it is no such policy, or an evaluation is missing or is of another file.
    """
    policy = load_policy(spec)
    path = _zip_path(spec, policy)
    settings, _ = read_archive(path)
    tables = [_own_results(folder, policy) for folder in evaluations]
    lines = [f"# {policy.name}", "", *_rows("what it is", _facts(policy, settings, path)), "", "## Scores", ""]
    lines += _scores(tables) if tables else ["No evaluation was given."]
    lines += ["", "## Where it fails", "", *_failures(tables)] if tables else []
    return "\n".join([*lines, "", f"aquanav {__version__}, from the policy's file and evaluations of it.", ""])


def _zip_path(spec: str, policy: LoadedPolicy) -> Path:
    if policy.sha256 is None or (not spec.startswith(PREFIX) and Path(spec).suffix != ".zip"):
        raise InputError(
            f"{spec} is no Stable-Baselines3 zip, which says how a policy was made. Name a zip, or a baseline that was "
            "trained."
        )
    folder, suffix = TRAINED
    return shipped_path(folder, spec.removeprefix(PREFIX), suffix) if spec.startswith(PREFIX) else Path(spec)


def _own_results(folder: Path, policy: LoadedPolicy) -> dict[str, Any]:
    table = read_results(folder / RESULTS if folder.is_dir() else folder)
    found = table["policy"]["sha256"]
    if found != policy.sha256:
        raise InputError(
            f"The evaluation in {folder} is of {table['policy']['name']} with the SHA-256 {str(found)[:12]}, and "
            f"{policy.name} has {str(policy.sha256)[:12]}: another file. Evaluate this one."
        )
    return table


def _facts(policy: LoadedPolicy, settings: dict[str, Any], path: Path) -> Iterator[tuple[str, str]]:
    kind = read_kind(settings, path)
    yield "task", str(policy.task or "caves or bays")
    sensors, history = (policy.observed.sensors, policy.observed.history) if policy.observed else ((), ())
    words = [policy.observation, *sensors, *(f"the same of {ago} decisions ago" for ago in history)]
    yield "observes", ", ".join([*words, *([] if policy.size is None else [f"{policy.size} values"])])
    yield "acts", policy.action
    widths = read_options(settings.get("policy_kwargs"), kind, path)["net_arch"]
    yield "network", f"hidden layers of {', '.join(map(str, widths))}"
    known = settings.get("num_timesteps")  # SB3 counts anew in each lesson
    yield "learned from, in its last lesson", UNKNOWN if known is None else f"{int(known):,} decisions"
    yield "by", ", ".join(f"{name} {settings[name]}" for name in SETTINGS if name in settings) or UNKNOWN
    for file in (path, path.with_suffix(".onnx")):
        if file.is_file():
            yield f"SHA-256 of {file.name}", hashlib.sha256(file.read_bytes()).hexdigest()


def _scores(tables: Sequence[dict[str, Any]]) -> list[str]:
    head = ("place", "backend, seed", "episodes", "collision-free success", "success", "SPL", "collisions per 100 m")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for table in tables:
        rules = table["protocol"]
        for place, episodes in _by_place(table).items():
            found = summarise(episodes)
            row = (
                place, f"{rules['backend']}, {rules['seed']}", str(found.distinct_episodes),
                percent(found.collision_free_success), percent(found.success), estimate_text(found.means["spl"]),
                estimate_text(found.collisions_per_100m),
            )  # fmt: skip
            lines.append(f"| {' | '.join(row)} |")
    return [*lines, "", "Intervals of 95 %; episodes that differ."]


def _by_place(table: dict[str, Any]) -> dict[str, list[EpisodeMetrics]]:
    current = table["protocol"].get("current")
    found: dict[str, list[EpisodeMetrics]] = {}
    for episode in episodes_of(table):
        water = "" if current is None else f", current {current}"
        found.setdefault(f"{episode.scenario}, {episode.condition}{water}", []).append(episode)
    return found


def _failures(tables: Sequence[dict[str, Any]]) -> list[str]:
    """Return lines on how episodes ended that were not clean, and on the starts that most of them have."""
    episodes = [episode for table in tables for episode in episodes_of(table)]
    failed = [episode for episode in episodes if not episode.is_collision_free_success]
    if not failed:
        return [f"In none of {len(episodes)} episodes."]
    ends = Counter("touched" if item.outcome == "success" else item.outcome for item in failed)
    starts = Counter((item.scenario, item.start) for item in failed)
    told = ", ".join(f"{name} {count}" for name, count in ends.most_common())
    return [
        f"In {len(failed)} of {len(episodes)} episodes, {fraction_text(len(failed) / len(episodes))}: {told}.",
        "",
        *(
            f"- {place}, {_start_text(start)}: {count} of them"
            for (place, start), count in starts.most_common(WORST_STARTS)
        ),
    ]


def _start_text(start: int) -> str:
    return "start drawn anew" if start < 0 else f"start {start}"


def _rows(title: str, rows: Iterator[tuple[str, str]]) -> list[str]:
    return [f"| {title} | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)]
