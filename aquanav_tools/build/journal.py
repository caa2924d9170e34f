"""The journal of a build: which stage took how long and how much memory, shown while it runs and kept afterwards."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from aquanav_tools.machine import peak_memory
from aquanav_tools.types import Progress, Stages


@dataclass(frozen=True)
class StageRecord:
    """What one stage cost."""

    title: str
    seconds: float
    cpu_seconds: float
    """Of all threads: what it takes on an idle machine with one core, however busy this one was."""
    peak_memory_mb: float
    """Largest resident memory of the process up to the stage's end."""


def _keep_quiet(sentence: str) -> None:
    """Tell nobody."""


@dataclass
class Journal:
    """Collects the stages of one build."""

    display: Stages
    announce: Callable[[str], None] = _keep_quiet
    """Tells the user something before long work starts."""
    stages: list[StageRecord] = field(default_factory=list)
    notices: list[tuple[str, str]] = field(default_factory=list)
    """(code, sentence) of results that are poor but usable."""

    @contextlib.contextmanager
    def stage(self, title: str) -> Iterator[Progress]:
        """Run one stage; its body may call the progress it gets with (units done, units in all)."""
        began, cpu_began = time.perf_counter(), time.process_time()
        with self.display(title) as progress:
            yield progress
        peak = peak_memory()
        seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu_began
        self.stages.append(StageRecord(title, round(seconds, 3), round(cpu_seconds, 3), round(peak, 1)))

    def warn(self, code: str, sentence: str) -> None:
        """Note a result that is poor but usable."""
        self.notices.append((code, sentence))
