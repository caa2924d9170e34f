"""Where commands take vehicles in free water, from any states: for policies that look ahead, trials and tests.

The laws are those of the batch (`motion`, `original`, `actuators`); only the wall is left out. One call is one recorded
launch on the processor, for one row as for hundreds.
"""

from __future__ import annotations

import weakref
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.sim.batch.actuators import Controls, actuated, level_of, make_controls, trim_of
from aquanav_tools.sim.batch.contact import axis_clearance
from aquanav_tools.sim.batch.contact_points import Hull
from aquanav_tools.sim.batch.field import Grid, make_grid
from aquanav_tools.sim.batch.motion import Body, BodyRows, State, body_rows, swim, thrust, vec6
from aquanav_tools.sim.batch.original import DraggedBody, DraggedRows, drag_along, dragged_rows
from aquanav_tools.sim.batch.runtime import OPTIONS, find_device, launch_kernel
from aquanav_tools.sim.body_parameters import DraggedBodyParameters, MotionParameters
from aquanav_tools.sim.randomisation import Draws, control_factors, varied_body
from aquanav_tools.sim.vehicle_base import STATE_SIZE, Vehicle
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.struct
class Motion:
    """What moves the rows: one body for all of them, or one for each."""

    is_original: wp.int32
    bodies: wp.array(dtype=Body)
    dragged: wp.array(dtype=DraggedBody)
    dt: f64
    """Physics step, s."""


def _make_motion(parameters: MotionParameters, dt: float, device: Any) -> tuple[Motion, BodyRows | DraggedRows]:
    """Return a motion and what must live as long."""
    motion = Motion()
    motion.dt, motion.is_original = dt, int(isinstance(parameters, DraggedBodyParameters))
    if isinstance(parameters, DraggedBodyParameters):
        dragged = dragged_rows(parameters, dt, device)
        motion.dragged = wp.array(dragged.rows, dtype=DraggedBody, device=device)
        return motion, dragged
    bodies = body_rows(parameters, dt, device)
    motion.bodies = wp.array(bodies.rows, dtype=Body, device=device)
    return motion, bodies


@wp.func
def moved_freely(i: int, state: State, wrench: vec6, current: wp.vec3d, extra: wp.array2d(dtype=f64), motion: Motion):
    """Return the state of row `i` one physics step later, and move what its model adds to it, in place."""
    if motion.is_original == 1:
        dragged = motion.dragged[wp.min(i, motion.dragged.shape[0] - 1)]
        return drag_along(state, wrench, extra[i, 0], current, dragged, motion.dt)
    body = motion.bodies[wp.min(i, motion.bodies.shape[0] - 1)]
    acting = wrench
    if body.num_thrusters > 0:
        acting = thrust(state, wrench, body, extra, i)
    return swim(state, acting, current, body, motion.dt)


@wp.func
def read_state(states: wp.array3d(dtype=f64), i: int, extra: wp.array2d(dtype=f64)):
    """Return the state with which row `i` begins, and keep what the model adds to it in row `i` of `extra`."""
    state = State()
    for axis in range(3):
        state.position[axis] = states[i, 0, axis]
    for axis in range(4):
        state.orientation[axis] = states[i, 0, 3 + axis]
    for axis in range(6):
        state.velocity[axis] = states[i, 0, 7 + axis]
    for n in range(extra.shape[1]):
        extra[i, n] = states[i, 0, 13 + n]
    return state


@wp.func
def write_state(states: wp.array3d(dtype=f64), i: int, n: int, state: State, extra: wp.array2d(dtype=f64)):
    """Write what `read_state` reads, as the n-th state of row `i`."""
    for axis in range(3):
        states[i, n, axis] = state.position[axis]
    for axis in range(4):
        states[i, n, 3 + axis] = state.orientation[axis]
    for axis in range(6):
        states[i, n, 7 + axis] = state.velocity[axis]
    for k in range(extra.shape[1]):
        states[i, n, 13 + k] = extra[i, k]


@wp.kernel
def push(
    motion: Motion,
    wrenches: wp.array2d(dtype=vec6),
    currents: wp.array(dtype=wp.vec3d),
    extra: wp.array2d(dtype=f64),
    states: wp.array3d(dtype=f64),
):
    """Move each row from its first state through a wrench per physics step."""
    i = wp.tid()
    state = read_state(states, i, extra)
    for n in range(wrenches.shape[1]):
        state = moved_freely(i, state, wrenches[i, n], currents[i], extra, motion)
        write_state(states, i, n + 1, state, extra)


@wp.kernel
def hold(
    motion: Motion,
    controls: Controls,
    substeps: int,
    commands: wp.array2d(dtype=wp.vec3d),
    currents: wp.array(dtype=wp.vec3d),
    hull: Hull,
    grid: Grid,
    extra: wp.array2d(dtype=f64),
    states: wp.array3d(dtype=f64),
    trims: wp.array2d(dtype=f64),
    clearances: wp.array2d(dtype=f64),
):
    """Move each row from its first state and trim through a command per decision."""
    i = wp.tid()
    state = read_state(states, i, extra)
    level = level_of(trims[i, 0], controls)
    for n in range(commands.shape[1] + 1):
        if n > 0:
            for _ in range(substeps):
                wrench, after = actuated(commands[i, n - 1], level, controls)
                level = after
                state = moved_freely(i, state, wrench, currents[i], extra, motion)
            write_state(states, i, n, state, extra)
            trims[i, n] = trim_of(level, controls)
        if clearances.shape[1] > 0:
            clearances[i, n] = axis_clearance(grid, state, hull) - hull.radius


@wp.kernel
def read_trim(level: f64, controls: Controls, trims: wp.array(dtype=f64)):
    """Write the state of the ballast at a level."""
    trims[0] = trim_of(level, controls)


class Prediction(NamedTuple):
    """Where K rows come in D decisions; the first of the D + 1 columns is where they begin."""

    states: Array
    """(K, D + 1, S)."""
    trims: Array
    """(K, D + 1) in [-1, 1]."""
    clearances: Array
    """(K, D + 1) from the hull to the nearest wall, m; (K, 0) without a field."""


class _Launch(NamedTuple):
    """A recorded launch and views of its arrays."""

    command: Any
    commands: Array
    currents: Array
    states: Array
    trims: Array
    clearances: Array
    kept: tuple[Any, ...]


class Predictor:
    """The motion of a vehicle in free water under commands, from any states."""

    def __init__(
        self,
        vehicle: Vehicle,
        density: float,
        dt: float,
        substeps: int,
        field: DistanceField | None = None,
        draws: Draws | None = None,
    ) -> None:
        """Prepare a vehicle's equations.

        Args:
            vehicle: What moves.
            density: Of the water, kg/m^3.
            dt: Physics step, s.
            substeps: Steps of a decision.
            field: Where to look up clearances; None leaves them out.
            draws: (1,) numbers by name that an episode drew of its vehicle's dynamics; None or none leaves them as the
                vehicle's file has them.
        """
        self.device = find_device("cpu")
        parameters = varied_body(vehicle, density, draws, 1) if draws else vehicle.motion_parameters(density)
        self.motion, self._rows = _make_motion(parameters, dt, self.device)
        self.controls, self.substeps = _controls_of(vehicle, dt, draws or {}), substeps
        self.hull, self._has_field = Hull(), field is not None
        self.hull.half_axis, self.hull.radius = 0.5 * vehicle.capsule.axis_length, vehicle.capsule.radius
        self.grid = Grid() if field is None else _grid_of(field, self.device)
        self._launches: dict[tuple[int, int, int], _Launch] = {}

    def predict(self, states: Array, trims: Array, commands: Array, currents: Array) -> Prediction:
        """Return where K rows come in D decisions; the arrays are the caller's.

        Args:
            states: (K, S) position, quaternion, velocity over ground in the body frame, and what the model adds.
            trims: (K,) state of the ballast in [-1, 1].
            commands: (K, D, 3) ballast, steer and thrust in [-1, 1]; D may be 0.
            currents: (3,) or (K, 3) velocity of the water, world frame, m/s.
        """
        shape = (*commands.shape[:2], states.shape[1])
        launch = self._launches.get(shape)
        if launch is None:
            launch = self._launches[shape] = self._record(*shape)
        launch.states[:, 0], launch.trims[:, 0] = states, trims
        launch.commands[:], launch.currents[:] = commands, currents
        launch.command.launch()
        return Prediction(launch.states.copy(), launch.trims.copy(), launch.clearances.copy())

    def trim_at(self, level: float) -> float:
        """Return the state of the ballast in [-1, 1] at a level as the batch has it."""
        trims = self.zeros((1,))
        launch_kernel(read_trim, dim=1, inputs=[wp.float64(level), self.controls, trims], device=self.device)
        return float(trims.numpy()[0])

    def _record(self, rows: int, decisions: int, size: int) -> _Launch:
        """Return the launch for so many rows, decisions and values of a state."""
        commands, currents = self.zeros((rows, decisions), wp.vec3d), self.zeros((rows,), wp.vec3d)
        states, trims = self.zeros((rows, decisions + 1, size)), self.zeros((rows, decisions + 1))
        clearances = self.zeros((rows, decisions + 1 if self._has_field else 0))
        extra = self.zeros((rows, size - STATE_SIZE))
        inputs = [self.motion, self.controls, self.substeps, commands, currents, self.hull, self.grid]
        inputs += [extra, states, trims, clearances]
        command = launch_kernel(hold, dim=rows, inputs=inputs, device=self.device, record_cmd=True)
        arrays = (commands, currents, states, trims, clearances)
        return _Launch(command, *(array.numpy() for array in arrays), (*arrays, extra))

    def zeros(self, shape: tuple[int, ...], dtype: Any = wp.float64) -> Any:
        """Return an array on the device."""
        return wp.zeros(shape, dtype=dtype, device=self.device)


def advance(
    states: Array, wrenches: Array, currents: Array, parameters: MotionParameters, dt: float, steps: int = 1
) -> Array:
    """Return the (N, steps + 1, S) states of N bodies at the beginning and after each physics step.

    Args:
        states: (N, S) position, quaternion, velocity over ground in the body frame, and what the model adds.
        wrenches: What the actuators ask for, body frame, N and N m (of the original's body thrust, power and moment, as
            in `actuated`); of any shape that broadcasts to (N, steps, 6).
        currents: (3,) or (N, 3) velocity of the water, world frame, m/s.
        parameters: Of one body for all rows, or of N bodies.
        dt: Physics step, s.
        steps: How many.
    """
    device = find_device("cpu")
    num, size = states.shape
    motion, rows = _make_motion(parameters, dt, device)
    through = np.empty((num, steps + 1, size))
    through[:, 0] = states
    moved = wp.array(through, dtype=wp.float64, device=device)
    pushes = wp.array(np.broadcast_to(wrenches, (num, steps, 6)), dtype=vec6, device=device)
    water = wp.array(np.broadcast_to(currents, (num, 3)), dtype=wp.vec3d, device=device)
    extra = wp.zeros((num, size - STATE_SIZE), dtype=wp.float64, device=device)
    launch_kernel(push, dim=num, inputs=[motion, pushes, water, extra, moved], device=device)
    del rows  # lives until here: the bodies point into it
    result: Array = np.array(moved.numpy())
    return result


def _controls_of(vehicle: Vehicle, dt: float, draws: Draws) -> Controls:
    """Return the actuators of a vehicle for which (1,) numbers by name were drawn."""
    controls = make_controls(vehicle, dt)
    thrust, reverse = (float(factors[0]) for factors in control_factors(vehicle, draws, 1))
    controls.surge, controls.yaw = thrust * controls.surge, thrust * controls.yaw
    controls.reverse_fraction = reverse * controls.reverse_fraction
    return controls


_grids: weakref.WeakKeyDictionary[DistanceField, Grid] = weakref.WeakKeyDictionary()


def _grid_of(field: DistanceField, device: Any) -> Grid:
    """Return a field on a device; predictors in the same cave share it."""
    grid = _grids.get(field)
    if grid is None:
        grid = _grids[field] = make_grid(field, device)
    return grid
