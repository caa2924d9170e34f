"""Pure pursuit of a path through a cave, and where it leads: closed loops of decisions run ahead in one launch.

The nose is aimed up the current so that the way over ground is right; speed falls beside walls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from aquanav_tools.cave.water.roomy_ways import ENOUGH
from aquanav_tools.cave.water.roomy_ways import REACH as AHEAD
from aquanav_tools.sim.batch.actuators import Controls, actuated, level_of, trim_of
from aquanav_tools.sim.batch.contact import axis_clearance
from aquanav_tools.sim.batch.contact_points import Hull
from aquanav_tools.sim.batch.field import Grid
from aquanav_tools.sim.batch.motion import State, linear, rotation_of
from aquanav_tools.sim.batch.prediction import Motion, Predictor, moved_freely, read_state
from aquanav_tools.sim.batch.runtime import OPTIONS, launch_kernel
from aquanav_tools.sim.batch.water import Water, WaterNow, water_at
from aquanav_tools.sim.vehicle_base import STATE_SIZE
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
PI = wp.constant(wp.float64(np.pi))
REACH = wp.constant(wp.float64(AHEAD))
"""Distance along the path to the point that is aimed at, m."""
HORIZON = 18
"""Decisions that the oracle runs ahead: longer than it takes to stop. With 12 it sees too late, at its faster paces,
that flood water will carry it into a wall: in a cave 1.44 vehicle widths wide one dive of 5 touched, with 18 none of
10."""
MARGIN, SHARE = ENOUGH, 0.5
"""Clearance of the hull that it asks for there, m; where the way has less room, so much of that."""
STRIDE, PATIENCE, MAX_HALVINGS = 0.5, 50, 3
"""Where it makes less way than the first, m, in so many decisions, it asks for half the clearance, and so on: a place
that is narrower would hold it up for ever."""
SLOWEST = 0.3
PACES = (0.8, 0.6, 0.45, SLOWEST)
"""Speeds over ground that it tries beside walls, m/s: the first that keeps enough room is taken."""
FASTEST = wp.constant(wp.float64(0.8))
SPEED_PER_METRE = wp.constant(wp.float64(0.8))
"""Speed over ground, m/s: so much per metre of clearance of the hull, between the two; or a pace that is faster."""
STEER_LEAD, STEER_DEADBAND = wp.constant(wp.float64(0.25)), wp.constant(wp.float64(np.radians(4.0)))
"""The rate of turn is taken to go on for so long, s; errors of heading up to the second are left."""
OVERSPEED = wp.constant(wp.float64(0.15))
"""It reverses when faster than it wants by this much, m/s."""
CLIMB_PER_METRE, FASTEST_CLIMB = wp.constant(wp.float64(1.2)), wp.constant(wp.float64(0.4))
"""Vertical speed per metre off the path, 1/s, and its limit, m/s."""
TRIM_PER_SPEED, TRIM_DEADBAND = wp.constant(wp.float64(4.0)), wp.constant(wp.float64(0.05))


@wp.struct
class Path:
    """A path to follow."""

    points: wp.array(dtype=wp.vec3d)
    """m."""
    arc: wp.array(dtype=f64)
    """Length of the path up to each point, m."""


@wp.func
def full_beyond(error: f64, deadband: f64):
    """Return the sign of an error, 0 within the deadband."""
    if wp.abs(error) <= deadband:
        return f64(0.0)
    return wp.sign(error)


@wp.func
def command_for(state: State, trim: f64, wanted: wp.vec3d, current: wp.vec3d):
    """Return ballast, steer and thrust towards a velocity through the water, world frame, m/s."""
    rotation = rotation_of(state.orientation)
    nose = wp.atan2(rotation[1, 0], rotation[0, 0])
    error = wp.atan2(wanted[1], wanted[0]) - nose
    error -= f64(2.0) * PI * wp.rint(error / (f64(2.0) * PI))
    through = rotation * linear(state.velocity) - current
    surge = through[0] * wp.cos(nose) + through[1] * wp.sin(nose)
    ahead = wp.sqrt(wanted[0] * wanted[0] + wanted[1] * wanted[1]) * wp.max(wp.cos(error), f64(0.0))
    thrust = f64(0.0)
    if surge < ahead:
        thrust = f64(1.0)
    elif surge > ahead + OVERSPEED:
        thrust = f64(-1.0)
    wanted_trim = wp.clamp(TRIM_PER_SPEED * (wanted[2] - through[2]), f64(-1.0), f64(1.0))
    ballast = full_beyond(wanted_trim - trim, TRIM_DEADBAND)
    return wp.vec3d(ballast, full_beyond(error - STEER_LEAD * state.velocity[5], STEER_DEADBAND), thrust)


@wp.func
def command_towards(state: State, trim: f64, clearance: f64, pace: f64, current: wp.vec3d, aim: wp.vec3d, height: f64):
    """Return the command that steers to a place ahead, and up or down to a height nearer by."""
    offset = aim - state.position
    speed = wp.clamp(SPEED_PER_METRE * clearance, pace, FASTEST)
    wanted = offset * (speed / wp.max(wp.length(offset), f64(1e-9)))
    wanted[2] = wp.clamp(CLIMB_PER_METRE * (height - state.position[2]), -FASTEST_CLIMB, FASTEST_CLIMB)
    return command_for(state, trim, wanted - current, current)


@wp.func
def nearest_point(position: wp.vec3d, path: Path):
    """Return the number of the path's point that is nearest to a position."""
    nearest = int(0)
    for n in range(1, path.points.shape[0]):
        if wp.length_sq(path.points[n] - position) < wp.length_sq(path.points[nearest] - position):
            nearest = n
    return nearest


@wp.func
def pursued(state: State, trim: f64, clearance: f64, pace: f64, current: wp.vec3d, at: int, path: Path):
    """Return the command that steers along the path from its nearest point, `at`."""
    last = path.points.shape[0] - 1
    aim = wp.min(wp.lower_bound(path.arc, path.arc[at] + REACH), last)
    higher = wp.min(wp.lower_bound(path.arc, path.arc[at] + f64(0.5) * REACH), last)
    return command_towards(state, trim, clearance, pace, current, path.points[aim], path.points[higher][2])


@wp.kernel
def pursue(
    motion: Motion,
    controls: Controls,
    substeps: int,
    horizon: int,
    has_command: int,
    path: Path,
    hull: Hull,
    grid: Grid,
    knows_water: int,
    water: Water,
    eddies: wp.array2d(dtype=f64),
    phases: wp.array(dtype=f64),
    fractions: wp.array(dtype=f64),
    currents: wp.array(dtype=wp.vec3d),
    extra: wp.array2d(dtype=f64),
    states: wp.array3d(dtype=f64),
    trims: wp.array(dtype=f64),
    paces: wp.array(dtype=f64),
    commands: wp.array(dtype=wp.vec3d),
    reached: wp.array(dtype=f64),
    clearances: wp.array(dtype=f64),
    made: wp.array(dtype=f64),
):
    """Carry out a command, or the pursuit's own, and then pursue the path; see `Pursuit.foresee`."""
    i = wp.tid()
    state = read_state(states, i, extra)
    level = level_of(trims[i], controls)
    at = nearest_point(state.position, path)
    reached[i] = path.arc[at]
    if has_command == 0:
        clearance = axis_clearance(grid, state, hull) - hull.radius
        commands[i] = pursued(state, trims[i], clearance, paces[i], currents[0], at, path)
    command = commands[i]
    current = f64(1.0) * currents[0]
    least = f64(wp.inf)
    for _ in range(horizon):
        for _ in range(substeps):
            wrench, after = actuated(command, level, controls)
            level = after
            state = moved_freely(i, state, wrench, current, extra, motion)
        clearance = axis_clearance(grid, state, hull) - hull.radius
        least = wp.min(least, clearance)
        at = nearest_point(state.position, path)
        if knows_water == 1:
            current = fractions[0] * water_at(water, grid, eddies, 0, phases[0], state.position)
        command = pursued(state, trim_of(level, controls), clearance, paces[i], current, at, path)
    clearances[i] = least
    made[i] = path.arc[at]


class Foreseen(NamedTuple):
    """What K rows come to when they pursue the path after their first command."""

    commands: Array
    """(K, 3) the first ones: ballast, steer and thrust."""
    reached: Array
    """(K,) how far along the path they begin, m."""
    clearances: Array
    """(K,) least clearance of the hull, m."""
    made: Array
    """(K,) how far along the path they end, m."""


class Pursuit:
    """A vehicle that follows a path through a cave, run ahead for some decisions."""

    def __init__(
        self, predictor: Predictor, points: Array, arc: Array, horizon: int, water: WaterNow | None = None
    ) -> None:
        """Prepare pursuit of a path.

        Args:
            predictor: Of the vehicle, with the cave's field.
            points: (N, 3) along the path, m.
            arc: (N,) length of the path up to each of them, m.
            horizon: Decisions that are run ahead.
            water: What the vehicle comes into; None takes it to move everywhere as it does where the vehicle is.
        """
        self._predictor, self._horizon = predictor, horizon
        self._path = Path()
        self._path.points = wp.array(points, dtype=wp.vec3d, device=predictor.device)
        self._path.arc = wp.array(arc, dtype=wp.float64, device=predictor.device)
        if water is None:
            nothing = [predictor.zeros((0, 0)), predictor.zeros((0,)), predictor.zeros((0,))]
            self._water = [0, Water(), *nothing]
        else:
            self._water = [1, water.water, water.eddies, water.phases, water.fractions]
        self._launches: dict[tuple[int, int, bool], tuple[Any, list[Any], list[Array]]] = {}

    def foresee(
        self,
        state: Array,
        trim: float,
        current: Array,
        commands: Array | None = None,
        paces: Sequence[float] = (SLOWEST,),
    ) -> Foreseen:
        """Return what first commands lead to, followed by pursuit of the path for the rest of the horizon.

        Args:
            state: (S,) of the vehicle.
            trim: In [-1, 1].
            current: (3,) velocity of the water, world frame, m/s.
            commands: (K, 3) ballast, steer and thrust; None takes the pursuit's own.
            paces: Speeds over ground that it keeps beside walls too, m/s: one for all rows, or K of them.
        """
        num = len(paces) if commands is None else len(commands)
        key = (num, len(state), commands is not None)
        if key not in self._launches:
            self._launches[key] = self._record(*key)
        command, _, (currents, states, trims, speeds, given, *found) = self._launches[key]
        currents[:], states[:, 0], trims[:], speeds[:] = current, state, trim, paces
        if commands is not None:
            given[:] = commands
        command.launch()
        return Foreseen(given.copy(), *(values.copy() for values in found))

    def _record(self, num: int, size: int, has_command: bool) -> tuple[Any, list[Any], list[Array]]:
        """Return a launch for so many rows, its arrays, and views of them."""
        given = self._predictor
        currents, commands = given.zeros((1,), wp.vec3d), given.zeros((num,), wp.vec3d)
        states, trims, paces = given.zeros((num, 1, size)), given.zeros((num,)), given.zeros((num,))
        found = [given.zeros((num,)) for _ in range(3)]
        extra = given.zeros((num, size - STATE_SIZE))
        inputs = [given.motion, given.controls, given.substeps, self._horizon, int(has_command), self._path]
        inputs += [given.hull, given.grid, *self._water, currents, extra, states, trims, paces, commands, *found]
        launch = launch_kernel(pursue, dim=num, inputs=inputs, device=given.device, record_cmd=True)
        arrays = [currents, states, trims, paces, commands, *found]
        return launch, [*arrays, extra], [array.numpy() for array in arrays]
