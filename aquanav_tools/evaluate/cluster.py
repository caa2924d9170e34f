"""Running episodes on a Ray cluster: on the cores of many machines, and a machine that fails costs no episode.

For each core that is wanted, an actor keeps a process beside it, so that a policy that raises, hangs or brings its
process down fares as it does on one machine. An actor that is lost was killed from outside or with its machine, which
says nothing about the policy: another one runs its episode again. What belongs to an episode comes back with its row;
the first machine alone writes to the evaluation's folder.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from aquanav_tools.errors import AquanavError, InputError, ResourceError
from aquanav_tools.evaluate.episode_pool import KEPT, Runner, Tasks, failed, num_workers, worker_spec
from aquanav_tools.evaluate.episode_worker import EvaluationSpec, Plan, Row, Task, file_names, seal_of
from aquanav_tools.evaluate.journal import TRAJECTORIES
from aquanav_tools.evaluate.results import versions
from aquanav_tools.provenance import code_digest
from aquanav_tools.store import LOCK_FILE, locked
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.ray_cluster import as_at_home, connected, of_this_node
from aquanav_tools.workers.worker import WorkerSpec

SCRATCH = "aquanav-actor-"
"""Beginning of the name of an actor's folder."""
LEFT_AFTER = 600.0
"""Age of a folder that may have been left, s: many times what lies between making and holding one."""
PARTIAL = ".partial"
Files = dict[str, bytes]
"""What belongs to an episode, by its path in the evaluation's folder."""


@contextmanager
def open_cluster(spec: EvaluationSpec, plan: Plan, count: int) -> Iterator[Runner]:
    """Yield what runs episodes on a cluster; see `open_runner`."""
    assert spec.options.ray is not None and spec.output is not None
    with connected(spec.options.ray) as transport:
        num = num_workers(spec.options.workers, count, transport.num_cores)
        with WorkerPool(transport, _actor_spec(replace(spec, seal=seal_of(plan))), num) as pool:
            yield partial(_rows_of, pool, spec.output)


def code_here() -> dict[str, str]:
    """Return the versions of what episodes depend on, and a hash of our own code and of all libraries it imports."""
    return {**versions(), "code": code_digest("aquanav_tools.evaluate.episode_worker")}


def _actor_spec(spec: EvaluationSpec) -> WorkerSpec:
    return WorkerSpec(
        make=as_at_home(partial(NodeWorker, spec), code_here),
        name="episode actor",
        activity="episodes ran",
        advice=KEPT,
    )


def _rows_of(pool: WorkerPool, output: Path, tasks: Tasks) -> Iterator[Row]:
    for task, (row, files) in pool.results(tasks, "run", failed):
        check_found(task.index, row, files)
        _keep(files, output)
        yield row


class NodeWorker:
    """Runs episodes on a node, as an actor's object; keeps their files in a folder of its own until they are sent."""

    def __init__(self, spec: EvaluationSpec, clock: Any) -> None:
        clear_left(Path(tempfile.gettempdir()))
        self._held = contextlib.ExitStack()
        self._folder = Path(self._held.enter_context(tempfile.TemporaryDirectory(prefix=SCRATCH)))
        self._held.enter_context(locked(self._folder))
        (self._folder / TRAJECTORIES).mkdir()
        beside = worker_spec(replace(spec, output=self._folder))
        self._pool = self._held.enter_context(WorkerPool(PipeTransport(), beside, 1))

    def run(self, task: Task) -> tuple[Row, Files]:
        """Return the journal's row of an episode and what belongs to it.

        Raises:
            AquanavError: this node cannot run as the first machine does.
        """
        try:
            ((_, row),) = self._pool.results(iter([task]), "run", failed)
        except AquanavError as error:
            raise of_this_node(error) from error
        paths = [path for path in self._folder.rglob("*") if path.is_file() and path.name != LOCK_FILE]
        files = {str(path.relative_to(self._folder)): path.read_bytes() for path in paths if path.suffix != PARTIAL}
        for path in paths:
            path.unlink()
        return row, files

    def close(self) -> None:
        """End the process that runs, and remove the folder."""
        self._held.close()


def clear_left(parent: Path) -> None:
    """Remove the folders of actors that were killed: those that nobody holds, and that were not made just now."""
    for folder in parent.glob(f"{SCRATCH}*"):
        with contextlib.suppress(OSError, InputError):  # it is held, another user's, or just being removed
            if time.time() - folder.stat().st_mtime > LEFT_AFTER:
                with locked(folder):
                    shutil.rmtree(folder)


def check_found(index: int, row: Row, files: Files) -> None:
    """Refuse what is not of the episode that was asked for: a name that a node sends must not lead out of the folder.

    Raises:
        ResourceError: it is of another episode, or one of its files is called otherwise than an episode's are.
    """
    strange = {*files, *([row["recording"]] if row["recording"] else [])} - file_names(index)
    if strange or row["metrics"]["index"] != index:
        what = f"a file called {min(strange)[:100]!r}" if strange else f"episode {row['metrics']['index']}"
        raise ResourceError(
            f"A node that was asked for episode {index} sent {what}, which does not belong to it. The likely cause is "
            "a node on which another program answers. What was run is kept: check the nodes, and go on with --resume."
        )


def _keep(files: Files, folder: Path) -> None:
    """Write what belongs to an episode, each file whole or not at all."""
    for name, content in files.items():
        path = folder / name
        partial = path.with_name(path.name + PARTIAL)
        partial.write_bytes(content)
        os.replace(partial, path)
