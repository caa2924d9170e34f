"""A builder of drawn caves whose worker is killed over every cave. Light: a worker imports it."""

from __future__ import annotations

import os
import signal
from typing import Any

from aquanav_tools.build.generated_set import BuiltCave, CaveBuilder, CaveTask


class DyingBuilder(CaveBuilder):
    """Builds nothing."""

    def build(self, task: CaveTask) -> BuiltCave:
        """End the process, unless it did so twice."""
        if not task.fault:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().build(task)


def make_dying_builder(_clock: Any) -> DyingBuilder:
    """Return the builder."""
    return DyingBuilder()
