"""Which vehicles a kernel computes."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.state import BatchState

wp.set_module_options(OPTIONS)


@wp.func
def chosen(state: BatchState, row: int, only_restarted: int):
    """Return the vehicle that is computed at a row; -1 where it is not asked for."""
    i = state.order[row]
    if only_restarted == 1 and state.restarted[i] == 0:
        return -1
    return i
