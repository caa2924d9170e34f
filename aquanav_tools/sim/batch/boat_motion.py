"""The motion of a boat in Warp: drives, waves and wind on a rigid body, with the loads in the middle of each step.

Taking the loads of pressure and drag in the middle of the step conserves the energy of a boat that bobs undamped. The
wind's force on what stands above the water is

    X = -q cx A_front cos(b),   Y = -q cy A_side sin(b),   N = -q cn A_side L sin(2 b),   q = air density / 2 * V^2

V and b are speed and direction of the motion through the air, b from the bow to the left. Forces act at the height of
the areas' middle, so that they heel and trim, too. The mean wind there is less than at 10 m, by a power of the height.

Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2nd edition, 2021), chapter 10.1, wind forces
on craft that are symmetric to both sides and nearly so fore and aft.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.actuators import Controls, actuated, make_controls
from aquanav_tools.sim.batch.boat_hull import G, HullSurface, HullWork, make_hull_surface, make_hull_work, water_wrench
from aquanav_tools.sim.batch.boat_water import Sea, pack_sea
from aquanav_tools.sim.batch.motion import (
    Body,
    State,
    angular,
    linear,
    make_body,
    moved,
    read_motion,
    rotation_of,
    six,
    swim,
    vec6,
    write_motion,
)
from aquanav_tools.sim.batch.original import DraggedBody, drag_along, make_dragged_body
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS, find_device, launch_kernel
from aquanav_tools.sim.batch.waves import num_blocks, vec8
from aquanav_tools.sim.boat import NO_SKIN, Boat
from aquanav_tools.sim.body_parameters import BodyParameters
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.windage import Windage
from aquanav_tools.types import Array

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64


@wp.struct
class WindLoad:
    """Coefficients of `windage.Windage`: zeros leave the wind out."""

    surge: f64
    sway: f64
    turning: f64
    arm: f64
    fraction: f64
    """Of the wind at 10 m."""


@wp.struct
class BoatBody:
    """A boat: one of two models of motion, its drives, its hulls, and what it shows to the wind."""

    is_original: wp.int32
    dragged: DraggedBody
    body: Body
    mass: f64
    surface: HullSurface
    wind: WindLoad
    controls: Controls
    mobility: vec6
    """Change of velocity per impulse along and about body x, y, z; 0 where the boat is held."""


def make_boat_body(boat: Boat | OriginalVehicle, density: float, dt: float, device: Any) -> BoatBody:
    """Return a boat in water of a density (kg/m^3), for steps of `dt` (s)."""
    body = BoatBody()
    if isinstance(boat, OriginalVehicle):
        body.is_original = 1
        body.dragged = make_dragged_body(boat.motion_parameters(density), dt, device)
        body.surface = make_hull_surface(NO_SKIN, density, 0.0, 0.0, device)
        body.controls = make_controls(boat, dt)
        body.mobility = vec6(*mobility_of(boat))
        return body
    parameters = boat_parameters([boat], np.zeros((1, 3)))
    body.body, body.mass = make_body(parameters, dt, device), boat.mass
    body.surface = make_hull_surface(boat.surface, density, boat.normal_drag, boat.friction, device)
    body.wind = make_wind_load(boat.windage)
    body.controls = _make_controls(boat)
    body.mobility = vec6(*mobility_of(boat))
    return body


def mobility_of(boat: Boat | OriginalVehicle) -> Array:
    """Return the (6,) `BoatBody.mobility` of a boat."""
    mobility: Array = 1.0 / boat.total_mass
    if isinstance(boat, OriginalVehicle):
        mobility[2:5] = 0.0  # it stays level at its height
    return mobility


def boat_parameters(boats: Sequence[Boat], arms: Array) -> BodyParameters:
    """Return what the equations of motion take of N boats; `arms` are (N, 3), as of `BodyParameters.arm`.

    Weight, and what the water and the air do, are loads from outside.
    """
    masses = np.array([boat.total_mass for boat in boats])[:, :, None] * np.eye(6)
    return BodyParameters(masses, np.array([boat.linear_damping for boat in boats]), np.zeros(6), arm=arms)


def make_wind_load(windage: Windage | None) -> WindLoad:
    """Return the coefficients of what a boat shows to the wind."""
    load = WindLoad()
    if windage is not None:
        load.surge, load.sway, load.turning, load.arm, load.fraction = windage.coefficients().tolist()
    return load


def _make_controls(boat: Boat) -> Controls:
    """Return the drives of a boat; it has no ballast, and steers without thrust."""
    controls = Controls()
    controls.surge, controls.reverse_fraction = boat.surge_force, boat.reverse_fraction
    controls.yaw, controls.steers_at_rest = boat.yaw_moment, 1
    return controls


@wp.func
def drive_wrench(steer: f64, thrust: f64, controls: Controls):
    """Return the wrench of steer (left) and thrust (ahead) in [-1, 1], body frame, N and N m."""
    wrench, _ = actuated(wp.vec3d(f64(0.0), steer, thrust), f64(0.0), controls)
    return wrench


@wp.func
def wind_wrench(rotation: wp.mat33d, velocity: vec6, wind: wp.vec2d, load: WindLoad):
    """Return the wind's force and moment about the centre of mass, body frame, N and N m.

    Args:
        rotation: World from body.
        velocity: Over ground, body frame, m/s.
        wind: Velocity of the air at 10 m, world x and y, m/s.
        load: What the boat shows to it.
    """
    ahead = velocity[0] - load.fraction * (rotation[0, 0] * wind[0] + rotation[1, 0] * wind[1])
    left = velocity[1] - load.fraction * (rotation[0, 1] * wind[0] + rotation[1, 1] * wind[1])
    speed = wp.sqrt(ahead * ahead + left * left)
    surge, sway = -load.surge * speed * ahead, -load.sway * speed * left
    return vec6(surge, sway, f64(0.0), -load.arm * sway, load.arm * surge, -load.turning * ahead * left)


@wp.func
def drifted(state: State, dt: f64):
    """Return the state after its velocity was held for `dt`."""
    o, turning = state.orientation, f64(0.5) * angular(state.velocity)
    x, y, z = turning[0], turning[1], turning[2]
    change = State()
    change.position = rotation_of(o) * linear(state.velocity)
    change.orientation = wp.vec4d(
        -o[1] * x - o[2] * y - o[3] * z,
        o[0] * x + o[2] * z - o[3] * y,
        o[0] * y - o[1] * z + o[3] * x,
        o[0] * z + o[1] * y - o[2] * x,
    )
    return moved(state, change, dt)


@wp.func
def sail(
    i: int, state: State, drives: vec6, current: wp.vec3d, wind: wp.vec2d, sea: Sea, elapsed: f64, boat: BoatBody,
    work: HullWork, dt: f64,
):  # fmt: skip
    """Return the state of boat `i` one step later, were there nothing to touch.

    Args:
        i: Row of the sea and of the work's arrays.
        state: Position of the centre of mass, z from still water; velocity over ground, body frame.
        drives: Wrench of the drives, body frame, N and N m.
        current: Velocity of the water without its waves, world, m/s.
        wind: Velocity of the air at 10 m, world x and y, m/s.
        sea: Waves.
        elapsed: Time since the waves' phases were what they are, at the step's beginning, s.
        boat: The body.
        work: Room to compute in.
        dt: Step, s.
    """
    if boat.is_original == 1:
        return drag_along(state, drives, f64(0.0), current, boat.dragged, dt)
    middle = drifted(state, f64(0.5) * dt)
    rotation = rotation_of(middle.orientation)
    half = elapsed + f64(0.5) * dt
    wrench = drives + water_wrench(
        i, middle.position, rotation, middle.velocity, current, sea, half, boat.surface, work
    )
    weight = -boat.mass * G * wp.vec3d(rotation[2, 0], rotation[2, 1], rotation[2, 2])
    wrench += six(weight, wp.vec3d()) + wind_wrench(rotation, middle.velocity, wind, boat.wind)
    return swim(state, wrench, current, boat.body, dt)


@wp.kernel
def sail_alone(
    action: wp.vec2d, current: wp.vec3d, wind: wp.vec2d, sea: Sea, boat: BoatBody, work: HullWork, dt: f64,
    positions: wp.array(dtype=wp.vec3d), orientations: wp.array(dtype=wp.vec4d), velocities: wp.array(dtype=vec6),
):  # fmt: skip
    """Fill the rows of a voyage's states from its first."""
    state = read_motion(0, positions, orientations, velocities)
    drives = drive_wrench(action[0], action[1], boat.controls)
    for n in range(1, positions.shape[0]):
        state = sail(0, state, drives, current, wind, sea, dt * f64(n - 1), boat, work, dt)
        write_motion(n, state, positions, orientations, velocities)


@wp.kernel
def probe_loads(
    position: wp.vec3d, orientation: wp.vec4d, velocity: vec6, action: wp.vec2d, current: wp.vec3d, wind: wp.vec2d,
    sea: Sea, boat: BoatBody, work: HullWork, loads: wp.array(dtype=vec6),
):  # fmt: skip
    """Write the loads of water, wind and drives on a boat."""
    rotation = rotation_of(orientation)
    loads[0] = water_wrench(0, position, rotation, velocity, current, sea, f64(0.0), boat.surface, work)
    loads[1] = wind_wrench(rotation, velocity, wind, boat.wind)
    loads[2] = drive_wrench(action[0], action[1], boat.controls)


class OpenWater:
    """One boat, one sea and nothing to touch: for looking at its motion by itself."""

    def __init__(self, boat: Boat | OriginalVehicle, density: float, dt: float) -> None:
        """Prepare steps of `dt` (s) in water of a density, kg/m^3."""
        self._device, self._dt = find_device("cpu"), dt
        self._body = make_boat_body(boat, density, dt, self._device)
        self.set_sea(np.zeros((0, 7)), np.zeros(0))
        self.current, self.wind = np.zeros(3), np.zeros(2)
        """Velocity of the water without its waves (3,) and of the air at 10 m (2,), world, m/s."""

    def set_sea(self, waves: Array, phases: Array) -> None:
        """Put the boat on (W, 7) waves of `waves.wave_parameters` with (W,) phases now, rad."""
        blocks, self._sea = num_blocks(len(waves)), Sea()
        table, turned = pack_sea(waves, phases, blocks)
        self._sea.table = wp.array(table[None], dtype=vec8, ndim=3, device=self._device)
        self._sea.phases = wp.array(turned[None], dtype=vec8, ndim=2, device=self._device)
        self._work = make_hull_work(1, self._body.surface, blocks, self._device)

    def voyage(self, state: Array, steps: int, steer: float = 0.0, thrust: float = 0.0) -> Array:
        """Return the (1 + steps, 13) states of a boat from a (13,) state, its steer and thrust held."""
        rows = np.tile(state, (steps + 1, 1))
        parts = zip((rows[:, :3], rows[:, 3:7], rows[:, 7:13]), (wp.vec3d, wp.vec4d, vec6), strict=True)
        arrays = [
            wp.array(np.ascontiguousarray(part), dtype=kind, device=self._device) for part, kind in parts
        ]  # fmt: skip
        around = [wp.vec3d(*self.current), wp.vec2d(*self.wind), self._sea, self._body, self._work, self._dt]
        launch_kernel(sail_alone, dim=1, inputs=[wp.vec2d(steer, thrust), *around, *arrays], device=self._device)
        return np.concatenate([array.numpy() for array in arrays], axis=1)

    def loads(self, state: Array, steer: float = 0.0, thrust: float = 0.0) -> Array:
        """Return the (3, 6) wrenches of water, wind and drives in a (13,) state, body frame, N and N m."""
        found = wp.zeros(3, dtype=vec6, device=self._device)
        where = [wp.vec3d(*state[:3]), wp.vec4d(*state[3:7]), vec6(*state[7:13]), wp.vec2d(steer, thrust)]
        around = [wp.vec3d(*self.current), wp.vec2d(*self.wind), self._sea, self._body, self._work]
        launch_kernel(probe_loads, dim=1, inputs=[*where, *around, found], device=self._device)
        return found.numpy()
