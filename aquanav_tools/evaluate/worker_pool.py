"""Running episodes in processes of their own: on all cores, and what brings a process down costs no other episode.

An episode whose process ends is run once more; where that ends too, the episode has failed. Episodes come back as
they end. Each depends on its number alone, so nothing depends on how many processes there are.
"""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import signal
import traceback
from collections import Counter, deque
from collections.abc import Generator, Iterator
from multiprocessing import connection
from typing import Any

from aquanav_tools.errors import AquanavError, ResourceError
from aquanav_tools.evaluate.episode_worker import EvaluationSpec, Plan, Row, Task, make_plan, open_worker
from aquanav_tools.evaluate.rollout import CallTimeout

EPISODES_PER_WORKER = 10
"""A process takes about as long to start as 20 short episodes, and works beside the others meanwhile."""
GRACE = 5.0
"""Time that a policy's call has to end by itself after its limit before its process is killed, s."""
LOOK_EVERY = 0.5
"""Interval at which policies that hang are looked for, s."""
MAX_TRIES = 2
"""Times that an episode is run whose process ends."""
END = "end"
MAX_LOSSES = 5
"""Processes that may end before they are ready, or over an episode that is not even run any more."""


def run_tasks(spec: EvaluationSpec, plan: Plan, tasks: Iterator[Task | None], count: int) -> Iterator[Row]:
    """Yield the journal's rows of `count` tasks as they end, run in this process or in several others."""
    num = num_workers(spec.options.workers, count, len(os.sched_getaffinity(0)))
    if num > 1:
        yield from run_in_processes(spec, num, tasks)
        return
    with open_worker(spec, plan, CallTimeout(spec.options.action_time_limit)) as worker:
        for task in tasks:
            if task is not None:
                yield worker.carry_out(task)


def num_workers(wanted: int | None, num_episodes: int, num_cores: int) -> int:
    """Return how many processes run so many episodes on so many cores."""
    if wanted is None:
        return min(num_cores, -(-num_episodes // EPISODES_PER_WORKER))
    return min(wanted, num_episodes)


def run_in_processes(spec: EvaluationSpec, num: int, tasks: Iterator[Task | None]) -> Generator[Row, None, None]:
    """Yield the journal's rows of episodes as they end.

    The next task is asked for when a process is free for it; None stands for one that depends on running episodes.
    The processes begin by importing the main module again: a script that calls this needs `if __name__ == "__main__"`.

    Raises:
        ResourceError: processes end again and again before they run.
    """
    pool = WorkerPool(spec, tasks)
    try:
        pool.start(num)
        yield from pool.rows()
    finally:
        pool.close()


class _Worker:
    """A process that runs, seen from outside."""

    def __init__(self, spec: EvaluationSpec) -> None:
        context = multiprocessing.get_context("spawn")
        self.timeout = CallTimeout(spec.options.action_time_limit, context.RawValue("d", 0.0))
        self.pipe, inner = context.Pipe()
        self.process = context.Process(target=_work, args=(spec, inner, self.timeout.began), daemon=True)
        self.process.start()
        inner.close()
        self.task: Task | None = None
        self.is_free = False

    def read(self) -> Any:
        """Return its message, or None where it has ended."""
        try:
            return self.pipe.recv() if self.pipe.poll() else None
        except (EOFError, OSError):
            return None

    def end(self) -> int:
        """End it and return its exit code."""
        self.process.kill()
        self.process.join()
        self.pipe.close()
        return self.process.exitcode or 0


class WorkerPool:
    """The processes and what they are at."""

    def __init__(self, spec: EvaluationSpec, tasks: Iterator[Task | None]) -> None:
        self._spec, self._tasks = spec, tasks
        self._again: deque[Task] = deque()
        self._workers: list[_Worker] = []
        self._losses: Counter[int | None] = Counter()

    def start(self, num: int) -> None:
        """Start processes."""
        self._workers += [_Worker(self._spec) for _ in range(num)]

    def close(self) -> None:
        """End all processes."""
        for worker in self._workers:
            worker.end()

    def rows(self) -> Iterator[Row]:
        """Yield rows until no task is left."""
        while self._workers:
            ends: dict[Any, _Worker] = {worker.pipe: worker for worker in self._workers}
            ends |= {worker.process.sentinel: worker for worker in self._workers}
            ready = {ends[end] for end in connection.wait(list(ends), LOOK_EVERY)}
            for worker in [worker for worker in self._workers if worker in ready]:
                message = worker.read()
                if message is None:
                    self._lose(worker, worker.end())
                    continue
                if isinstance(message, BaseException):
                    raise message
                self._losses[None] = 0
                if message:
                    yield message
                worker.is_free, worker.task = True, None
            for worker in [worker for worker in self._workers if worker.is_free]:
                self._assign(worker)
            self._end_hanging()

    def _assign(self, worker: _Worker) -> None:
        """Give a process its next task, let it wait where there is none yet, or let it go."""
        task = self._again.popleft() if self._again else next(self._tasks, END)
        if isinstance(task, str):
            self._workers.remove(worker)
            worker.end()
            return
        worker.is_free, worker.task = task is None, task
        if task is None:
            return
        try:
            worker.pipe.send(task)
        except OSError:
            self._lose(worker, worker.end())

    def _lose(self, worker: _Worker, exit_code: int) -> None:
        """Replace a process that has ended, and plan its episode again."""
        task = worker.task
        key = None if task is None else task.index
        self._losses[key] += 1
        if self._losses[key] >= MAX_LOSSES:
            raise ResourceError(
                f"A process that runs episodes {_ending(exit_code)}, {MAX_LOSSES} times in a row, before it ran. "
                f"{_cause(exit_code)} What was run is kept: go on with --resume."
            )
        if task is not None and self._losses[key] >= MAX_TRIES:
            task = dataclasses.replace(task, reason=task.reason or f"its process {_ending(exit_code)}, twice")
        self._replace(worker, task)

    def _end_hanging(self) -> None:
        """Kill processes whose policy hangs where no alarm reaches it."""
        for worker in [worker for worker in self._workers if worker.timeout.overrun > GRACE]:
            worker.end()
            task = worker.task
            self._replace(worker, task and dataclasses.replace(task, reason=worker.timeout.reason))

    def _replace(self, worker: _Worker, task: Task | None) -> None:
        self._workers.remove(worker)
        if task is not None:
            self._again.append(task)
        self.start(1)


def _cause(exit_code: int) -> str:
    if exit_code < 0:
        return "The likely cause is too little memory. Take fewer processes with --workers."
    return (
        'Its own message is above; a script that calls evaluate needs `if __name__ == "__main__":` around that. '
        "--workers 1 does without processes."
    )


def _ending(exit_code: int) -> str:
    """Return how a process ended."""
    if exit_code >= 0:
        return f"ended with exit code {exit_code}"
    try:
        return f"was ended by {signal.Signals(-exit_code).name}"
    except ValueError:
        return f"was ended by signal {-exit_code}"


def _work(spec: EvaluationSpec, pipe: Any, began: Any) -> None:
    """Run what the pipe asks for until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the whole group; the first process ends this one
    parent = multiprocessing.parent_process()

    def is_wanted() -> bool:
        return parent is None or parent.is_alive()

    try:
        with open_worker(spec, make_plan(spec), CallTimeout(spec.options.action_time_limit, began)) as worker:
            pipe.send({})
            while is_wanted():
                pipe.send(worker.carry_out(pipe.recv(), is_wanted))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    except AquanavError as error:
        pipe.send(error)
    except Exception:
        pipe.send(RuntimeError(f"A process that runs episodes failed.\n{traceback.format_exc()}"))
