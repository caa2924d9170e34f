"""Progress along a guide for chosen places, with no vehicle there."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.sim.batch.guide import Panels, is_at_goal, make_panels, remaining_at, tracked
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device
from aquanav_tools.types import Array, BoolArray, IntArray

wp.set_module_options(OPTIONS)


@wp.kernel
def _follow(
    panels: Panels, places: wp.array(dtype=wp.vec3d), first: int, gates: wp.array(dtype=wp.int32),
    remaining: wp.array(dtype=wp.float64),
):  # fmt: skip
    gate = int(first)
    for n in range(places.shape[0]):
        gate = tracked(places[n], panels, gate)
        gates[n] = gate
        remaining[n] = remaining_at(places[n], panels, gate)


@wp.kernel
def _measure(
    panels: Panels, places: wp.array(dtype=wp.vec3d), gates: wp.array(dtype=wp.int32),
    remaining: wp.array(dtype=wp.float64),
):  # fmt: skip
    i = wp.tid()
    remaining[i] = remaining_at(places[i], panels, gates[i])


@wp.kernel
def _ask(
    panels: Panels, places: wp.array(dtype=wp.vec3d), gate: int, tolerance: wp.float64, found: wp.array(dtype=wp.bool)
):
    i = wp.tid()
    found[i] = is_at_goal(places[i], remaining_at(places[i], panels, gate), tolerance, panels)


class Tracker:
    """The law of `sim/batch/guide.py` for one guide."""

    def __init__(self, guide: Guide) -> None:
        self._device = find_device("cpu")
        self._panels = make_panels(guide, self._device)

    def follow(self, places: Any, gate: int) -> tuple[IntArray, Array]:
        """Return the (N,) gates and metres to go of a vehicle that is at (N, 3) places in turn, from a gate."""
        at, num = self._places(places), len(places)
        gates = wp.zeros(num, dtype=wp.int32, device=self._device)
        remaining = wp.zeros(num, dtype=wp.float64, device=self._device)
        inputs = [self._panels, at, gate]
        wp.launch(_follow, dim=1, inputs=inputs, outputs=[gates, remaining], device=self._device)
        return gates.numpy(), remaining.numpy()

    def remaining(self, place: Any, gate: int) -> float:
        """Return the metres to go from a (3,) place in a gate."""
        found = wp.zeros(1, dtype=wp.float64, device=self._device)
        inputs = [self._panels, self._places([place]), wp.array([gate], dtype=wp.int32, device=self._device)]
        wp.launch(_measure, dim=1, inputs=inputs, outputs=[found], device=self._device)
        return float(found.numpy()[0])

    def are_at_goal(self, places: Any, tolerance: float) -> BoolArray:
        """Return which of (N, 3) places in the last gate are at the goal, with a tolerance, m."""
        found = wp.zeros(len(places), dtype=wp.bool, device=self._device)
        gate = self._panels.centres.shape[0] - 2
        inputs = [self._panels, self._places(places), gate, tolerance]
        wp.launch(_ask, dim=len(places), inputs=inputs, outputs=[found], device=self._device)
        return np.asarray(found.numpy(), dtype=bool)

    def _places(self, places: Any) -> Any:
        return wp.array(np.ascontiguousarray(places, dtype=np.float64), dtype=wp.vec3d, device=self._device)


def swum(guide: Guide, places: Array, gate: int | None = None) -> Array:
    """Return the (N,) metres to go all along (N, 3) places; the first is located, or in a gate."""
    return Tracker(guide).follow(places, guide.locate(places[0]) if gate is None else gate)[1]
