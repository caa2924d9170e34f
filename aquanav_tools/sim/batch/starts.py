"""Starts that are in no list: drawn on the host, each from its episode's seed, when an episode is about to begin."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.fleet_arrays import UNLISTED, Fleet, Starts, make_starts
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Pose

DrawStart = Callable[[int], Pose]
"""Returns the start of the episode with a seed from 0 to 2^32 - 1."""


class UnlistedStarts:
    """A start for each vehicle's next episode, where they are not drawn from the scenario's list."""

    def __init__(
        self, scenario: Scenario, vehicle: Vehicle, draw_start: DrawStart | None, num: int, listed: Starts, device: Any
    ) -> None:
        """Make room for `num` starts; without `draw_start` there are none, and kernels are given the listed ones."""
        self._scenario, self._vehicle, self._draw_start, self._device = scenario, vehicle, draw_start, device
        self._is_resting = np.zeros(num, dtype=np.bool_)
        self.starts = listed
        if draw_start is not None:
            self.starts = _blank_starts(num, listed.extra.shape[1], device)

    @property
    def is_used(self) -> bool:
        """Whether starts are drawn here at all."""
        return self._draw_start is not None

    def rest(self, vehicles: npt.ArrayLike) -> None:
        """Draw none for these vehicles until the next reset."""
        self._is_resting[np.asarray(vehicles, dtype=np.int64)] = True

    def reset(self) -> None:
        """Draw for all vehicles again."""
        self._is_resting[:] = False

    def draw(self, fleet: Fleet, is_asked: npt.NDArray[np.bool_], seeds: npt.NDArray[np.uint32]) -> None:
        """Write the starts of the vehicles that are asked for, (N,), whose next episodes have (N,) seeds."""
        chosen = np.flatnonzero(is_asked & ~self._is_resting)
        if self._draw_start is None or len(chosen) == 0:
            return
        poses = [self._draw_start(seed) for seed in seeds[chosen].tolist()]
        drawn = make_starts(np.array([self._vehicle.state_at(pose) for pose in poses]), self._scenario, "cpu")
        for name in Starts.vars:  # type: ignore[attr-defined]  # Warp makes the class a struct
            _put(getattr(self.starts, name), chosen, getattr(drawn, name).numpy())
        _put(fleet.wanted_starts, chosen, int(UNLISTED))


def _blank_starts(num: int, num_extra: int, device: Any) -> Starts:
    starts = Starts()
    for name, field in Starts.vars.items():  # type: ignore[attr-defined]
        shape = (num, num_extra) if name == "extra" else num
        setattr(starts, name, wp.zeros(shape, dtype=field.type.dtype, device=device))
    return starts


def _put(array: Any, rows: npt.NDArray[np.int64], values: Any) -> None:
    """Write rows of a device's array."""
    host = array.numpy()
    host[rows] = values
    if not array.device.is_cpu:  # where NumPy's array is not the same memory
        array.assign(host)
