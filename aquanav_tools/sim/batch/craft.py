"""A vehicle as the kernels have it: its model of motion, its actuators, its hull."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.contact import Hull
from aquanav_tools.sim.batch.motion import Body, make_body, vec6
from aquanav_tools.sim.batch.original import DraggedBody, make_dragged_body
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

f64 = wp.float64
FRICTION = 0.09
"""Bullet multiplies the two bodies' 0.3."""
CONTACT_MARGIN = 0.005
"""Bullet makes contacts between surfaces that overlap, or are within 0 to 7 mm of each other (measured), m."""


@wp.struct
class Controls:
    """What a command does: thrust and moment, and a level (trim, or a floater's power) that ballast moves."""

    surge: f64
    reverse_share: f64
    yaw: f64
    steers_at_rest: wp.int32
    level_step: f64
    lowest: f64
    neutral: f64
    highest: f64
    heave_per_level: f64


def make_controls(vehicle: Vehicle, dt: float) -> Controls:
    """Return the actuators of a vehicle, for physics steps of `dt` (s)."""
    controls = Controls()
    if isinstance(vehicle, FossenVehicle):
        actuators = vehicle.actuators
        controls.surge, controls.reverse_share = actuators.surge_force, actuators.reverse_share
        controls.yaw, controls.steers_at_rest = vehicle.full_steer, 1
        controls.level_step, controls.heave_per_level = actuators.trim_rate * dt, actuators.heave_force
        controls.lowest, controls.neutral, controls.highest = -1.0, 0.0, 1.0
    elif isinstance(vehicle, OriginalVehicle):
        drive, ballast = vehicle.drive, vehicle.ballast
        controls.surge, controls.reverse_share = drive.force, drive.reverse_share
        controls.yaw, controls.steers_at_rest = drive.steer_moment, int(drive.steers_at_rest)
        if ballast is not None:
            controls.level_step, controls.heave_per_level = ballast.power_rate * dt, 1.0
            controls.lowest, controls.neutral, controls.highest = ballast.min_power, ballast.power, ballast.max_power
    else:
        raise TypeError(f"No actuators are known for a {type(vehicle).__name__}.")
    return controls


@wp.struct
class Craft:
    """A vehicle: one of two models of motion, its actuators, its hull."""

    is_original: wp.int32
    body: Body
    dragged: DraggedBody
    controls: Controls
    hull: Hull


def make_craft(scenario: Scenario, vehicle: Vehicle, margin: float, device: Any) -> Craft:
    """Return a vehicle in a scenario's water, for contacts that are kept up to `margin` (m)."""
    craft, dt = Craft(), scenario.settings.limits.dt
    parameters = vehicle.motion_parameters(scenario.settings.water.density)
    craft.is_original = int(isinstance(vehicle, OriginalVehicle))
    if craft.is_original:
        craft.dragged = make_dragged_body(parameters, dt, device)
    else:
        craft.body = make_body(parameters, dt, device)
    craft.controls = make_controls(vehicle, dt)
    craft.hull = _make_hull(scenario, vehicle, margin)
    return craft


def _make_hull(scenario: Scenario, vehicle: Vehicle, margin: float) -> Hull:
    hull, capsule, mass = Hull(), vehicle.capsule, vehicle.total_mass
    hull.half_axis, hull.radius = 0.5 * capsule.axis_length, capsule.radius
    # A distance changes no faster than the position, and the mean distance to a cell's eight corners, weighted as the
    # interpolation does, is at most sqrt(3) / 2 spacings; the axis is sampled at its ends and its middle.
    field_error = 0.5 * np.sqrt(3.0) * scenario.field.spacing
    hull.margin, hull.friction = margin, FRICTION
    hull.reach = capsule.radius + margin + scenario.settings.collision_error + field_error + 0.25 * capsule.axis_length
    hull.mass, hull.inertia, hull.masses = mass[:3].mean(), mass[3:].mean(), vec6(*mass)
    return hull
