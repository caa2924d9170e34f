"""How the reward measures the way to go, for every vehicle of a batch. Episodes always end by the guide's panels."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.cave.route.shortest import shortest_ways
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.chain import Chain, follow_chain, forget_crossings, make_chain
from aquanav_tools.sim.batch.contact import Hull
from aquanav_tools.sim.batch.field import Grid, clearance_at, make_grid
from aquanav_tools.sim.batch.guide import Panels, make_panels
from aquanav_tools.sim.batch.runtime import OPTIONS
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
    ways: Grid
    """Metres to the goal, held as a distance field."""
    chain: Chain


def make_measure(
    name: ProgressMeasure, scenario: Scenario, capsule: Capsule, crossed: Any, touched: Any, device: Any
) -> Measure:
    """Return the measure of a name; the arrays on the device keep what the original's has seen of each vehicle.

    Raises:
        MeshError: there is no way to the goal for the vehicle.
    """
    measure = Measure()
    measure.kind, measure.panels = MEASURES.index(name), make_panels(scenario.guide, device)
    if name == "geodesic":
        goal = np.array(scenario.settings.goal.position, dtype=np.float64)
        measure.ways = make_grid(shortest_ways(scenario.field, goal, capsule.radius).lengths, device)
    elif name == "original":
        measure.chain = make_chain(scenario.guide, crossed, touched, device)
    return measure


@wp.func
def to_go(i: int, position: wp.vec3d, ahead: wp.vec3d, remaining: f64, hull: Hull, measure: Measure):
    """Return the way to go of vehicle `i`, m: `remaining`, along the panels, or what another measure says."""
    if measure.kind == GEODESIC:
        return clearance_at(measure.ways, position)
    if measure.kind == ORIGINAL:
        return follow_chain(i, position, ahead, hull.half_axis, hull.radius, measure.panels, measure.chain)
    return remaining


@wp.func
def begin_measure(i: int, measure: Measure):
    """Begin an episode of vehicle `i`, in place."""
    if measure.kind == ORIGINAL:
        forget_crossings(i, measure.chain)
