"""Workers that a calculation is shared out to: for tasks, each done by whoever is free, or all in step.

What befalls a worker is told alike in both ways: one that dies or is killed, that raises, that takes too long or never
starts becomes a sentence with its name, its place and the likely cause. A task whose worker ends is done once more;
where that ends too it has failed. Workers in step keep a state, so that the loss of one ends the work.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from aquanav_tools.errors import ResourceError
from aquanav_tools.workers.worker import READY, Transport, Worker, WorkerError, WorkerLostError, WorkerSpec

LOOK_EVERY = 0.5
"""Interval at which workers that take too long are looked for, s."""
GRACE = 5.0
"""Time that a worker has to end by itself what takes too long, s."""
MAX_TRIES = 2
"""Times that a task is done whose worker ends, where the task may be why."""
MAX_LOSSES = 5
"""Workers that may end in a row before they are ready, or over one task."""
END: Any = object()
"""Stands for the task after the last."""
TaskType = TypeVar("TaskType")


@dataclass
class _Attempt(Generic[TaskType]):
    """A task, and how often its worker has ended."""

    task: TaskType
    losses: int = 0


@dataclass
class _Slot:
    """A worker and what it is at."""

    worker: Worker
    method: str = ""
    """Which call has no answer yet; empty for none."""
    began: float = 0.0
    """The monotonic clock at that call, s."""
    attempt: _Attempt[Any] | None = None


class WorkerPool:
    """Workers with an object each, made alike; a context manager that ends them all."""

    def __init__(self, transport: Transport, specs: WorkerSpec | Sequence[WorkerSpec], num: int = 0) -> None:
        """Start workers; they get ready side by side.

        Args:
            transport: How they are reached.
            specs: One for each worker, with one name; or one for all of them.
            num: Workers, where there is one specification for all.
        """
        self._transport = transport
        self._specs = [specs] * num if isinstance(specs, WorkerSpec) else list(specs)
        self._slots: list[_Slot] = []
        self._num_early = 0
        try:
            for number in range(len(self._specs)):
                self._slots.append(self._start(number))
        except BaseException:
            self.close()
            raise

    def __len__(self) -> int:
        return len(self._slots)

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def workers(self) -> list[Worker]:
        """The workers as they are now."""
        return [slot.worker for slot in self._slots]

    def close(self) -> None:
        """End all workers. Closing twice does nothing."""
        self._transport.close([slot.worker for slot in self._slots if not slot.method])
        for slot in self._slots:
            slot.worker.end()
        self._slots.clear()

    # Workers in step

    def call(self, method: str, columns: Sequence[Sequence[Any]] = ()) -> None:
        """Have a method called in each worker, which then work side by side; `answers` waits for them.

        Args:
            method: Of the workers' objects.
            columns: Arguments; of each the nth value goes to worker n.

        Raises:
            ResourceError: a worker has ended.
            WorkerError: the object of one raised an error, or took too long.
        """
        for number, slot in enumerate(self._slots):
            if slot.method:
                self._answer_of(slot, self._transport.start_limit)
            try:
                self._ask(slot, method, *(column[number] for column in columns))
            except WorkerLostError as lost:
                raise self._loss(number, lost) from lost

    def answers(self) -> list[Any]:
        """Return what the method returned in each worker that was called.

        Raises:
            ResourceError: a worker has ended.
            WorkerError: the object of one raised an error, or took too long.
            AquanavError: the object of one raised it.
        """
        return [self._answer_of(slot, self._spec_of(slot).call_limit) for slot in self._slots]

    def _answer_of(self, slot: _Slot, limit: float) -> Any:
        number = self._slots.index(slot)
        try:
            while not slot.worker.is_done(LOOK_EVERY):
                self._check_time(slot, limit)
            reply = slot.worker.answer()
        except WorkerLostError as lost:
            raise self._loss(number, lost) from lost
        slot.method = ""
        return reply.outcome()

    def _check_time(self, slot: _Slot, limit: float) -> None:
        if time.monotonic() - slot.began <= limit:
            return
        slot.worker.end()
        spec = self._spec_of(slot)
        raise WorkerError(
            f"The {slot.worker.name} ({slot.worker.place}) gave no answer to '{slot.method}' within {limit:g} s while "
            f"{spec.activity} in it, and was ended. The likely cause is code of one's own that never ends, or a "
            f"machine without memory. {spec.advice}"
        )

    def _loss(self, number: int, lost: WorkerLostError) -> ResourceError:
        worker, spec = self._slots[number].worker, self._specs[number]
        return ResourceError(
            f"The {worker.name} ({worker.place}) {lost.ending} while {spec.activity} in it. {lost.cause} {spec.advice}"
        )

    # Tasks, each for whoever is free

    def results(
        self, tasks: Iterator[TaskType | None], method: str, fail: Callable[[TaskType, str], TaskType]
    ) -> Iterator[tuple[TaskType, Any]]:
        """Yield each task as it ends, with what a method of a worker's object returned for it.

        The next task is asked for when a worker is free for it; None stands for one that depends on tasks not yet
        done. Workers that end are replaced.

        Args:
            tasks: Arguments of the method.
            method: Of the workers' objects.
            fail: Returns what is done in place of a task that brings its worker down, or is ended for taking too long,
                from the task and why.

        Raises:
            ResourceError: workers end again and again, or none starts.
            WorkerError: the object of one raised an error.
            AquanavError: the object of one raised it.
        """
        again: deque[_Attempt[TaskType]] = deque()
        heard, is_exhausted = time.monotonic(), False
        while True:
            for slot in [slot for slot in self._slots if not slot.method]:
                attempt = again.popleft() if again else None
                if attempt is None and not is_exhausted:
                    task = next(tasks, END)
                    is_exhausted = task is END
                    attempt = None if is_exhausted or task is None else _Attempt(task)
                if attempt is not None:
                    self._assign(slot, attempt, method, again, fail)
            if is_exhausted and not again and not any(slot.attempt for slot in self._slots):
                return
            done = self._transport.done([slot.worker for slot in self._slots if slot.method], LOOK_EVERY)
            if done or any(slot.attempt for slot in self._slots):
                heard = time.monotonic()
            self._check_start(time.monotonic() - heard)
            for slot in [slot for slot in self._slots if slot.worker in done]:
                yield from self._take(slot, again, fail)
            self._end_hanging(again, fail)

    def _assign(self, slot: _Slot, attempt: _Attempt[Any], method: str, again: deque[Any], fail: Any) -> None:
        slot.attempt = attempt
        try:
            self._ask(slot, method, attempt.task)
        except WorkerLostError as lost:
            self._lose(slot, lost, again, fail)

    def _take(self, slot: _Slot, again: deque[Any], fail: Any) -> Iterator[tuple[Any, Any]]:
        """Yield what a worker answers; where it has ended, replace it."""
        try:
            reply = slot.worker.answer()
        except WorkerLostError as lost:
            self._lose(slot, lost, again, fail)
            return
        attempt, slot.method, slot.attempt = slot.attempt, "", None
        self._num_early = 0
        result = reply.outcome()
        if attempt is not None:
            yield attempt.task, result

    def _lose(self, slot: _Slot, lost: WorkerLostError, again: deque[Any], fail: Any) -> None:
        """Replace a worker that has ended, and have its task done again."""
        attempt, spec = slot.attempt, self._spec_of(slot)
        if attempt is None:
            self._num_early += 1
        else:
            attempt.losses += 1
        num, what = (self._num_early, "before it was ready") if attempt is None else (attempt.losses, "over one task")
        if num >= MAX_LOSSES:
            raise ResourceError(
                f"The {slot.worker.name} {lost.ending}, the last of {num} that ended {what}. {lost.cause} {spec.advice}"
            )
        if attempt is not None:
            if self._transport.blames_tasks and num >= MAX_TRIES:
                attempt.task = fail(attempt.task, f"its process {lost.ending}, twice")
            again.append(attempt)
        self._replace(slot)

    def _end_hanging(self, again: deque[Any], fail: Any) -> None:
        """End workers whose object takes too long over something where it cannot end that by itself."""
        for slot in [slot for slot in self._slots if slot.worker.overrun > GRACE]:
            if slot.attempt is not None:
                slot.attempt.task = fail(slot.attempt.task, self._spec_of(slot).late)
                again.append(slot.attempt)
            self._replace(slot)

    def _check_start(self, seconds: float) -> None:
        if seconds > self._transport.start_limit:
            spec = self._specs[0]
            raise ResourceError(
                f"No {spec.name} has started within {self._transport.start_limit:g} s"
                f"{self._transport.waiting_text()} {spec.advice}"
            )

    # Either way

    def _start(self, number: int) -> _Slot:
        spec = self._specs[number]
        worker = self._transport.start(spec, f"{spec.name} {number + 1} of {len(self._specs)}")
        slot = _Slot(worker)
        self._ask(slot, READY)
        return slot

    def _replace(self, slot: _Slot) -> None:
        slot.worker.end()
        number = self._slots.index(slot)
        self._slots[number] = self._start(number)

    def _ask(self, slot: _Slot, method: str, *arguments: Any) -> None:
        slot.worker.call(method, *arguments)
        slot.method, slot.began = method, time.monotonic()

    def _spec_of(self, slot: _Slot) -> WorkerSpec:
        return self._specs[self._slots.index(slot)]
