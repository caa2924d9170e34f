"""The law of the water asked at chosen places, with no vehicle in it."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.batch.field import Grid, make_grid
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device
from aquanav_tools.sim.batch.water import Water, drawn_phase, make_water, stir, swell_at, water_at
from aquanav_tools.sim.water import water_of
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.kernel
def _draw(water: Water, seeds: wp.array(dtype=wp.int32), decision: int, coefficients: wp.array2d(dtype=f64)):
    i = wp.tid()
    stir(coefficients, water, seeds[i], i, decision)


@wp.kernel
def _phases(seeds: wp.array(dtype=wp.int32), phases: wp.array(dtype=f64)):
    i = wp.tid()
    phases[i] = drawn_phase(seeds[i])


@wp.kernel
def _velocities(
    water: Water, grid: Grid, coefficients: wp.array2d(dtype=f64), phases: wp.array(dtype=f64),
    places: wp.array(dtype=wp.vec3d), velocities: wp.array2d(dtype=wp.vec3d),
):  # fmt: skip
    i, j = wp.tid()
    velocities[i, j] = water_at(water, grid, coefficients, i, phases[i], places[j])


@wp.kernel
def _swell(water: Water, phase: f64, places: wp.array(dtype=wp.vec3d), velocities: wp.array(dtype=wp.vec3d)):
    i = wp.tid()
    velocities[i] = swell_at(water.swell, phase, places[i])


class Episodes:
    """The water of a scenario in as many episodes as there are seeds."""

    def __init__(
        self, scenario: Scenario, current: Current | None = None, seeds: Any = (0,), duration: float = 0.1
    ) -> None:
        self._device = find_device("cpu")
        self._grid = make_grid(scenario.field, self._device)
        parts = water_of(scenario, current)
        self.water: Any = make_water(parts, scenario.field, self._grid, duration, self._device)
        self._seeds = wp.array(np.array(seeds), dtype=wp.int32, device=self._device)
        self.num = len(self._seeds)
        self.coefficients = wp.zeros((self.num, self.water.kept.shape[0]), dtype=f64, device=self._device)
        self.phases = wp.zeros(self.num, dtype=f64, device=self._device)
        self._decision = 0
        self._launch(_phases, [self._seeds], self.phases)
        self._stir()

    def advance(self) -> None:
        """Let a decision pass."""
        self._decision += 1
        self.phases.numpy()[:] += self.water.phase_step
        self._stir()

    def velocities(self, places: Array) -> Array:
        """Return the (N, P, 3) velocities in N episodes at (P, 3) places, m/s."""
        found = wp.zeros((self.num, len(places)), dtype=wp.vec3d, device=self._device)
        at = wp.array(np.ascontiguousarray(places), dtype=wp.vec3d, device=self._device)
        inputs = [self.water, self._grid, self.coefficients, self.phases, at]
        wp.launch(_velocities, dim=found.shape, inputs=inputs, outputs=[found], device=self._device)
        result: Array = found.numpy()
        return result

    def swell(self, phase: float, places: Array) -> Array:
        """Return the (P, 3) velocities of the surface's waves alone at (P, 3) places, m/s."""
        found = wp.zeros(len(places), dtype=wp.vec3d, device=self._device)
        at = wp.array(np.ascontiguousarray(places), dtype=wp.vec3d, device=self._device)
        self._launch(_swell, [self.water, phase, at], found)
        result: Array = found.numpy()
        return result

    def _stir(self) -> None:
        self._launch(_draw, [self.water, self._seeds, self._decision], self.coefficients)

    def _launch(self, kernel: Any, inputs: list[Any], output: Any) -> None:
        wp.launch(kernel, dim=output.shape[0], inputs=inputs, outputs=[output], device=self._device)
