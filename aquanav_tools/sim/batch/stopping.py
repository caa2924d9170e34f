"""A full stop, run ahead among points of wall: closed loops of decisions in one launch."""

from __future__ import annotations

from typing import Any

import warp as wp

from aquanav_tools.sim.batch.actuators import Controls, actuated, level_of, trim_of
from aquanav_tools.sim.batch.contact_points import Hull, nose_of
from aquanav_tools.sim.batch.motion import State, linear, rotation_of
from aquanav_tools.sim.batch.prediction import Motion, Predictor, moved_freely, read_state
from aquanav_tools.sim.batch.runtime import OPTIONS, launch_kernel
from aquanav_tools.sim.vehicle_base import STATE_SIZE
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
TRIM_PER_CLIMB = wp.constant(wp.float64(4.0))
"""Trim against a vertical speed, s/m: as the pursuit's."""


@wp.func
def stopping(state: State, trim: f64, still: f64):
    """Return the command that takes speed off; speeds and differences of trim below `still` are left."""
    climb = (rotation_of(state.orientation) * linear(state.velocity))[2]
    missing = wp.clamp(-TRIM_PER_CLIMB * climb, f64(-1.0), f64(1.0)) - trim
    ballast, thrust = f64(0.0), f64(0.0)
    if wp.abs(missing) > still:
        ballast = wp.sign(missing)
    if wp.abs(state.velocity[0]) >= still:
        thrust = -wp.sign(state.velocity[0])
    return wp.vec3d(ballast, f64(0.0), thrust)


@wp.func
def room_among(walls: wp.array(dtype=wp.vec3d), num: int, state: State, hull: Hull):
    """Return the distance from the hull to the nearest of the first `num` points of wall, m; infinite without any."""
    nose = nose_of(state, hull)
    nearest = f64(wp.inf)
    for n in range(num):
        offset = walls[n] - state.position
        ends = wp.min(wp.length_sq(offset - nose), wp.length_sq(offset + nose))
        nearest = wp.min(nearest, wp.min(ends, wp.length_sq(offset)))
    return wp.sqrt(nearest) - hull.radius


@wp.kernel
def stop(
    motion: Motion,
    controls: Controls,
    substeps: int,
    most: int,
    still: f64,
    hull: Hull,
    walls: wp.array(dtype=wp.vec3d),
    num_walls: wp.array(dtype=wp.int32),
    water: wp.vec3d,
    extra: wp.array2d(dtype=f64),
    states: wp.array3d(dtype=f64),
    trims: wp.array(dtype=f64),
    commands: wp.array(dtype=wp.vec3d),
    least: wp.array(dtype=f64),
    last: wp.array(dtype=f64),
):
    """Carry out a command and then a full stop; see `Stopping.foresee`."""
    i = wp.tid()
    state = read_state(states, i, extra)
    level = level_of(trims[i], controls)
    command = commands[i]
    nearest = f64(wp.inf)
    room = f64(wp.inf)
    for _ in range(most + 1):
        for _ in range(substeps):
            wrench, after = actuated(command, level, controls)
            level = after
            state = moved_freely(i, state, wrench, water, extra, motion)
        room = room_among(walls, num_walls[0], state, hull)
        nearest = wp.min(nearest, room)
        if wp.length(linear(state.velocity)) < still:
            break
        command = stopping(state, trim_of(level, controls), still)
    least[i] = nearest
    last[i] = room


class Stopping:
    """A vehicle that comes to a full stop in still water."""

    def __init__(self, predictor: Predictor, max_walls: int, most: int, still: float) -> None:
        """Prepare stops among up to `max_walls` points.

        Args:
            predictor: Of the vehicle.
            max_walls: Most points of wall.
            most: Longest stop that is run ahead, decisions.
            still: Speed that counts as stopped, m/s.
        """
        self._predictor, self._most, self._still = predictor, most, still
        self._walls = predictor.zeros((max_walls,), wp.vec3d)
        self._num_walls = predictor.zeros((1,), wp.int32)
        self._launches: dict[tuple[int, int], tuple[Any, list[Any], list[Array]]] = {}

    def foresee(self, state: Array, trim: float, commands: Array, walls: Array) -> tuple[Array, Array]:
        """Return the (K,) least and last distances between hull and walls, m, through a command and a full stop.

        Args:
            state: (S,) of the vehicle.
            trim: In [-1, 1].
            commands: (K, 3) ballast, steer and thrust.
            walls: (N, 3) points, m.
        """
        key = (len(commands), len(state))
        if key not in self._launches:
            self._launches[key] = self._record(*key)
        command, _, (states, trims, given, least, last) = self._launches[key]
        states[:, 0], trims[:], given[:] = state, trim, commands
        self._walls.numpy()[: len(walls)] = walls
        self._num_walls.numpy()[0] = len(walls)
        command.launch()
        return least.copy(), last.copy()

    def _record(self, num: int, size: int) -> tuple[Any, list[Any], list[Array]]:
        """Return a launch for so many rows, its arrays, and views of them."""
        given = self._predictor
        states, trims = given.zeros((num, 1, size)), given.zeros((num,))
        commands, found = given.zeros((num,), wp.vec3d), [given.zeros((num,)) for _ in range(2)]
        extra = given.zeros((num, size - STATE_SIZE))
        inputs = [given.motion, given.controls, given.substeps, self._most, self._still, given.hull]
        inputs += [self._walls, self._num_walls, wp.vec3d(), extra, states, trims, commands, *found]
        launch = launch_kernel(stop, dim=num, inputs=inputs, device=given.device, record_cmd=True)
        arrays = [states, trims, commands, *found]
        return launch, [*arrays, extra], [array.numpy() for array in arrays]
