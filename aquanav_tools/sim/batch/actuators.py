"""From a command to what a vehicle's motion takes: ballast, steer and thrust."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.motion import vec6
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.struct
class Controls:
    """What a command does: thrust and moment, and a level (trim, or a floater's power) that ballast moves.

    Thrust pushes ahead, or in reverse with a part of the force. Steer asks for a moment; for the original's vehicle
    under water it is steer times thrust. Ballast moves the level at a rate and leaves it where it is when nothing is
    commanded.
    """

    surge: f64
    """Full thrust ahead, N."""
    reverse_fraction: f64
    """Full thrust in reverse, as a fraction of that ahead."""
    yaw: f64
    """Moment of full steer, N m."""
    steers_at_rest: wp.int32
    """Whether the moment does not depend on thrust."""
    level_step: f64
    """Change of the level by full ballast in a physics step."""
    lowest: f64
    neutral: f64
    highest: f64
    heave_per_level: f64
    """What the level gives in the place of heave: N at full trim, or the floaters' power itself, N/m."""


def make_controls(vehicle: Vehicle, dt: float) -> Controls:
    """Return the actuators of a vehicle, for physics steps of `dt` (s).

    Raises:
        TypeError: the vehicle is of no model that swims.
    """
    controls = Controls()
    if isinstance(vehicle, FossenVehicle):
        actuators = vehicle.actuators
        controls.surge, controls.reverse_fraction = actuators.surge_force, actuators.reverse_fraction
        controls.yaw, controls.steers_at_rest = vehicle.full_steer, 1
        controls.level_step, controls.heave_per_level = actuators.trim_rate * dt, actuators.heave_force
        controls.lowest, controls.neutral, controls.highest = -1.0, 0.0, 1.0
    elif isinstance(vehicle, OriginalVehicle):
        drive, ballast = vehicle.drive, vehicle.ballast
        controls.surge, controls.reverse_fraction = drive.force, drive.reverse_fraction
        controls.yaw, controls.steers_at_rest = drive.steer_moment, int(drive.steers_at_rest)
        if ballast is not None:
            controls.level_step, controls.heave_per_level = ballast.power_rate * dt, 1.0
            controls.lowest, controls.neutral, controls.highest = ballast.min_power, ballast.power, ballast.max_power
    else:
        raise TypeError(f"No actuators are known for a {type(vehicle).__name__}.")
    return controls


@wp.func
def actuated(command: wp.vec3d, level: f64, controls: Controls):
    """Return what a command (ballast, steer, thrust) asks for in one physics step, and the level after it.

    The first is a (6,) wrench in the body frame, N and N m; for the original's vehicle thrust, the floaters' power in
    the place of heave, and the moment.
    """
    ballast, steer, ahead = command[0], command[1], command[2]
    surge, yaw = controls.surge * ahead, controls.yaw * steer
    if ahead < f64(0.0):
        surge *= controls.reverse_fraction
    if controls.steers_at_rest == 0:
        yaw *= ahead
    after = wp.clamp(level + ballast * controls.level_step, controls.lowest, controls.highest)
    zero = f64(0.0)
    return vec6(surge, zero, controls.heave_per_level * after, zero, zero, yaw), after


@wp.func
def trim_of(level: f64, controls: Controls):
    """Return the state of the ballast in [-1, 1]: 0 is neutral, 1 the highest level."""
    limit = controls.lowest
    if level > controls.neutral:
        limit = controls.highest
    if limit == controls.neutral:
        return f64(0.0)  # a vehicle afloat
    return (level - controls.neutral) / wp.abs(limit - controls.neutral)


@wp.func
def level_of(trim: f64, controls: Controls):
    """Return the level at a trim in [-1, 1]."""
    limit = controls.lowest
    if trim > f64(0.0):
        limit = controls.highest
    return controls.neutral + trim * wp.abs(limit - controls.neutral)
