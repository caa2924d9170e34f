"""The water of a scenario: what its currents and waves are made of. `sim/batch/water.py` has the law itself.

    u(x, t) = strength (1 + g(t)) flow(x) + turbulence strength sum_n eddies_n(x) c_n(t) + waves(x, t)

The flow through the cave and the eddies lose no water and pass no wall, and so does every sum of them. The gust g
and the eddies' coefficients c follow Ornstein-Uhlenbeck processes, taken by their exact discretisation: they have
their stationary variance and correlation time at any step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquanav_tools.cave.water.flow import Flow
from aquanav_tools.errors import ScenarioError
from aquanav_tools.scenario.schema import PRESETS, Current, Scenario, check_current
from aquanav_tools.sim.waves import wave_parameters
from aquanav_tools.types import Array

GUST_SIZE = 0.1
"""Standard deviation of the flow's strength about its mean; chosen: a flow that swells but never turns."""
GUST_TIME = 20.0
"""Its correlation time, s; chosen: several times as long as a vehicle's own response."""


class WaterParts(NamedTuple):
    """What the water of a scenario is made of."""

    uniform: Array
    """(3,) one velocity everywhere, m/s."""
    flow: Flow | None
    """From portal to portal; None where none is asked for."""
    flow_scale: float
    """Mean speed through the narrowest section, m/s."""
    eddy_scale: float
    """Root mean square speed of the eddies, m/s."""
    eddy_size: float
    """Clearance that is usual in the passages, over which eddies fade towards walls, m."""
    eddy_seed: int
    """Draws their waves."""
    swell: Array
    """(7,) the surface's waves, as `waves.wave_parameters` has them; zeros where there are none."""
    is_constant: bool
    """Whether the water has one velocity at all places and times."""


def water_of(scenario: Scenario, current: Current | None = None) -> WaterParts:
    """Return what moves the water of a scenario.

    Args:
        scenario: The cave, its flow and its water.
        current: A preset, a strength, m/s, or one velocity everywhere, m/s; None takes the scenario's.

    Raises:
        ScenarioError: the scenario has no flow.
        ValueError: the current is no preset, or too fast.
    """
    settings = scenario.settings.water
    chosen = settings.current if current is None else current
    check_current(chosen)
    strength = strength_of(chosen)
    if strength and scenario.flow is None:
        raise ScenarioError(
            f"The scenario {scenario.name} has no flow: it was built before aquanav knew currents in caves with "
            f"{len(scenario.cavity.portals)} portals, or no way through is wide enough. Build it again, or give one "
            "velocity for all of the water."
        )
    has_swell = settings.surface is not None and settings.waves.height > 0.0
    return WaterParts(
        uniform=np.zeros(3) if np.ndim(chosen) == 0 else np.array(chosen, dtype=np.float64),
        flow=scenario.flow if strength else None,
        flow_scale=strength,
        eddy_scale=abs(strength) * settings.turbulence,
        eddy_size=float(np.median([panel.clearance for panel in scenario.guide.panels])),
        eddy_seed=settings.seed,
        swell=wave_parameters(settings.waves, settings.surface) if has_swell else np.zeros(7),  # type: ignore[arg-type]
        is_constant=is_constant(scenario, current),
    )


def is_constant(scenario: Scenario, current: Current | None = None) -> bool:
    """Return whether the water of a scenario, or another current in it, has one velocity at all places and times."""
    settings = scenario.settings.water
    has_waves = settings.surface is not None and settings.waves.height > 0.0
    return not strength_of(settings.current if current is None else current) and not has_waves


def strength_of(current: Current) -> float:
    """Return the mean speed through the narrowest section that a current asks for, m/s; 0 where it is one velocity."""
    if isinstance(current, str):
        return PRESETS[current]
    return float(current) if np.ndim(current) == 0 else 0.0  # type: ignore[arg-type]
