"""Building many drawn caves: by workers, on all cores of this machine or of a cluster, one cave each at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from aquanav_tools.build.generated import build_generated, is_built
from aquanav_tools.errors import AquanavError, ResourceError
from aquanav_tools.machine import lower_priority, num_cores
from aquanav_tools.provenance import code_digest
from aquanav_tools.scenario.shipped import GENERATOR, cache_dir
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.ray_cluster import as_at_home, connected
from aquanav_tools.workers.worker import Transport, WorkerSpec

LOWER_PRIORITY = 5
"""Added to the nice value of workers beside a process that goes first, which then gets three times the time of one of
them where they share a core. With 19 it would get 68 times as much, as would other programs, and wait for caves."""


@dataclass(frozen=True)
class CaveTask:
    """One cave that a worker builds."""

    style: str
    seed: int
    fault: str = ""
    """Why it is not to be built: it brought its worker down."""


@dataclass(frozen=True)
class BuiltCave:
    """What came of a task."""

    folder: Path | None
    """None where the cave could not be built."""
    fault: str = ""
    """Why it could not."""
    is_lost: bool = False
    """Whether it brought its worker down twice, which says nothing about the cave."""


class CaveBuilder:
    """What a worker builds caves with."""

    def build(self, task: CaveTask) -> BuiltCave:
        """Return where the cave of a task lies, built unless it lay there.

        Raises:
            ResourceError: the cache cannot be written to, which no other cave would mend.
        """
        if task.fault:
            return BuiltCave(None, task.fault, is_lost=True)
        try:
            return BuiltCave(build_generated(task.style, task.seed))
        except ResourceError:
            raise
        except AquanavError as error:
            return BuiltCave(None, str(error))


def make_cave_builder(niceness: int, _clock: Any) -> CaveBuilder:
    """Return a builder in a worker of its own, which is made so nice."""
    lower_priority(niceness)
    return CaveBuilder()


def builder_pool(num_workers: int, transport: Transport | None = None, *, niceness: int = 0) -> WorkerPool:
    """Return workers that build caves, for `built_by`: processes of this machine, or of a cluster by its transport."""
    make = partial(make_cave_builder, niceness)
    spec = WorkerSpec(
        make if transport is None else as_at_home(make, _versions),
        name="cave builder",
        activity="caves were built",
        advice="Caves that are built stay; the same command goes on with the others.",
    )
    return WorkerPool(transport or PipeTransport(), spec, num_workers)


def _versions() -> dict[str, str]:
    """Return what must be the same on all nodes of a cluster."""
    return {"cave generator": code_digest(*GENERATOR), "cache folder": str(cache_dir().resolve())}


def built_by(pool: WorkerPool, tasks: Iterator[CaveTask | None]) -> Iterator[tuple[CaveTask, BuiltCave]]:
    """Yield each task as it ends, with what came of it. A task whose worker ends is done once more, as in the pool.

    Raises:
        ResourceError: workers end again and again, none starts, or the cache cannot be written to.
        WorkerError: building raised what is no error of aquanav's.
    """
    yield from pool.results(tasks, "build", lambda task, why: replace(task, fault=why))


def build_set(
    tasks: Iterable[CaveTask], num_workers: int = 0, ray: str | None = None
) -> Iterator[tuple[CaveTask, BuiltCave]]:
    """Yield the tasks of a set with what came of each, in the order in which they end.

    Args:
        tasks: What to build; caves that lie in the cache are done at once.
        num_workers: Workers; with 0 one for each core that this process may use, or for each of the cluster's.
        ray: Address of the Ray cluster whose actors the workers are; None for processes of this machine. The cache
            folder must be the same for all its nodes.

    Raises:
        ResourceError: as in `built_by`, or the cluster does not answer.
    """
    waiting = []
    for task in tasks:
        if is_built(task.style, task.seed):  # without waiting for workers to start
            yield task, CaveBuilder().build(task)
        else:
            waiting.append(task)
    if not waiting:
        return
    with ExitStack() as held:
        transport: Transport | None = None
        cores = num_cores()
        if ray is not None:
            transport = held.enter_context(connected(ray))
            cores = transport.num_cores
        num = min(num_workers or cores, len(waiting))
        if num <= 1 and ray is None:  # not worth a process
            yield from ((task, CaveBuilder().build(task)) for task in waiting)
            return
        pool = held.enter_context(builder_pool(num, transport))
        yield from built_by(pool, iter(waiting))
