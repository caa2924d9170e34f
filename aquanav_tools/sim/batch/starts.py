"""Starts that are in no list: drawn on the host, each from its episode's seed, when an episode is about to begin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.caves import Starts, gates_at, make_starts
from aquanav_tools.sim.batch.runtime import put_rows
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Pose

DRAWN, UNLISTED = wp.constant(-1), wp.constant(-2)
"""In place of a start's index: it is to be drawn from the list; it is the vehicle's own, in a list of its own."""


@dataclass(frozen=True, eq=False)
class CaveStarts:
    """What draws the starts in one cave."""

    scenario: Scenario
    vehicle: Vehicle
    draw: Callable[[int], Pose]
    """Returns the start of the episode with a seed from 0 to 2^32 - 1."""


class UnlistedStarts:
    """A start for each vehicle's next episode, where they are not drawn from the scenarios' lists."""

    def __init__(self, draws: Sequence[CaveStarts] | None, num: int, num_extra: int, device: Any) -> None:
        """Make room for `num` starts with so many extra values; without what draws them in each cave there are none."""
        self._draws = None if draws is None else list(draws)
        self._is_retired = np.zeros(num, dtype=np.bool_)
        self.starts = _blank_starts(num if draws is not None else 1, num_extra, device)

    @property
    def is_used(self) -> bool:
        """Whether starts are drawn here at all."""
        return self._draws is not None

    def put(self, cave: int, draws: CaveStarts) -> None:
        """Draw the starts in a cave from now on by something else: another cave has taken its place."""
        assert self._draws is not None, "starts are listed"
        self._draws[cave] = draws

    def retire(self, vehicles: npt.ArrayLike) -> None:
        """Draw none for these vehicles until the next reset."""
        self._is_retired[np.asarray(vehicles, dtype=np.int64)] = True

    def reset(self) -> None:
        """Draw for all vehicles again."""
        self._is_retired[:] = False

    def draw(self, state: BatchState, vehicles: npt.NDArray[np.integer], seeds: npt.NDArray[np.uint32]) -> None:
        """Write the starts of (n,) vehicles whose next episodes have (n,) seeds."""
        if self._draws is None:
            return
        is_active = ~self._is_retired[vehicles]
        chosen, seeds = vehicles[is_active], seeds[is_active]
        if len(chosen) == 0:
            return
        caves = state.cave_of.numpy()[chosen]
        for index in np.unique(caves).tolist():
            rows, draws = chosen[caves == index], self._draws[index]
            poses = [draws.draw(seed) for seed in seeds[caves == index].tolist()]
            states = np.array([draws.vehicle.state_at(pose) for pose in poses])
            drawn = make_starts(states, gates_at(draws.scenario, states[:, :3]), "cpu")
            for name in Starts.vars:  # type: ignore[attr-defined]  # Warp makes the class a struct
                put_rows(getattr(self.starts, name), rows, getattr(drawn, name).numpy())
        put_rows(state.wanted_starts, chosen, int(UNLISTED))


def _blank_starts(num: int, num_extra: int, device: Any) -> Starts:
    starts = Starts()
    for name, field in Starts.vars.items():  # type: ignore[attr-defined]
        shape = (num, num_extra) if name == "extra" else num
        setattr(starts, name, wp.zeros(shape, dtype=field.type.dtype, device=device))
    return starts
