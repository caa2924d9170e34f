"""aquanav generate: scenarios in caves that are drawn from a style and seeds."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from aquanav_tools.cave.styles.names import MIXED
from aquanav_tools.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class Generate:
    """Draw caves without end, and build them into the cache folder: each is a scenario called generated/STYLE/SEED.

    That name will do wherever a scenario is asked for; what is not built yet is built then. The same style and seed are
    the same cave always. Styles: phreatic-tube, vadose-canyon, bedding-plane, breakdown-chamber, shaft-ramp, maze,
    sump-series, flooded-gallery, mine-drift; mixed picks one by the seed.
    """

    style: str = MIXED
    """What kind of cave."""
    seed: int = 0
    """Picks the cave."""
    count: int = 1
    """How many, with seeds from `seed` upwards."""
    workers: int = 0
    """Processes that build them; one for each free core when 0."""


@dataclass(frozen=True)
class Task:
    """One cave that a worker builds."""

    style: str
    seed: int
    fault: str = ""
    """Why it is not to be built: it brought its worker down."""


class Builder:
    """What a worker builds caves with."""

    def build(self, task: Task) -> tuple[Path | None, str]:
        """Return the folder of a cave; where it could not be built, None and why."""
        from aquanav_tools.build.generated import build_generated
        from aquanav_tools.errors import AquanavError

        if task.fault:
            return None, task.fault
        try:
            return build_generated(task.style, task.seed), ""
        except AquanavError as error:
            return None, str(error)


def make_builder(_clock: object) -> Builder:
    """Return a builder; its library threads are one each, as there is a worker for every core."""
    return Builder()


def run_generate(options: Generate) -> None:
    """Build the caves and print where each lies.

    Raises:
        InputError: there is no such style, or a number is out of range.
        MeshError: caves could not be built; the message says which, and why.
    """
    from aquanav_tools.cave.styles.names import style_of
    from aquanav_tools.errors import MeshError

    if options.count < 1 or options.workers < 0:
        raise InputError(f"--count {options.count} must be at least 1, and --workers {options.workers} not negative.")
    tasks = [Task(options.style, options.seed + n) for n in range(options.count)]
    for task in tasks:
        style_of(task.style, task.seed)
    faults = []
    for task, (folder, fault) in _built(tasks, options.workers or len(os.sched_getaffinity(0))):
        if folder is None:
            faults.append(f"seed {task.seed}: {fault}")
        else:
            print(folder)
        if options.count > 1:
            print(f"generated/{task.style}/{task.seed} is {'built' if folder else 'not built'}.", file=sys.stderr)
    if faults:
        raise MeshError(f"{len(faults)} of {len(tasks)} caves could not be built. {' '.join(faults)}")


def _built(tasks: list[Task], num_workers: int) -> Iterator[tuple[Task, tuple[Path | None, str]]]:
    """Yield each task with what came of it, as it ends; of several tasks, workers do one each at a time."""
    from dataclasses import replace

    num = min(num_workers, len(tasks))
    if num == 1:
        builder = Builder()
        yield from ((task, builder.build(task)) for task in tasks)
        return
    from aquanav_tools.workers.pipe import PipeTransport
    from aquanav_tools.workers.pool import WorkerPool
    from aquanav_tools.workers.worker import WorkerSpec

    spec = WorkerSpec(make_builder, "cave builder", "caves were built", "Caves that are built stay; run it again.")
    with WorkerPool(PipeTransport(), spec, num) as pool:
        yield from pool.results(iter(tasks), "build", lambda task, why: replace(task, fault=why))
