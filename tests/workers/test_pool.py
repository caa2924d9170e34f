"""A pool's workers may die, raise, hang or never start: each is told by name, and tasks fare as they should."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.workers import pool as pool_module
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.worker import WorkerError, WorkerSpec
from tests.workers.objects import Adder, Job, fail_to_start, raise_at_start

SPEC = WorkerSpec(
    partial(Adder, 0), "adder", "sums ran", "All is kept.", clock_limit=0.5, late="took longer than 0.5 s"
)
CAUSES = {
    "is killed": (ResourceError, r"was ended by SIGKILL while sums ran in it\. The likely cause.* too little memory"),
    "exits": (ResourceError, r"ended with exit code 3 while sums ran in it\. What it printed above says why"),
    "raises": (WorkerError, r"raised ValueError: no idea \(objects\.py, line \d+\) while sums ran in it\."),
    "hangs": (WorkerError, r"gave no answer to 'suffer' within 0\.5 s while sums ran in it, and was ended\."),
}


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for workers that take too long more often, and give them less time."""
    monkeypatch.setattr(pool_module, "GRACE", 0.2)
    monkeypatch.setattr(pool_module, "LOOK_EVERY", 0.1)


def failed(job: Job, reason: str) -> Job:
    return dataclasses.replace(job, reason=reason)


def done(pool: WorkerPool, jobs: Iterator[Job | None]) -> dict[int, tuple[int, str]]:
    return {job.number: result for job, result in pool.results(jobs, "do", failed)}


def test_workers_in_step_keep_what_they_hold_and_answer_in_their_order() -> None:
    specs = [dataclasses.replace(SPEC, make=partial(Adder, first)) for first in (10, 20, 30)]
    with WorkerPool(PipeTransport(), specs) as pool:
        for total in (1, 2):
            pool.call("add", [[1, 2, 3]])
            assert pool.answers() == [10 + total, 20 + 2 * total, 30 + 3 * total]
        pool.call("pid")
        pids = pool.answers()
    assert len({*pids, os.getpid()}) == 4
    assert not any(is_alive(pid) for pid in pids)


@pytest.mark.parametrize("trouble", CAUSES)
def test_worker_in_step_that_comes_to_grief_is_told_by_its_name_and_cause(trouble: str, short: None) -> None:
    error, cause = CAUSES[trouble]
    with WorkerPool(PipeTransport(), dataclasses.replace(SPEC, call_limit=0.5), 2) as pool:
        pool.call("pid")
        pids = pool.answers()
        pool.call("suffer", [["once /", trouble]])  # the first does nothing, as / is there
        with pytest.raises(error, match=rf"^The adder 2 of 2 \(process {pids[1]}\) {cause}.* All is kept\.$"):
            pool.answers()


def test_error_that_is_a_sentence_already_comes_as_it_is() -> None:
    with WorkerPool(PipeTransport(), SPEC, 1) as pool:
        pool.call("suffer", [["refuses"]])
        with pytest.raises(InputError, match=r"^There is no such thing\. Name another\.$"):
            pool.answers()


def test_worker_killed_between_two_calls_is_told_by_the_next() -> None:
    with WorkerPool(PipeTransport(), SPEC, 2) as pool:
        pool.call("pid")
        os.kill(pool.answers()[0], 9)
        with pytest.raises(ResourceError, match=r"adder 1 of 2 \(process \d+\) was ended by SIGKILL"):
            for _ in range(2):
                pool.call("pid")
                pool.answers()


def test_tasks_whose_worker_dies_or_hangs_fail_with_the_reason_and_cost_no_other(short: None, tmp_path: Path) -> None:
    troubles = {1: f"once {tmp_path / 'was here'}", 3: "is killed", 4: "exits", 6: "hangs by the clock"}
    with WorkerPool(PipeTransport(), SPEC, 2) as pool:
        found = done(pool, (Job(n, troubles.get(n, "")) for n in range(8)))
    assert {number: square for number, (square, _) in found.items()} == {n: n**2 for n in range(8)}
    assert {number: reason for number, (_, reason) in found.items() if reason} == {
        3: "its process was ended by SIGKILL, twice",
        4: "its process ended with exit code 3, twice",
        6: "took longer than 0.5 s",
    }


@pytest.mark.parametrize(("trouble", "error"), [("raises", WorkerError), ("refuses", InputError)])
def test_task_at_which_a_worker_raises_ends_the_work(trouble: str, error: type[Exception]) -> None:
    cause = CAUSES["raises"][1] if trouble == "raises" else "There is no such thing"
    with WorkerPool(PipeTransport(), SPEC, 1) as pool, pytest.raises(error, match=cause):
        done(pool, iter([Job(0), Job(1, trouble)]))


def test_pool_does_one_lot_of_tasks_after_another_with_the_same_workers() -> None:
    with WorkerPool(PipeTransport(), SPEC, 2) as pool:
        pool.call("pid")
        before = pool.answers()
        for _ in range(2):
            assert done(pool, (Job(n) for n in range(5))) == {n: (n**2, "") for n in range(5)}
        pool.call("pid")
        assert pool.answers() == before


def test_task_that_depends_on_running_ones_is_asked_for_again_when_one_has_ended() -> None:
    with WorkerPool(PipeTransport(), SPEC, 2) as pool:
        found: dict[int, Any] = {}

        def jobs() -> Iterator[Job | None]:
            yield Job(0)
            while 0 not in found:
                yield None
            yield Job(1)

        for job, result in pool.results(jobs(), "do", failed):
            found[job.number] = result
    assert found == {0: (0, ""), 1: (1, "")}


def test_workers_that_end_before_they_are_ready_end_the_work_after_five() -> None:
    spec = dataclasses.replace(SPEC, make=fail_to_start)
    told = r"^The adder \d of 2 was ended by SIGKILL, the last of 5 that ended before it was ready\..*All is kept\.$"
    with WorkerPool(PipeTransport(), spec, 2) as pool, pytest.raises(ResourceError, match=told):
        done(pool, iter([Job(0)]))


def test_object_that_cannot_be_made_is_told_alike_to_tasks_and_in_step() -> None:
    spec = dataclasses.replace(SPEC, make=raise_at_start)
    told = re.compile(r"^The adder 1 of 1 \(process \d+\) raised KeyError: 'mesh' \(objects\.py, line \d+\) while")
    with WorkerPool(PipeTransport(), spec, 1) as pool, pytest.raises(WorkerError, match=told):
        done(pool, iter([Job(0)]))
    with WorkerPool(PipeTransport(), spec, 1) as pool, pytest.raises(WorkerError, match=told):
        pool.call("pid")


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
