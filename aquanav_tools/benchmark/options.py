"""What can be chosen about a benchmark's run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.sim.contacts import Backend


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions:
    """How a policy is scored in a benchmark. Each field is an option of aquanav-eval --benchmark."""

    policy: str
    """As `aquanav_tools.evaluate.policies.load_policy` takes it."""
    benchmark: str
    """Name of a benchmark (`aquanav list` has them; quick is a tenth of the set, to try things out), or a file like
    those in eval/sets. With +real at the end, caves of your own are dived as well, as a tier of their own: those in
    the slots cave-real-1 to 3, and those named with --real."""
    output: Path = Path("out/benchmark")
    """Folder for results.json, episodes.parquet, score.json and report.html; an earlier run in it is replaced."""
    real: tuple[Path, ...] = ()
    """Scenario folders of your own caves."""
    observation: str | None = None
    """What the policy observes, where its file does not tell."""
    backend: Backend = "batch"
    """batch runs the episodes of a cave side by side, with our own contacts and rays through the distance field;
    pybullet one by one, with Bullet's contacts and rays to the mesh, also policies behind the shield; own does so with
    our own contacts, where PyBullet is not installed."""
    workers: int | None = None
    """Processes, each at one cave at a time; the results do not depend on it. As many as there are cores without it."""
    trust: bool = False
    """Let the policy's file run code."""
    resume: bool = False
    """Go on with a run that was stopped; its results become those of one that was not."""
    submit: str | None = None
    """Name under which to write a submission for the leaderboard: one file with the policy, every episode and the
    score, NAME.json in the output folder."""
    action_time_limit: float = 30.0
    """Wall time in which a policy must give an action, s; an episode in which it does not has failed."""

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers is {self.workers}; choose 1 or more, or leave it out for all cores.")
        if not 0.0 < self.action_time_limit < math.inf:
            raise InputError(f"--action-time-limit is {self.action_time_limit} s; choose more than 0.")
