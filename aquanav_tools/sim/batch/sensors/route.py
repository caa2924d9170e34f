"""A place ahead on a cave's own route, in the form of the sensor `waypoint`: what no vehicle knows."""

from __future__ import annotations

from typing import Any

import warp as wp
from gymnasium import spaces

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim import scales, way
from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.field import clearance_at
from aquanav_tools.sim.batch.motion import rotation_of
from aquanav_tools.sim.batch.random import share_of_one, words
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.scaled import shown_direction, soft
from aquanav_tools.sim.batch.sensors.base import KernelSensor, MirrorImage, SensorBatch
from aquanav_tools.sim.batch.sensors.noise import normal_vector
from aquanav_tools.sim.batch.sensors.rows import chosen
from aquanav_tools.sim.batch.sensors.waypoint import SIZE, mirror_image, space
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.occupancy import CELL
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

f64 = wp.float64
LEAST, FARTHEST = (wp.constant(wp.float64(cells * CELL)) for cells in (way.LEAST_AHEAD, way.LOOKED_ALONG))
"""Along the route to the place that is shown, m: as `waypoint` has it."""
ROOM, STEP = wp.constant(wp.float64(CELL)), wp.constant(wp.float64(0.5 * CELL))
"""A place is in sight where its line keeps so far from walls, m, as on a map that guesses them around rays' ends; and
the least step along the line."""
DISTANCE_SCALE = wp.constant(wp.float64(scales.DISTANCE_SCALE))
KEPT = wp.constant(10)
"""Decisions for which an error stays the same."""
STRETCH = wp.constant(30)
"""Decisions for which the way is lost, or is not."""
MIN_SLICE = 512
"""Vehicles for which a further thread is worth its start."""


@wp.func
def is_in_sight(cave: Cave, position: wp.vec3d, place: wp.vec3d):
    """Return whether the straight line between two places keeps a cell's distance to walls, but for where it begins."""
    offset = place - position
    length, along, room = wp.length(offset), f64(0.0), f64(0.0)
    is_clear = int(1)
    while along < length and is_clear == 1:
        room = clearance_at(cave.grid, position + offset * (along / length)) - ROOM
        if room <= f64(0.0) and along > ROOM:
            is_clear = 0
        along += wp.max(room, STEP)
    return is_clear == 1


@wp.func
def place_ahead(i: int, cave: Cave, state: BatchState):
    """Return the farthest panel's centre in sight along the route, at least the first that is not too near."""
    panels, position = cave.measure.panels, state.positions[i]
    ahead, along = wp.vec3d(cave.rules.goal), f64(0.0)
    has_place, is_hidden, first = int(0), int(0), state.gates[i] + 1
    for n in range(first, panels.centres.shape[0]):
        if is_hidden == 0:
            centre = panels.centres[n]
            if n == first:
                along = wp.length(centre - position)
            else:
                along += wp.length(centre - panels.centres[n - 1])
            if along > FARTHEST and has_place == 1:
                is_hidden = 1
            elif along >= LEAST:
                if has_place == 0 or is_in_sight(cave, position, centre):
                    ahead = centre
                    has_place = 1
                else:
                    is_hidden = 1
    return ahead


@wp.kernel
def measure_route(
    first: int,
    only_restarted: int,
    stream: int,
    state: BatchState,
    caves: wp.array(dtype=Cave),
    error: wp.float64,
    lost: wp.float32,
    out: wp.array2d(dtype=wp.float32),
):
    """Write where the route goes on, with an error of this standard deviation along each axis, m.

    In a share of all stretches the way is lost: then it leads straight to the goal.
    """
    i = chosen(state, first + wp.tid(), only_restarted)
    if i < 0:
        return
    wrong = error * wp.vec3d(normal_vector(state.seeds[i], stream + 1, state.decisions[i] / KEPT))
    ahead = wp.vec3d(caves[state.cave_of[i]].rules.goal)
    if share_of_one(words(state.seeds[i], stream + 2, state.decisions[i] / STRETCH)[0]) >= lost:
        ahead = place_ahead(i, caves[state.cave_of[i]], state)
    offset = ahead + wrong - state.positions[i]
    direction = shown_direction(offset, rotation_of(state.orientations[i]))
    out[i, 0] = wp.float32(soft(wp.max(state.remaining[i], f64(0.0)), DISTANCE_SCALE))
    out[i, 1] = direction[0]
    out[i, 2] = direction[1]
    out[i, 3] = share_of_one(words(state.seeds[i], stream, state.decisions[i])[0])


class Route(KernelSensor):
    """Which way leads to the goal by the cave's own panels: (N, 4), in the form of `waypoint`.

    No vehicle knows this: it is what `waypoint` would show if its map knew the cave. It errs as maps do: places are
    off, and at times it leads straight to the goal through rock. So a network that learned with it trusts the waypoint
    (`TrainSettings.waypoint`), and its own rays more. As nothing is unknown here, the share that is unknown is drawn
    evenly, so that a network learns to do without.
    """

    def __init__(self, error: float = CELL, lost: float = 0.2) -> None:
        """Prepare.

        Args:
            error: Standard deviation of a place along each axis, m; drawn anew every tenth decision.
            lost: Share of all stretches of 30 decisions in which the place is the goal itself, as a map's ways break
                through walls that it does not know.
        """
        super().__init__(measure_route, MIN_SLICE)
        self.error, self.lost = error, lost

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of a reading: that of `waypoint`."""
        return space()

    def mirror_image(self) -> MirrorImage:
        """Return how readings look in a mirror: left for right."""
        return mirror_image()

    def _shape(self) -> tuple[int, ...]:
        return (SIZE,)

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        return [self.error, self.lost]
