"""Policies for tests of evaluations in several processes, which find them by the name of this module."""

from __future__ import annotations

import dataclasses
import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.evaluate.policies import LoadedPolicy, load_policy

ONCE = "AQUANAV_TEST_ONCE"
"""Environment variable with the path of a file that says that a process was killed already."""


class Drifting:
    """Acts at random, but from the fourth decision of the episodes named in TROUBLE as these say."""

    TROUBLE = 2, 5
    """Seeds."""

    def __init__(self, kind: str) -> None:
        self._kind, self._seed, self._num = kind, 0, 0

    def reset(self, seed: int) -> None:
        self._seed, self._num = seed, 0

    def act(self, observation: Any) -> Any:
        self._num += 1
        if self._seed in self.TROUBLE and self._num == 4:
            trouble(self._kind)
            if self._kind == "gives no number":
                return np.full(3, np.nan)
        return np.random.randint(3, size=3)


def trouble(kind: str) -> None:
    """Do what a bad policy, or a machine short of memory, does."""
    if kind == "raises":
        raise ValueError(f"no idea, says {object()!r}")
    if kind == "hangs":
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])  # as compiled code does that never comes back
        time.sleep(60.0)
    is_first = not Path(os.environ.get(ONCE, os.devnull)).exists()
    if kind == "dies" or (kind == "dies once" and is_first):
        if kind == "dies once":
            Path(os.environ[ONCE]).touch()
        os.kill(os.getpid(), signal.SIGKILL)


def load_bad(name: str) -> LoadedPolicy:
    """Return a policy by the kind of its trouble, "none" for no trouble."""
    return dataclasses.replace(load_policy("baseline:random"), policy=Drifting(name), name=name)
