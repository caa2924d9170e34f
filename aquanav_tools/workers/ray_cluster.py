"""Workers that are actors of a Ray cluster, on the cores of many machines.

An actor that is lost was killed from outside or with its machine, which says nothing about what it was at.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from aquanav_tools.errors import AquanavError, InputError, ResourceError
from aquanav_tools.libraries import require
from aquanav_tools.workers.worker import Reply, Served, WorkerLostError, WorkerSpec

ADDRESS = re.compile(r"auto|[^\s:/]+:\d{1,5}")
"""Of a cluster."""
ANSWER_LIMIT = 30.0
"""Time that a cluster has to answer, s. Ray itself goes on trying for minutes."""
START_LIMIT = 300.0
"""Time in which an actor must start when none runs, s."""
CLOSE_LIMIT = 5.0
"""Time that the objects of actors without work have to clear up, s."""
PROBE = "import sys, ray; ray.init(sys.argv[1], logging_level='ERROR', log_to_driver=False)"


def load_ray() -> Any:
    """Return the library, which then tells nobody that it is used.

    Raises:
        LibraryError: it is not installed.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    require("--ray", "ray", otherwise=", on every node")
    import ray

    return ray


@contextlib.contextmanager
def connected(address: str) -> Iterator[RayTransport]:
    """Connect with a cluster for the body's time; where a script has done so already, leave it as it is.

    Raises:
        ResourceError: Ray is not installed, or the cluster does not answer.
    """
    ray = load_ray()
    if ray.is_initialized():
        yield RayTransport(ray)
        return
    _probe(address)
    ray.init(address, logging_level="ERROR")
    try:
        yield RayTransport(ray)
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
class MakeAsAtHome:
    """Makes a worker's object on a node as on the first machine: in the same folder, by the same code."""

    make: Callable[[Any], Any]
    versions: Callable[[], dict[str, str]]
    """Returns the versions, of the machine that asks, of what the work depends on."""
    wanted: dict[str, str]
    """The first machine's."""
    folder: str
    """The first machine's working directory, from which relative paths count."""

    def __call__(self, clock: Any) -> Any:
        """Return the object.

        Raises:
            AquanavError: this machine is not like the first, or the object cannot be made on it.
        """
        try:
            self._check()
            return self.make(clock)
        except AquanavError as error:
            raise of_this_node(error) from error

    def _check(self) -> None:
        here = self.versions()
        different = [f"{part} {here[part]}, not {known}" for part, known in self.wanted.items() if here[part] != known]
        if different:
            raise InputError(
                f"It has {'; '.join(different)}. Results depend on these: install the same version of aquanav with the "
                "same constraints.txt on every node."
            )
        try:
            os.chdir(self.folder)
        except OSError as cause:
            raise InputError(f"It cannot enter the working directory {self.folder}: {cause}.") from cause


def of_this_node(error: AquanavError) -> AquanavError:
    """Return an error with the name of the node that it was raised on."""
    return type(error)(
        f"The node {platform.node()} cannot take part: {error} The working directory, the policy and the scenarios "
        "must lie at the same paths on every node."
    )


def as_at_home(make: Callable[[Any], Any], versions: Callable[[], dict[str, str]]) -> MakeAsAtHome:
    """Return what makes an object on a node as it would be made here."""
    return MakeAsAtHome(make, versions, versions(), os.getcwd())


class RayTransport:
    """Starts actors; see `Transport`."""

    blames_tasks = False

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        choices: dict[str, Any] = {"num_cpus": 1, "max_restarts": 0, "max_task_retries": 0}
        self._make = ray.remote(**choices, scheduling_strategy="SPREAD")(_Actor)
        self._specs: dict[int, tuple[WorkerSpec, Any]] = {}
        """Specifications in Ray's store, by their identity: sent once, however many actors take them."""
        self.start_limit = START_LIMIT

    @property
    def num_cores(self) -> int:
        """Of the whole cluster."""
        return int(self._ray.cluster_resources().get("CPU", 1))

    def start(self, spec: WorkerSpec, name: str) -> RayWorker:
        """Ask for an actor; it starts when there is room for it."""
        if id(spec) not in self._specs:
            self._specs[id(spec)] = spec, self._ray.put(spec)
        return RayWorker(self._ray, self._make.remote(self._specs[id(spec)][1], name), name)

    def done(self, workers: Sequence[RayWorker], timeout: float) -> list[RayWorker]:
        """Return the workers that have an answer or are lost, once there is one."""
        ready, _ = self._ray.wait([worker.pending for worker in workers], timeout=timeout)
        return [worker for worker in workers if worker.pending in ready]

    def close(self, idle: Sequence[RayWorker]) -> None:
        """Let the objects of idle actors clear up."""
        if idle:
            closing = [worker.actor.close.remote() for worker in idle]
            self._ray.wait(closing, timeout=CLOSE_LIMIT, num_returns=len(closing))

    def waiting_text(self) -> str:
        """Return how many cores there are."""
        have, free = (found.get("CPU", 0) for found in (self._ray.cluster_resources(), self._ray.available_resources()))
        return (
            f": of {have:g} cores {free:g} are free. The likely cause is "
            "that other work has them, or that nodes are gone; see ray status."
        )


class _Actor:
    """What Ray runs on a node."""

    def __init__(self, spec: WorkerSpec, name: str) -> None:
        self._served = Served(spec, ctypes.c_double(0.0), name, f"process {os.getpid()} of the node {platform.node()}")

    def call(self, method: str, arguments: Sequence[Any]) -> Reply:
        """Return what came of a call."""
        return self._served.call(method, arguments)

    def close(self) -> None:
        """Let the object clear up."""
        self._served.close()


class RayWorker:
    """An actor; see `Worker`."""

    place = "an actor of the Ray cluster"
    overrun = 0.0
    """Its clock is on the node."""

    def __init__(self, ray: Any, actor: Any, name: str) -> None:
        self._ray, self.actor, self.name = ray, actor, name
        self.pending: Any = None
        """Ray's reference to the answer of the last call."""

    def call(self, method: str, *arguments: Any) -> None:
        """Have a method called; that the actor is lost shows in the answer."""
        self.pending = self.actor.call.remote(method, arguments)

    def is_done(self, timeout: float) -> bool:
        """Return whether there is an answer, or the actor is lost, within a time."""
        return bool(self._ray.wait([self.pending], timeout=timeout)[0])

    def answer(self) -> Reply:
        """Return what came of the call."""
        try:
            reply: Reply = self._ray.get(self.pending)
        except self._ray.exceptions.RayTaskError as error:
            raise as_own_error(error) from error
        except self._ray.exceptions.RayError as error:
            self.end()  # it may live where only its answer was lost
            raise WorkerLostError(
                f"was lost ({_lines(error)[0]})",
                "The likely cause is too little memory on the nodes, or nodes that are taken away.",
            ) from error
        return reply

    def end(self) -> str:
        """End the actor."""
        self._ray.kill(self.actor)
        return "was ended"


def as_own_error(error: Any) -> AquanavError:
    """Return what kept an actor from answering at all as the error of this process."""
    if isinstance(error.cause, AquanavError):
        return error.cause
    return ResourceError(
        f"An actor of the cluster failed: {_lines(error.cause)[-1]} The likely cause is a node "
        "without aquanav or with another version of it. --debug shows where."
    )


def _lines(error: BaseException) -> list[str]:
    """Return the lines of an error's message, or its type where it has no message."""
    return str(error).strip().splitlines() or [type(error).__name__]
