"""Running the episodes of a plan: one by one here or in other processes, on a Ray cluster, or side by side as a batch.

Each episode depends on its number alone, so nothing depends on how many processes there are, nor on the order in which
episodes end. One whose process ends is run once more; where that ends too, the episode has failed.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial

from aquanav_tools.evaluate.episode_worker import EpisodeWorker, EvaluationSpec, Plan, Row, Task, make_worker
from aquanav_tools.evaluate.rollout import CallTimeout
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.worker import WorkerSpec

EPISODES_PER_WORKER = 10
"""A process takes about as long to start as 20 short episodes, and works beside the others meanwhile."""
KEPT = "What was run is kept: go on with --resume."
Tasks = Iterator[Task | None]
"""None stands for an episode that depends on those that run."""
Runner = Callable[[Tasks], Iterator[Row]]
"""Yields the journal's rows of tasks as they end, when all that belongs to them is on disk. May be called again."""


@contextmanager
def open_runner(spec: EvaluationSpec, plan: Plan, count: int) -> Iterator[Runner]:
    """Yield what runs episodes of a plan, for about `count` of them; its processes end with the body.

    Processes begin by importing the main module again: a script that calls this needs `if __name__ == "__main__"`.

    Raises:
        InputError: a node of the cluster lacks the policy or a scenario, or has others, or another version of aquanav
            or a library.
        ResourceError: processes end again and again before they run, Ray is not installed, or the cluster does not
            answer.
    """
    num = num_workers(spec.options.workers, count, len(os.sched_getaffinity(0)))
    if count == 0:
        yield lambda tasks: iter(())
    elif spec.options.ray is not None:
        from aquanav_tools.evaluate.cluster import open_cluster

        with open_cluster(spec, plan, count) as runner:
            yield runner
    elif spec.options.backend == "batch":
        from aquanav_tools.evaluate.batch_runner import open_batch  # Warp takes a second to import

        with open_batch(spec, plan, count) as runner:
            yield runner
    elif num > 1:
        with WorkerPool(PipeTransport(), worker_spec(spec), num) as pool:
            yield partial(rows_of, pool)
    else:
        with closing(EpisodeWorker(spec, plan)) as worker:
            yield lambda tasks: (worker.run(task) for task in tasks if task is not None)


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
