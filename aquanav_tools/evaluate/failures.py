"""Episodes in which the policy itself failed: it raised an error, hung, or gave what is no action."""

from __future__ import annotations

from collections.abc import Sequence

from aquanav_tools.envs.definitions import is_own_code
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.report.trajectory import FAILED


def failure_text(policy: str, episodes: Sequence[EpisodeMetrics]) -> str:
    """Return in how many episodes a policy itself failed, and how it first did; empty where it never did."""
    table = episodes if isinstance(episodes, EpisodeTable) else EpisodeTable(episodes)
    failed = table.rows(table.are("outcome", FAILED))
    if not failed:
        return ""
    count = f"{len(failed)} of {len(table)} episodes" if len(failed) < len(table) else f"every episode ({len(table)})"
    first, reasons = failed[0], len(failed.names("reason"))
    start = "" if first.start < 0 else f", start {first.start}"
    reason = first.reason if first.reason.endswith((".", "?", "!")) else f"{first.reason}."
    more = "" if reasons == 1 else f" There are {reasons} different reasons; the report lists them."
    what = "Code of your own failed" if is_own_code(first.reason) else f"The policy {policy} itself failed"
    return (
        f"{what} in {count}, first in episode {first.index} (seed {first.seed}{start}) "
        f"after {first.time:.1f} s: {reason}{more}"
    )


def is_failed_throughout(episodes: Sequence[EpisodeMetrics]) -> bool:
    """Return whether the policy itself failed in every episode, so that nothing was measured."""
    return all(episode.outcome == FAILED for episode in episodes)
