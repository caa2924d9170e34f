"""What runs episodes, and the workers of an evaluation, here or on a cluster."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from functools import partial

from aquanav_tools.evaluate.episode_worker import EvaluationSpec, Row, Task, make_worker
from aquanav_tools.evaluate.rollout import CallTimeout
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.worker import WorkerSpec

EPISODES_PER_WORKER = 10
"""A process takes about as long to start as 20 short episodes, and works beside the others meanwhile."""
KEPT = "What was run is kept: go on with --resume."
Tasks = Iterator[Task | None]
"""None stands for an episode that depends on those that run."""
Runner = Callable[[Tasks], Iterator[Row]]
"""Yields the journal's rows of tasks as they end, when all that belongs to them is on disk. May be called again."""


def num_workers(wanted: int | None, num_episodes: int, num_cores: int) -> int:
    """Return how many processes run so many episodes on so many cores."""
    if wanted is None:
        return min(num_cores, -(-num_episodes // EPISODES_PER_WORKER))
    return min(wanted, num_episodes)


def worker_spec(spec: EvaluationSpec) -> WorkerSpec:
    """Return what the processes of an evaluation are; their calls are a policy's, which may hang."""
    limit = spec.options.action_time_limit
    return WorkerSpec(
        make=partial(make_worker, spec),
        name="episode worker",
        activity="episodes ran",
        advice=KEPT,
        clock_limit=limit,
        late=CallTimeout(limit).reason,
    )


def rows_of(pool: WorkerPool, tasks: Tasks) -> Iterator[Row]:
    """Yield the rows of tasks that a pool's workers carry out."""
    for _, row in pool.results(tasks, "run", failed):
        if row:
            yield row


def failed(task: Task, reason: str) -> Task:
    """Return what is carried out in place of a task that brought its process down: its failure."""
    return dataclasses.replace(task, reason=task.reason or reason)
