"""Vehicles as the kernels have them: model of motion, actuators, hull."""

from __future__ import annotations

from typing import Any

import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.actuators import Controls, make_controls
from aquanav_tools.sim.batch.contact_points import FIELD_ERROR, Hull
from aquanav_tools.sim.batch.motion import Body, make_body, vec6
from aquanav_tools.sim.batch.original import DraggedBody, make_dragged_body
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

f64 = wp.float64
FRICTION = 0.09
"""Bullet multiplies the two bodies' 0.3."""
CONTACT_MARGIN = 0.005
"""Bullet makes contacts between surfaces that overlap, or are within 0 to 7 mm of each other (measured), m."""


@wp.struct
class Craft:
    """A vehicle: one of two models of motion, its actuators, its hull."""

    is_original: wp.int32
    controls: Controls
    hull: Hull
    body: Body
    dragged: DraggedBody
    """Last, as `prefetch` leaves it out for vehicles that have a body."""


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
    # A distance changes no faster than the position; the axis is sampled at its ends and its middle.
    field_error = FIELD_ERROR.value * scenario.field.spacing
    hull.margin, hull.friction = margin, FRICTION
    hull.reach = capsule.radius + margin + scenario.settings.collision_error + field_error + 0.25 * capsule.axis_length
    hull.mass, hull.inertia, hull.masses = mass[:3].mean(), mass[3:].mean(), vec6(*mass)
    return hull


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
const char* craft = (const char*)(crafts.data + later);
const size_t num_used = (const char*)&crafts.data[later].dragged - craft;
const size_t num_read = crafts.data[next].is_original ? sizeof(*crafts.data) : num_used;
for (size_t line = 0; line < num_read; line += 64) __builtin_prefetch(craft + line);
const auto& soon = crafts.data[next].body;
for (int n = 0; soon.is_coupled && n < 9; ++n) __builtin_prefetch((const char*)soon.matrix.data + 64 * n);
const char* thrusters = (const char*)soon.thrusters.data;
const size_t num_bytes = soon.num_thrusters * sizeof(*soon.thrusters.data);
for (size_t line = 0; line < num_bytes; line += 64) __builtin_prefetch(thrusters + line);
#endif
""")
def prefetch(crafts: wp.array(dtype=Craft), next: int, later: int):
    """Ask the processor's cache for the vehicle after the next, and for what the next one, there by now, points to.

    Where each vehicle is one of its own, 1 kB and more, a kernel on the processor would wait for the memory.
    """
    ...
