"""Policies for tests of evaluations in several processes, which find them by the name of this module."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, load_policy

TROUBLE = "AQUANAV_TEST_TROUBLE"
"""Environment variable: what happens at the fourth decision of which seeds, as "2 raises, 5 dies"."""
ONCE = "AQUANAV_TEST_ONCE"
"""Environment variable: path of a file that says that a process was killed already."""
PROCESSES = "AQUANAV_TEST_PROCESSES"
"""Environment variable: path of a file that gets a line per episode: the process that runs it."""


class Drifting:
    """Acts at random, without a generator of its own, but for its trouble."""

    def __init__(self) -> None:
        pairs = [entry.split(maxsplit=1) for entry in os.environ.get(TROUBLE, "").split(",") if entry]
        self._trouble = {int(seed): kind for seed, kind in pairs}
        self._seed, self._num = 0, 0

    def reset(self, seed: int) -> None:
        self._seed, self._num = seed, 0
        if PROCESSES in os.environ:
            row = {"seed": seed, "actor": os.getppid(), "node": grandparent()}
            with Path(os.environ[PROCESSES]).open("a") as stream:
                stream.write(json.dumps(row) + "\n")

    def act(self, observation: Any) -> Any:
        self._num += 1
        if self._num == 4 and self._seed in self._trouble:
            return suffer(self._trouble[self._seed])
        return np.random.randint(3, size=3)


def grandparent() -> int:
    """Return the parent of this process's parent: of an actor the node's process."""
    status = Path(f"/proc/{os.getppid()}/status").read_text()
    return int(status.split("PPid:")[1].split()[0])


def suffer(kind: str) -> Any:
    """Do what a bad policy, or a machine short of memory, does."""
    if kind == "raises":
        raise ValueError(f"no idea, says {object()!r}")
    if kind == "gives no number":
        return np.full(3, np.nan)
    if kind == "hangs":
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])  # as compiled code does that never comes back
        time.sleep(60.0)
    if kind == "dawdles":
        time.sleep(0.4)
        return np.random.randint(3, size=3)
    once = Path(os.environ[ONCE])
    if kind == "dies" or not once.exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return np.random.randint(3, size=3)


def line_of(text: str) -> int:
    """Return the first line of this file that holds a text."""
    lines = Path(__file__).read_text().splitlines()
    return next(number for number, line in enumerate(lines, 1) if text in line)


def load_drifting(name: str) -> LoadedPolicy:
    """Return the policy with the trouble that the environment names."""
    return dataclasses.replace(load_policy("baseline:random"), policy=Drifting(), name=name)


def drifting_options(folder: Path, output: Path, **options: Any) -> EvaluateOptions:
    """Return short episodes of which the first three failures are recorded."""
    rules: dict[str, Any] = {"max_decisions": 30, "record": "failures", "max_recordings": 3, "action_time_limit": 1.0}
    return EvaluateOptions(("drifting",), (folder,), output, **rules, **options)


if __name__ == "__main__":
    # The policy is loaded by its module's name: other processes know the module that runs by another.
    from tests.evaluate import policies

    choices = drifting_options(Path(sys.argv[1]), Path(sys.argv[2]), **json.loads(sys.argv[3]))
    evaluate(choices, lambda done, total: None, load=policies.load_drifting)
