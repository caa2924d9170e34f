"""Running the episodes of a plan: one by one here or in other processes, on a Ray cluster, or side by side as a batch.

Each episode depends on its number alone, so nothing depends on how many processes there are, nor on the order in which
episodes end. One whose process ends is run once more; where that ends too, the episode has failed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial

from aquanav_tools.evaluate.episode_pool import Runner, num_workers, rows_of, worker_spec
from aquanav_tools.evaluate.episode_worker import EpisodeWorker, EvaluationSpec, Plan
from aquanav_tools.machine import num_cores
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool


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
    num = num_workers(spec.options.workers, count, num_cores())
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
