"""Evaluating a policy's file again and again as it changes, on the same episodes: what training validates with."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.evaluate.episode_pool import Runner
from aquanav_tools.evaluate.episode_runner import open_runner
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.episode_worker import EvaluationSpec, Plan, Task, make_plan
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.policies import policy_loader
from aquanav_tools.evaluate.summary import Summary, summarise
from aquanav_tools.provenance import file_hash


class RepeatedEvaluation:
    """Runs the episodes that `evaluate` runs with the same options, and keeps nothing of them but their summary.

    Environments and worker processes are kept from one policy to the next.
    """

    def __init__(self, options: EvaluateOptions, scenarios: Sequence[AnyScenario]) -> None:
        """Prepare an evaluation; nothing is read or started yet.

        Args:
            options: Of `evaluate`, with one policy: a zip, which need not be there yet. Its output is not written.
            scenarios: In memory, instead of those that the options name.
        """
        self._path = Path(options.policies[0])
        load = policy_loader(options, is_trusted=False)
        self._spec = EvaluationSpec(options, str(self._path), None, load, scenarios=tuple(scenarios))
        self._held = ExitStack()
        self._opened: tuple[Plan, Runner] | None = None

    def summary(self) -> Summary:
        """Return the summary of all episodes with the policy that the file holds now.

        Raises:
            InputError: the policy cannot be used.
            ResourceError: processes end again and again.
        """
        plan, runner = self._opened or self._open()
        policy_sha256 = file_hash(self._path)
        tasks = (Task(episode.index, "never", policy_sha256=policy_sha256) for episode in plan.episodes)
        rows = sorted((row["metrics"] for row in runner(tasks)), key=lambda metrics: int(metrics["index"]))
        return summarise(EpisodeTable([EpisodeMetrics(**metrics) for metrics in rows]))

    def close(self) -> None:
        """Free environments and end processes."""
        self._opened = None
        self._held.close()

    def _open(self) -> tuple[Plan, Runner]:
        plan = make_plan(self._spec)
        runner = self._held.enter_context(open_runner(self._spec, plan, len(plan.episodes)))
        self._opened = plan, runner
        return self._opened
