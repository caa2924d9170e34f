"""How the reward measures the way to go, for every vehicle of a batch. Episodes always end by the guide's panels."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.cave.route.shortest import shortest_paths
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.chain import distances_along_centres, follow_chain
from aquanav_tools.sim.batch.contact_points import Hull
from aquanav_tools.sim.batch.field import Grid, clearance_at, make_grid
from aquanav_tools.sim.batch.guide import Panels, make_panels
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.task import MEASURES, ProgressMeasure
from aquanav_tools.types import Capsule

wp.set_module_options(OPTIONS)

f64 = wp.float64
GEODESIC, ORIGINAL = wp.constant(MEASURES.index("geodesic")), wp.constant(MEASURES.index("original"))


@wp.struct
class Measure:
    """A measure of the way to go; the index of its name in MEASURES says which, and which of the rest are filled."""

    kind: wp.int32
    panels: Panels
    """The guide's."""
    path_lengths: Grid
    """Metres to the goal, held as a distance field."""
    centre_distances: wp.array(dtype=f64)
    """(P,) from each panel along the centres to the last, m."""


def make_measure(name: ProgressMeasure, scenario: Scenario, capsule: Capsule, device: Any) -> Measure:
    """Return the measure of a name.

    Raises:
        MeshError: there is no way to the goal for the vehicle.
    """
    measure = Measure()
    measure.kind, measure.panels = MEASURES.index(name), make_panels(scenario.guide, device)
    if name == "geodesic":
        goal = np.array(scenario.settings.goal.position, dtype=np.float64)
        measure.path_lengths = make_grid(shortest_paths(scenario.field, goal, capsule.radius).lengths, device)
    elif name == "original":
        distances = distances_along_centres(scenario.guide)
        measure.centre_distances = wp.array(distances, dtype=wp.float64, device=device)
    return measure


@wp.func
def to_go(i: int, position: wp.vec3d, ahead: wp.vec3d, remaining: f64, hull: Hull, measure: Measure, state: BatchState):
    """Return the way to go of vehicle `i`, m: `remaining`, along the panels, or what another measure says."""
    if measure.kind == GEODESIC:
        return clearance_at(measure.path_lengths, position)
    if measure.kind == ORIGINAL:
        return follow_chain(
            i,
            position,
            ahead,
            hull.half_axis,
            hull.radius,
            measure.panels,
            measure.centre_distances,
            state.panels_crossed,
            state.touched_panels,
        )
    return remaining


@wp.func
def begin_measure(i: int, state: BatchState):
    """Begin an episode of vehicle `i`, in place."""
    state.panels_crossed[i] = 0
    for panel in range(state.touched_panels.shape[1]):
        state.touched_panels[i, panel] = False
