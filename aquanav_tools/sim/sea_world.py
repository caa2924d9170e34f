"""A boat among rocks: its motion afloat, and what rocks, reefs and the bay's edge do to it.

Rocks stand upright, so that seen from above a contact is one of two outlines, which a few compiled lines solve exactly.
Bullet would need the rocks as triangles anew for the bay of each episode, to find the same points. The rule is that of
contacts in caves: no bounce, Coulomb friction, overlaps are pushed apart without a gain of speed, so that a rock never
gives a boat kinetic energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from aquanav_tools.sea.hull_contact import deepest_contact, hull_clearance
from aquanav_tools.sea.sea_map import Berth, SeaMap
from aquanav_tools.sim import original_motion
from aquanav_tools.sim.actuators import actuator_model
from aquanav_tools.sim.afloat import advance_afloat
from aquanav_tools.sim.boat import Boat, Body, Skin
from aquanav_tools.sim.body_parameters import ORIGINAL
from aquanav_tools.sim.hydrodynamics import rotation_rows
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.sim.windage import NO_WINDAGE
from aquanav_tools.types import Array, Pose, yaw_quaternion

DENSITY = 1025.0
"""Of seawater, kg/m^3."""
FRICTION = 0.09
"""Of a hull on rock: Bullet's between vehicle and wall, the square of 0.3."""
ORIGINAL_DRAUGHT = 0.59
"""How deep the original's boat is taken to lie, m: half of its hull's 1.18 m, since its water is not known."""
NO_SKIN = Skin(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 3), dtype=np.int64))
MAX_CONTACTS = 4
"""Contacts that are solved in one step, the deepest first: two rocks and a corner of the bay."""


class Footprint(NamedTuple):
    """A boat's hull as contacts have it: a convex polygon, grown by a radius, with a flat bottom."""

    outline: Array
    """(C, 2) counter-clockwise, body frame, m; the hull of a capsule is its axis."""
    radius: float
    """m."""
    bottom: float
    """Height of its bottom in the body frame, m."""

    @property
    def width(self) -> float:
        """Across the boat, m."""
        return float(np.ptp(self.outline[:, 1])) + 2.0 * self.radius

    @property
    def length(self) -> float:
        """Along the boat, m."""
        return float(np.ptp(self.outline[:, 0])) + 2.0 * self.radius


def footprint_of(boat: Boat | OriginalVehicle) -> Footprint:
    """Return a boat's hull from above; the space between several hulls counts as boat."""
    if isinstance(boat, OriginalVehicle):
        half = 0.5 * boat.capsule.axis_length
        return Footprint(np.array([[-half, 0.0], [half, 0.0]]), boat.capsule.radius, -ORIGINAL_DRAUGHT)
    from scipy.spatial import ConvexHull

    corners = np.concatenate([hull.outline for hull in boat.hulls])
    bottom = min(hull.position[2] - 0.5 * hull.height for hull in boat.hulls)
    return Footprint(np.ascontiguousarray(corners[ConvexHull(corners).vertices]), 0.0, bottom)


def body_of(boat: Boat | OriginalVehicle) -> tuple[Body, Array]:
    """Return a boat as `sail` takes it, and its (6,) masses."""
    if isinstance(boat, Boat):
        return boat.body(DENSITY), boat.total_mass
    # it stays level at its height
    mass = np.array([boat.body.mass, boat.body.mass, np.inf, np.inf, np.inf, boat.body.inertia[2]])
    return Body(NO_SKIN, np.zeros(4), NO_WINDAGE, boat.motion_parameters(DENSITY).packed()), mass


def state_at_berth(boat: Boat | OriginalVehicle, berth: Berth, water: SeaWater) -> Array:
    """Return the state of a boat at rest afloat at a berth, as `SeaWorld.state` has it."""
    if isinstance(boat, OriginalVehicle):
        return boat.state_at(Pose(np.array([*berth.position, 0.0]), yaw_quaternion(berth.heading)))
    state = boat.state_at(berth.position, berth.heading, DENSITY)
    state[2] += water.rise(state[None, :3])[0]
    return state


class SeaWorld:
    """One boat in one bay after another. `begin`, then `step` once per decision."""

    def __init__(self, boat: Boat | OriginalVehicle, dt: float, substeps: int) -> None:
        """Prepare decisions of `substeps` steps of `dt` (s)."""
        self.footprint = footprint_of(boat)
        self.state: Array = np.zeros(0)
        """(13,) position of the boat's middle (z from still water), quaternion, velocity over ground in the body frame;
        the original's has one number more."""
        self.before: Array = np.zeros(0)
        """The state one physics step earlier."""
        self._boat, self._dt, self._substeps = boat, dt, substeps
        self._sea: SeaMap | None = None
        self._tops: Array = np.zeros(0)
        self._actuators = None if isinstance(boat, Boat) else actuator_model(boat, dt, substeps)
        self._body, self._mass = body_of(boat)

    def begin(self, sea: SeaMap, berth: Berth, water: SeaWater) -> None:
        """Put the boat at rest afloat at a berth of a bay."""
        self._sea, self._tops = sea, np.array([rock.top for rock in sea.rocks])
        self.state = state_at_berth(self._boat, berth, water)
        self.before = self.state.copy()

    def step(self, steer: float, thrust: float, water: SeaWater, current: Array) -> list[bool]:
        """Hold steer (left) and thrust (ahead) in [-1, 1] for a decision; return for each step whether it touched.

        The water's waves go on from what they are now, its wind holds; `water` itself is left as it is.

        Args:
            steer: In [-1, 1].
            thrust: In [-1, 1].
            water: Its waves and wind are taken.
            current: (3,) velocity of the water without waves, m/s.
        """
        assert self._sea is not None, "begin comes first"
        touched = np.zeros(self._substeps, dtype=np.bool_)
        shape = (self.footprint.outline, self.footprint.radius, self.footprint.bottom)
        command = self._command(steer, thrust)
        sail(self.state, self.before, command, (current, water.wind), water.waves, self._body, self._mass, shape,
              tuple(self._sea.outlines), self._tops, self._dt, touched)  # fmt: skip
        found: list[bool] = touched.tolist()
        return found

    def clearance(self) -> float:
        """Return the distance from the hull to the nearest rock, reef or edge from above, m; below 0 over a reef."""
        assert self._sea is not None, "begin comes first"
        hull = np.empty((len(self.footprint.outline), 3))
        place_hull(self.state, self.footprint.outline, self.footprint.bottom, hull)
        return float(hull_clearance(hull, self.footprint.radius, *self._sea.outlines))

    def _command(self, steer: float, thrust: float) -> Array:
        if isinstance(self._boat, Boat):
            return self._boat.command(steer, thrust)
        assert self._actuators is not None
        return self._actuators.apply(0.0, steer, thrust)[0]


@numba.njit(cache=True)
def sail(state, before, command, flows, sea, body, mass, shape, outlines, tops, dt, touched):  # type: ignore[no-untyped-def]
    """Move a state through the steps of a decision, in place.

    Args:
        state: As `SeaWorld.state`.
        before: Receives the state one step before the last.
        command: (6,) of the drives, body frame, N and N m.
        flows: (3,) velocity of the water without waves, and (2,) of the air at 10 m, world frame, m/s.
        sea: (N, 7) waves and their (N,) phases now, rad.
        body: First of `body_of`.
        mass: Second of `body_of`.
        shape: A `Footprint`.
        outlines: `Outlines` of the bay's rocks.
        tops: Of the rocks, m.
        dt: Step, s.
        touched: (S,) receives for each step whether the hull touched.
    """
    waves, phases = sea
    parameters = body.parameters
    outline, radius, bottom = shape
    corners, first, discs, edge = outlines
    rates, hull, contact = waves[:, 3], np.empty((len(outline), 3)), np.empty(7)
    for n in range(len(touched)):
        before[:] = state
        if parameters[0] == ORIGINAL:
            state[:] = original_motion.advance(state, command, flows[0], parameters, dt)
        else:
            now = phases + (n + 0.5) * dt * rates
            state[:] = advance_afloat(state, command, flows, waves, now, body, dt)
        for _ in range(MAX_CONTACTS):
            place_hull(state, outline, bottom, hull)
            deepest_contact(hull, radius, corners, first, discs, edge, tops, contact)
            if contact[0] <= 0.0:
                break
            touched[n] = True
            _push_off(state, contact, mass)


@numba.njit(cache=True)
def place_hull(state, outline, bottom, hull):  # type: ignore[no-untyped-def]
    """Write the (C, 3) corners of the hull's bottom in the world."""
    rotation = rotation_rows(state)
    for axis in range(3):
        row = rotation[axis]
        for k in range(len(outline)):
            hull[k, axis] = state[axis] + row[0] * outline[k, 0] + row[1] * outline[k, 1] + row[2] * bottom


@numba.njit(cache=True)
def _push_off(state, contact, mass):  # type: ignore[no-untyped-def]
    """Move a state out of an overlap, and take away its velocity into the rock and, by friction, along it."""
    rotation, normal, arm = rotation_rows(state), np.zeros(3), np.zeros(3)
    for axis in range(3):
        for k in range(3):
            normal[k] += rotation[axis][k] * contact[1 + axis]
            arm[k] += rotation[axis][k] * (contact[4 + axis] - state[axis])
    for axis in range(3):
        state[axis] += contact[0] * contact[1 + axis]
    velocity = state[7:10] + np.cross(state[10:13], arm)
    closing = -np.dot(velocity, normal)
    if closing <= 0.0:
        return
    pressed = closing / _give(arm, normal, mass)
    sliding = velocity + closing * normal
    speed = np.sqrt(np.dot(sliding, sliding))
    _hit(state, arm, pressed * normal, mass)
    if speed > 0.0:
        along = sliding / speed
        _hit(state, arm, -min(FRICTION * pressed, speed / _give(arm, along, mass)) * along, mass)


@numba.njit(cache=True)
def _give(arm, way, mass):  # type: ignore[no-untyped-def]
    """Return the change of a point's velocity along a way per impulse along it, 1/kg."""
    turn, give = np.cross(arm, way), 0.0
    for k in range(3):
        give += way[k] * way[k] / mass[k] + turn[k] * turn[k] / mass[3 + k]
    return give


@numba.njit(cache=True)
def _hit(state, arm, impulse, mass):  # type: ignore[no-untyped-def]
    turn = np.cross(arm, impulse)
    for k in range(3):
        state[7 + k] += impulse[k] / mass[k]
        state[10 + k] += turn[k] / mass[3 + k]
