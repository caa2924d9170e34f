"""Running episodes on a Ray cluster: on the cores of many machines, and a machine that fails costs no episode.

For each core that is wanted, an actor keeps a process beside it (worker_pool.py), so that a policy that raises,
hangs or brings its process down fares as it does on one machine. An actor that is lost was killed from outside or with
its machine, which says nothing about the policy: another one runs its episode again. What belongs to an episode comes
back with its row; the first machine alone writes to the evaluation's folder.
"""

from __future__ import annotations

import contextlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aquanav_tools.errors import AquanavError, InputError, ResourceError
from aquanav_tools.evaluate.episode_worker import EvaluationSpec, Plan, Row, Task, file_names, seal_of
from aquanav_tools.evaluate.journal import TRAJECTORIES
from aquanav_tools.evaluate.policies import LoadedPolicy
from aquanav_tools.evaluate.results import versions
from aquanav_tools.evaluate.worker_pool import LOOK_EVERY, MAX_LOSSES, num_workers, run_in_processes
from aquanav_tools.provenance import code_digest
from aquanav_tools.store import LOCK_FILE, locked

ANSWER_LIMIT = 30.0
"""Time that a cluster has to answer, s. Ray itself goes on trying for minutes."""
START_LIMIT = 300.0
"""Time in which an actor must start when none runs, s."""
CLOSE_LIMIT = 5.0
"""Time that actors without work have to end by themselves and clear up, s."""
PROBE = "import sys, ray; ray.init(sys.argv[1], logging_level='ERROR', log_to_driver=False)"
SCRATCH = "aquanav-actor-"
"""Beginning of the name of an actor's folder."""
LEFT_AFTER = 600.0
"""Age of a folder that may have been left, s: many times what lies between making and holding one."""
PARTIAL = ".partial"
Files = dict[str, bytes]
"""What belongs to an episode, by its path in the evaluation's folder."""


def run_on_cluster(spec: EvaluationSpec, plan: Plan, tasks: Iterator[Task | None], count: int) -> Iterator[Row]:
    """Yield the journal's rows of `count` tasks as they end, when all that belongs to them is on disk.

    Raises:
        InputError: a node lacks the policy or a scenario, or has others, or another version of aquanav or a library.
        ResourceError: Ray is not installed, the cluster does not answer, or its actors end again and again.
    """
    if count == 0:
        return
    ray = load_ray()
    with _connected(ray, str(spec.options.ray)):
        pool = RayPool(ray, _for_nodes(spec, plan), (task for task in tasks if task is not None))
        try:
            num_cores = int(ray.cluster_resources().get("CPU", 1))
            pool.start(num_workers(spec.options.workers, count, num_cores))
            for row, files in pool.results(count):
                _keep(files, spec.output)
                yield row
        finally:
            pool.close()


def load_ray() -> Any:
    """Return the library, which then tells nobody that it is used.

    Raises:
        ResourceError: it is not installed.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    try:
        import ray
    except ImportError as cause:
        raise ResourceError(
            "--ray needs the library ray, which is not installed. Install it on every node: "
            "pip install 'aquanav[cluster]'."
        ) from cause
    return ray


@contextlib.contextmanager
def _connected(ray: Any, address: str) -> Iterator[None]:
    """Connect with a cluster for the body's time; where a script has done so already, leave it as it is."""
    if ray.is_initialized():
        yield
        return
    _probe(address)
    ray.init(address, logging_level="ERROR")
    try:
        yield
    finally:
        ray.shutdown()


def _probe(address: str) -> None:
    """Try to connect in another process: where nothing answers, Ray keeps on for minutes and cannot be interrupted."""
    advice = (
        "Is it running (ray status), is this the address that `ray start --head` showed, and is this machine one of "
        "its nodes (ray start --address)?"
    )
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROBE, address], capture_output=True, text=True, timeout=ANSWER_LIMIT, check=False
        )
    except subprocess.TimeoutExpired as cause:
        raise ResourceError(f"No Ray cluster answered at {address} within {ANSWER_LIMIT:g} s. {advice}") from cause
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise ResourceError(f"Cannot connect with the Ray cluster at {address}: {last} {advice}")


@dataclass(frozen=True)
class HomeLoader:
    """Loads a policy on a node as on the first machine: in the same folder, by the same code."""

    load: Callable[[str], LoadedPolicy]
    folder: str
    """The first machine's working directory, from which relative paths count."""
    code: dict[str, str]
    """The first machine's versions."""

    def __call__(self, name: str) -> LoadedPolicy:
        """Return the policy, or raise InputError where this machine is not like the first."""
        here = code_here()
        different = [f"{part} {here[part]}, not {known}" for part, known in self.code.items() if here[part] != known]
        if different:
            raise InputError(
                f"It has {'; '.join(different)}. Results depend on these: install the same version of aquanav with the "
                "same constraints.txt on every node."
            )
        try:
            os.chdir(self.folder)
        except OSError as cause:
            raise InputError(f"It cannot enter the working directory {self.folder}: {cause}.") from cause
        return self.load(name)


def code_here() -> dict[str, str]:
    """Return the versions of what episodes depend on, and a hash of our own code and of all libraries it imports."""
    return {**versions(), "code": code_digest("aquanav_tools.evaluate.episode_worker")}


def _for_nodes(spec: EvaluationSpec, plan: Plan) -> EvaluationSpec:
    return replace(spec, load=HomeLoader(spec.load, os.getcwd(), code_here()), seal=seal_of(plan))


class RayWorker:
    """Runs episodes on a node, as an actor; keeps their files in a folder of its own until they are sent."""

    def __init__(self, spec: EvaluationSpec) -> None:
        clear_left(Path(tempfile.gettempdir()))
        self._held = contextlib.ExitStack()
        self._folder = Path(self._held.enter_context(tempfile.TemporaryDirectory(prefix=SCRATCH)))
        self._held.enter_context(locked(self._folder))
        (self._folder / TRAJECTORIES).mkdir()
        self._asked: deque[Task] = deque()
        self._rows = run_in_processes(replace(spec, output=self._folder), 1, iter(self._asked.popleft, None))

    def ready(self) -> None:
        """Return when the actor has started."""

    def run(self, task: Task) -> tuple[Row, Files]:
        """Return the journal's row of an episode and what belongs to it.

        Raises:
            AquanavError: this node cannot run as the first machine does.
        """
        self._asked.append(task)
        try:
            row = next(self._rows)
        except AquanavError as error:
            raise type(error)(
                f"The node {platform.node()} cannot run: {error} The working directory, the policy and the scenarios "
                "must lie at the same paths on every node."
            ) from error
        paths = [path for path in self._folder.rglob("*") if path.is_file() and path.name != LOCK_FILE]
        files = {str(path.relative_to(self._folder)): path.read_bytes() for path in paths if path.suffix != PARTIAL}
        for path in paths:
            path.unlink()
        return row, files

    def close(self) -> None:
        """End the process that runs, and remove the folder."""
        self._rows.close()
        self._held.close()


def clear_left(parent: Path) -> None:
    """Remove the folders of actors that were killed: those that nobody holds, and that were not made just now."""
    for folder in parent.glob(f"{SCRATCH}*"):
        with contextlib.suppress(OSError, InputError):  # it is held, another user's, or just being removed
            if time.time() - folder.stat().st_mtime > LEFT_AFTER:
                with locked(folder):
                    shutil.rmtree(folder)


@dataclass
class PendingCall:
    """An actor, and the episode that it runs; None until it has started."""

    actor: Any
    task: Task | None = None


class RayPool:
    """The actors and what they are at."""

    def __init__(self, ray: Any, spec: EvaluationSpec, tasks: Iterator[Task]) -> None:
        self._ray, self._spec, self._tasks = ray, ray.put(spec), tasks
        choices: dict[str, Any] = {"num_cpus": 1, "max_restarts": 0, "max_task_retries": 0}
        self._make = ray.remote(**choices, scheduling_strategy="SPREAD")(RayWorker)
        self._calls: dict[Any, PendingCall] = {}
        self._idle: list[Any] = []
        self._again: deque[Task] = deque()
        self._losses: Counter[int | None] = Counter()

    def start(self, num: int) -> None:
        """Ask for actors; they start when there is room for them."""
        for _ in range(num):
            actor = self._make.remote(self._spec)
            self._calls[actor.ready.remote()] = PendingCall(actor)

    def results(self, count: int) -> Iterator[tuple[Row, Files]]:
        """Yield what becomes of `count` tasks; each of them once, as only a result that has come here counts."""
        heard = time.monotonic()
        while count:
            done, _ = self._ray.wait(list(self._calls), timeout=LOOK_EVERY)
            if done or any(pending.task for pending in self._calls.values()):
                heard = time.monotonic()
            self._check_wait(time.monotonic() - heard)
            for call in done:
                pending = self._calls.pop(call)
                try:
                    found = self._ray.get(call)
                except self._ray.exceptions.RayTaskError as error:
                    raise as_own_error(error) from error
                except self._ray.exceptions.RayError as error:
                    self._lose(pending, error)
                    continue
                self._losses[None] = 0
                if found is not None:
                    count -= 1
                    if pending.task is not None:
                        check_found(pending.task.index, *found)
                    yield found
                self._assign(pending.actor)

    def close(self) -> None:
        """End all actors: those without work by themselves, so that they clear up."""
        self._ray.wait(
            [actor.close.remote() for actor in self._idle] or [self._ray.put(None)],
            timeout=CLOSE_LIMIT,
            num_returns=max(len(self._idle), 1),
        )
        for actor in [*self._idle, *(pending.actor for pending in self._calls.values())]:
            self._ray.kill(actor)

    def _assign(self, actor: Any) -> None:
        """Give an actor its next task, or keep it for one that must be run again."""
        task = self._again.popleft() if self._again else next(self._tasks, None)
        if task is None:
            self._idle.append(actor)
        else:
            self._calls[actor.run.remote(task)] = PendingCall(actor, task)

    def _lose(self, pending: PendingCall, error: Exception) -> None:
        """Replace an actor that was lost, and plan its episode again."""
        self._ray.kill(pending.actor)  # it may live where only its result was lost
        key = None if pending.task is None else pending.task.index
        self._losses[key] += 1
        if self._losses[key] >= MAX_LOSSES:
            what = "before they ran" if key is None else f"over episode {key}"
            raise ResourceError(
                f"{MAX_LOSSES} actors were lost {what}, the last with: {_first_line(error)} The likely cause is too "
                "little memory on the nodes, or nodes that are taken away. What was run is kept: go on with --resume."
            )
        if pending.task is not None:
            self._again.append(pending.task)
        if self._idle:
            self._assign(self._idle.pop())
        else:
            self.start(1)

    def _check_wait(self, seconds: float) -> None:
        if seconds > START_LIMIT:
            have, free = self._ray.cluster_resources(), self._ray.available_resources()
            raise ResourceError(
                f"No actor of the cluster has started within {START_LIMIT:g} s: of {have.get('CPU', 0):g} cores "
                f"{free.get('CPU', 0):g} are free. The likely cause is that other work has them, or that nodes are "
                "gone; see ray status. What was run is kept: go on with --resume."
            )


def as_own_error(error: Any) -> AquanavError:
    """Return what an actor raised as the error of this process."""
    if isinstance(error.cause, AquanavError):
        return error.cause
    return ResourceError(
        f"An actor of the cluster failed: {_lines(error.cause)[-1]} The likely cause is a node "
        "without aquanav or with another version of it. --debug shows where."
    )


def _first_line(error: Exception) -> str:
    return _lines(error)[0]


def _lines(error: BaseException) -> list[str]:
    """Return the lines of an error's message, or its type where it has no message."""
    return str(error).strip().splitlines() or [type(error).__name__]


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
