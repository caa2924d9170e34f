"""The water of an episode: how fast it moves at a place and time, from the scenario's flow, its eddies and its waves.

    u(x, t) = strength (1 + g(t)) flow(x) + turbulence strength sum_n eddies_n(x) c_n(t) + waves(x, t)

The flow from portal to portal and the eddies lose no water and pass no wall, and so does every sum of them. The gust g
and the eddies' coefficients c follow Ornstein-Uhlenbeck processes, taken by their exact discretisation: they have
their stationary variance and correlation time at any step. In a cave with fewer than two portals nothing flows through;
there the current is eddies alone, whose root mean square speed is CLOSED_SHARE of the strength.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from aquanav_tools.cave.water.eddies import add_eddies, draw_waves
from aquanav_tools.cave.water.flow import add_velocity
from aquanav_tools.errors import ScenarioError
from aquanav_tools.scenario.schema import PRESETS, Current, Scenario, check_current
from aquanav_tools.sim.waves import add_waves, wave_parameters
from aquanav_tools.types import Array

CLOSED_SHARE = 0.62
"""Of the strength, where nothing flows through: speeds of three normal components exceed 1 / 0.62 of their root mean
square in 5 % of places (chi distribution), so that the strength is as rare there as the narrowest section elsewhere."""
GUST_SIZE = 0.1
"""Standard deviation of the flow's strength about its mean; chosen: a flow that swells but never turns."""
GUST_TIME = 20.0
"""Its correlation time, s; chosen: several times as long as a vehicle's own response."""
SHORTEST, LONGEST = 0.5, 60.0
"""Bounds on the correlation times of eddies, s."""


class WaterParts(NamedTuple):
    """What the water of a scenario is made of."""

    uniform: Array
    """(3,) one velocity everywhere, m/s."""
    flow: tuple[Any, Any, Array, float]
    """Bricks, samples, origin and spacing of the flow, as `Flow.grid`."""
    flow_scale: float
    """Mean speed through the narrowest section, m/s."""
    waves: Array
    """(W, 8) the eddies' waves, as `eddies.draw_waves` has them."""
    eddy_scale: float
    """Root mean square speed of the eddies, m/s."""
    times: Array
    """(1 + 2 W) correlation times of the gust, the waves' cosines and their sines, s."""
    swell: Array
    """(7,) the surface's waves, as `waves.wave_parameters` has them; zeros where there are none."""


class Water:
    """Currents and waves of one scenario. `reset`, then `advance` once per decision and ask for `velocity`."""

    def __init__(self, scenario: Scenario, current: Current | None = None) -> None:
        """Prepare the currents.

        Args:
            scenario: the cave, its flow and its water.
            current: a preset, a strength, m/s, or one velocity everywhere, m/s; None takes the scenario's.

        Raises:
            ScenarioError: the scenario has no flow, though it has portals for one.
            ValueError: the current is no preset, or too fast.
        """
        settings = scenario.settings.water
        chosen = settings.current if current is None else current
        check_current(chosen)
        self._uniform = np.zeros(3) if np.ndim(chosen) == 0 else np.array(chosen, dtype=np.float64)
        self.strength = _strength(chosen)
        """Mean speed through the narrowest section, m/s."""
        self._flow_scale = self.strength if scenario.flow is not None else 0.0
        self._eddy_scale = abs(self.strength) * (settings.turbulence if scenario.flow is not None else CLOSED_SHARE)
        if self.strength and scenario.flow is None and len(scenario.cavity.portals) > 1:
            raise ScenarioError(
                f"The scenario {scenario.name} has no flow between its {len(scenario.cavity.portals)} portals: it was "
                "built before aquanav knew currents, or no way between them is wide enough. Build it again, or give "
                "one velocity for all of the water."
            )
        flow = None if scenario.flow is None or not self.strength else scenario.flow
        self._flow_grid = _no_grid() if flow is None else flow.grid
        self._field_grid = scenario.field.grid
        self._waves, times = self._draw_eddies(scenario, settings.seed)
        self._times = np.concatenate([[GUST_TIME], times, times])
        self._coefficients, self._noise = np.zeros_like(self._times), np.zeros_like(self._times)
        self._kept, self._fresh, self._kept_dt = np.ones_like(self._times), np.zeros_like(self._times), 0.0
        self._swell = (
            wave_parameters(settings.waves, settings.surface)
            if settings.surface is not None and settings.waves.height > 0.0
            else np.zeros(7)
        )
        self._swell_phase = 0.0
        self.is_constant = is_constant(scenario, current)
        """Whether the water has one velocity at all places and times."""
        self._rng = np.random.default_rng(0)
        self._velocity = np.empty(3)

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: draw the coefficients from their stationary distribution."""
        self._rng = rng
        if not self.is_constant:
            rng.standard_normal(out=self._coefficients)
            self._swell_phase = rng.uniform(0.0, 2.0 * np.pi)

    def advance(self, dt: float) -> None:
        """Let time pass, s."""
        if self.is_constant:
            return
        if dt != self._kept_dt:
            self._kept, self._kept_dt = np.exp(-dt / self._times), dt
            self._fresh = np.sqrt(1.0 - self._kept**2)
        self._rng.standard_normal(out=self._noise)
        _pass_time(self._coefficients, self._kept, self._fresh, self._noise)
        self._swell_phase += self._swell[3] * dt

    def velocity(self, position: Array) -> Array:
        """Return the (3,) velocity of the water at a place, world frame, m/s. Overwritten by the next call.

        Args:
            position: (3,) or more, of which the first three are the place, m: a state is read as it is.
        """
        if self.is_constant:
            self._velocity[:] = self._uniform
        else:
            _water_velocity(position, *self._arrays, self._velocity)
        return self._velocity

    def velocities(self, positions: Array) -> Array:
        """Return the (N, 3) velocity of the water at (N, 3) places, world frame, m/s."""
        positions = np.ascontiguousarray(positions, dtype=np.float64)
        velocities = np.empty_like(positions)
        _water_velocities(positions, *self._arrays, velocities)
        return velocities

    @property
    def parts(self) -> WaterParts:
        """What the water is made of, for other backends."""
        flow, eddies = (self._flow_grid, self._flow_scale), (self._waves, self._eddy_scale)
        return WaterParts(self._uniform, *flow, *eddies, self._times, self._swell)

    @property
    def _arrays(self) -> tuple[object, ...]:
        """What compiled functions read, in the order of `_water_velocity`."""
        flow = self._flow_scale * (1.0 + GUST_SIZE * self._coefficients[0])
        scales = (flow, self._eddy_scale, self._swell_phase)
        return self._uniform, self._flow_grid, self._field_grid, self._waves, self._coefficients, self._swell, scales

    def _draw_eddies(self, scenario: Scenario, seed: int) -> tuple[Array, Array]:
        """Return the eddies' waves and the time each keeps its phase, s: that in which the eddy turns over."""
        if not self._eddy_scale:
            return np.zeros((0, 8)), np.zeros(0)
        usual = float(np.median([panel.clearance for panel in scenario.guide.panels]))
        waves = draw_waves(scenario.field, usual, np.random.default_rng(seed))
        return waves, np.clip(waves[:, 6] / (2.0 * np.pi * self._eddy_scale), SHORTEST, LONGEST)


def mean_velocities(scenario: Scenario, current: Current | None, points: Array) -> Array:
    """Return the (N, 3) velocity of the water at (N, 3) places without gusts, eddies and waves, world frame, m/s.

    Args:
        scenario: the cave and its flow; without a flow only one velocity everywhere moves it.
        current: as `Water` takes it; None takes the scenario's.
        points: world, m.
    """
    chosen = scenario.settings.water.current if current is None else current
    if np.ndim(chosen) == 0:
        still = np.zeros_like(points)
        return still if scenario.flow is None else _strength(chosen) * scenario.flow.velocity(points)
    return np.broadcast_to(np.array(chosen, dtype=np.float64), points.shape)


def is_constant(scenario: Scenario, current: Current | None = None) -> bool:
    """Return whether the water of a scenario, or another current in it, has one velocity at all places and times."""
    settings = scenario.settings.water
    has_waves = settings.surface is not None and settings.waves.height > 0.0
    return not _strength(settings.current if current is None else current) and not has_waves


def _strength(current: Current) -> float:
    if isinstance(current, str):
        return PRESETS[current]
    return float(current) if np.ndim(current) == 0 else 0.0  # type: ignore[arg-type]


def _no_grid() -> tuple[Array, Array, Array, float]:
    """Return the grid of a flow that is still everywhere."""
    samples = np.zeros((1, 1, 1, 1, 3), dtype=np.float32)
    return np.zeros((0, 0, 0), dtype=np.int32), samples, np.zeros(3), 1.0  # type: ignore[return-value]


@numba.njit(cache=True)
def _pass_time(coefficients, kept, fresh, noise):  # type: ignore[no-untyped-def]
    for n in range(len(coefficients)):
        coefficients[n] = kept[n] * coefficients[n] + fresh[n] * noise[n]


@numba.njit(cache=True)
def _water_velocity(position, uniform, flow, field, waves, coefficients, swell, scales, velocity):  # type: ignore[no-untyped-def]
    """Write the (3,) velocity at a (3,) place, m/s; `scales`: of flow and eddies, m/s, and the swell's phase."""
    x, y, z = position[0], position[1], position[2]
    velocity[0], velocity[1], velocity[2] = uniform[0], uniform[1], uniform[2]
    if scales[0] != 0.0:
        add_velocity(flow[0], flow[1], flow[2], flow[3], x, y, z, scales[0], velocity)
    if scales[1] != 0.0:
        phases = coefficients[1:]
        add_eddies(field[0], field[1], field[2], field[3], x, y, z, waves, phases, scales[1], velocity)
    if swell[4] != 0.0:
        add_waves(swell, scales[2], x, y, z, velocity)


@numba.njit(cache=True)
def _water_velocities(positions, uniform, flow, field, waves, coefficients, swell, scales, velocities):  # type: ignore[no-untyped-def]
    for n in range(len(positions)):
        _water_velocity(positions[n], uniform, flow, field, waves, coefficients, swell, scales, velocities[n])
