"""One vehicle in one cave: our own motion, PyBullet's contacts. The only module that imports pybullet.

Bullet knows neither added mass nor Coriolis forces in water, and feeding added mass back as a force diverges. So our
integrator moves the vehicle, and Bullet is asked only what the wall does to that motion: it gets the mean velocity of
our step, which in free water takes it exactly to our pose, and where a wall is in the way its pose and its change of
velocity are taken over. Where the distance field says that the hull cannot touch, Bullet is not asked at all.

Bullet is asked about one step at a time and remembers nothing between two: so all worlds of a cave and a vehicle share
one client with its tens of megabytes of triangles, and none can tell whether there are others.
"""

from __future__ import annotations

import tempfile
import threading
import weakref
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.water.field import DistanceField
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.libraries import stderr_silenced
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.contact import take_over_contact
from aquanav_tools.sim.hull import glide, hull_clearance
from aquanav_tools.sim.hydrodynamics import mean_velocity
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array, Mesh, Pose, yaw_quaternion

with stderr_silenced():
    import pybullet

FRICTION = 0.3
"""Between plastic and wet rock; chosen."""
CONTACT_MARGIN = 0.02
"""Bullet keeps contact points up to this distance (its contact breaking threshold), m."""
NORMAL_FORCE = 9
"""Position of the normal force in a row of pybullet.getContactPoints."""
CONCAVE = pybullet.GEOM_FORCE_CONCAVE_TRIMESH | pybullet.GEOM_CONCAVE_INTERNAL_EDGE
"""Without the first flag the cave collides as its convex hull; without the second, normals tilt at inner edges."""
ALONG_X = (0.0, float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5)))
"""Quaternion (x, y, z, w) that turns Bullet's capsule, along z, to body x."""


class _Arena:
    """A cave and a vehicle in a Bullet client, which is freed with the last world that uses it."""

    def __init__(self, cave: Mesh, vehicle: Vehicle, dt: float) -> None:
        self.lock = threading.Lock()
        self.mesh = cave
        # Bullet reads float32 coordinates from the file, so it works near the cave's middle.
        self.middle: Array = cave.vertices.mean(axis=0)
        self.client = _connect(dt)
        weakref.finalize(self, pybullet.disconnect, physicsClientId=self.client)
        self.cave = _load_cave(cave, self.middle, self.client)
        self.body = _load_vehicle(vehicle, self.client)
        self._outside = (2.0 * (np.ptp(cave.vertices, axis=0) + vehicle.capsule.length)).tolist()

    def solve(self, state: Array, velocity: list[float]) -> Array | None:
        """Move the vehicle for one step; return where the wall lets it, or None where there was no contact.

        Args:
            state: (13,) of the vehicle before the step, world.
            velocity: Linear and angular, world frame.

        Returns:
            (13,) position, quaternion (x, y, z, w), linear and angular velocity, in the world.
        """
        w, x, y, z = state[3:7].tolist()
        position = (state[:3] - self.middle).tolist()
        client, body = self.client, self.body
        with self.lock:
            # Away from the cave and back: Bullet forgets its contacts, which would guess the forces of the next ones.
            pybullet.resetBasePositionAndOrientation(body, self._outside, (0.0, 0.0, 0.0, 1.0), physicsClientId=client)
            pybullet.performCollisionDetection(physicsClientId=client)
            pybullet.resetBasePositionAndOrientation(body, position, (x, y, z, w), physicsClientId=client)
            pybullet.resetBaseVelocity(body, velocity[:3], velocity[3:], physicsClientId=client)
            pybullet.stepSimulation(physicsClientId=client)
            contacts = pybullet.getContactPoints(body, self.cave, physicsClientId=client)
            if not any([contact[NORMAL_FORCE] > 0.0 for contact in contacts]):
                return None
            return self.solved_motion()

    def solved_motion(self) -> Array:
        """Return Bullet's (13,) position, quaternion (x, y, z, w), linear and angular velocity, in the world."""
        position, orientation = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self.client)
        linear, angular = pybullet.getBaseVelocity(self.body, physicsClientId=self.client)
        solved = np.array((*position, *orientation, *linear, *angular))
        solved[:3] += self.middle
        return solved


_arenas: weakref.WeakValueDictionary[tuple[Any, ...], _Arena] = weakref.WeakValueDictionary()


def _arena_of(cave: Mesh, vehicle: Vehicle, dt: float) -> _Arena:
    """Return the arena of a cave and a vehicle, made where there is none yet."""
    # An arena keeps its mesh, so that no other mesh gets that one's id while it is used.
    key = (id(cave), vehicle.capsule, *_mass_and_inertia(vehicle), dt)
    arena = _arenas.get(key)
    if arena is None:
        arena = _arenas[key] = _Arena(cave, vehicle, dt)
    return arena


class BulletWorld:
    """A cave with one vehicle. Close it after use."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle) -> None:
        limits = scenario.settings.limits
        self.state: Array = vehicle.state_at(Pose(np.zeros(3), yaw_quaternion(0.0)))
        """(13,) position (world, m), quaternion (w, x, y, z), velocity over ground (body, m/s and rad/s), and what the
        vehicle's model adds."""
        self._free: Array = self.state.copy()
        self._vehicle = vehicle
        self._dt = limits.dt
        self._parameters = vehicle.motion_parameters(scenario.settings.water.density)
        self._half_axis = 0.5 * vehicle.capsule.axis_length
        self._radius = vehicle.capsule.radius
        self._mass = vehicle.total_mass
        self._reach = _contact_reach(vehicle, scenario)
        self._field = scenario.field
        self._grid = scenario.field.grid
        self._arena: _Arena | None = _arena_of(scenario.collision, vehicle, limits.dt)

    def reset(self, pose: Pose) -> None:
        """Put the vehicle at rest at a pose."""
        self.state[:] = self._vehicle.state_at(pose)

    def step(self, wrenches: Array, current: Array) -> list[bool]:
        """Advance one decision.

        Args:
            wrenches: (N, 6) from the actuators per physics step: for most vehicles a wrench, body frame, N and N m.
            current: (3,) velocity of the water, world frame, m/s.

        Returns:
            For each of the N steps, whether the hull touched a wall.
        """
        touched = [False] * len(wrenches)
        index = self._glide(wrenches, 0, current)
        while index < len(wrenches):
            touched[index] = self._step_beside_wall()
            index = self._glide(wrenches, index + 1, current)
        return touched

    def clearance(self) -> float:
        """Return the distance from the hull to the nearest wall, m."""
        return float(hull_clearance(self.state, self._half_axis, self._radius, *self._grid))

    def close(self) -> None:
        """Let go of the cave. Closing twice does nothing."""
        self._arena = None

    def _glide(self, wrenches: Array, first: int, current: Array) -> int:
        """Advance while the wall is out of reach; return the index of the next step, and leave its end in _free."""
        last = glide(
            self.state,
            wrenches,
            first,
            current,
            self._parameters,
            self._dt,
            self._half_axis,
            self._reach,
            *self._grid,
            self._free,
        )
        return int(last)

    def _step_beside_wall(self) -> bool:
        """Take the step to _free with Bullet watching the wall; return whether there was contact."""
        if self._arena is None:
            raise InputError("This environment was closed. Make a new one to go on.")
        intended = mean_velocity(self.state, self._free, self._dt)
        solved = self._arena.solve(self.state, intended.tolist())
        if solved is None:
            self.state[:] = self._free
            return False
        last_pose = self.state[:7].copy()
        take_over_contact(self._free, intended, solved, self._mass, self.state)
        if self._field.clearance_at(self.state[:3]) < 0.0:
            # It tunnelled through, or was pressed through, the thin shell: back to the last place in the water.
            self.state[:7], self.state[7:13] = last_pose, 0.0
        return True


def _mass_and_inertia(vehicle: Vehicle) -> tuple[float, float]:
    """Return one mass, kg, and one moment of inertia, kg m^2, for all directions.

    Bullet would add gyroscopic moments to a body with unequal inertias; ours are integrated outside.
    """
    return float(vehicle.total_mass[:3].mean()), float(vehicle.total_mass[3:].mean())


def _contact_reach(vehicle: Vehicle, scenario: Scenario) -> float:
    """Return the clearance of the axis (m) above which Bullet can find no contact."""
    capsule, field = vehicle.capsule, scenario.field
    return (
        capsule.radius
        + CONTACT_MARGIN
        + scenario.settings.collision_error
        + _field_error(field)
        + 0.25 * capsule.axis_length
    )


def _field_error(field: DistanceField) -> float:
    """Return the bound on the error of trilinear interpolation of a distance, m.

    A distance changes no faster than the position, and the weights' mean distance to the eight corners is at most
    sqrt(3) / 2 spacings (reached in the middle of a cell).
    """
    return float(0.5 * np.sqrt(3.0) * field.spacing)


def _connect(dt: float) -> int:
    client = int(pybullet.connect(pybullet.DIRECT))
    if client < 0:
        raise ResourceError("PyBullet gave no further simulation client. Close environments that are no longer used.")
    # File caching would share meshes of the same name between caves.
    pybullet.setPhysicsEngineParameter(
        enableFileCaching=0, deterministicOverlappingPairs=1, fixedTimeStep=dt, physicsClientId=client
    )
    pybullet.setGravity(0.0, 0.0, 0.0, physicsClientId=client)
    return client


def _load_cave(mesh: Mesh, middle: Array, client: int) -> int:
    """Return the id of a static body with the mesh, moved so that `middle` is at the origin.

    The faces are turned over: Bullet rights tilted contact normals only on the side that a face's normal points to,
    which for the vehicle is the inside of the cave.
    """
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in mesh.vertices - middle]
    lines += [f"f {a} {c} {b}\n" for a, b, c in mesh.faces + 1]
    with tempfile.TemporaryDirectory(prefix="aquanav-") as folder:
        path = Path(folder, "cave.obj")
        path.write_text("".join(lines), encoding="ascii")
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, fileName=str(path), flags=CONCAVE, physicsClientId=client
        )
        body = int(pybullet.createMultiBody(0, shape, physicsClientId=client))
    pybullet.changeDynamics(body, -1, lateralFriction=FRICTION, restitution=0.0, physicsClientId=client)
    return body


def _load_vehicle(vehicle: Vehicle, client: int) -> int:
    """Return the id of a body with the capsule along x."""
    mass, inertia = _mass_and_inertia(vehicle)
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_CAPSULE,
        radius=vehicle.capsule.radius,
        height=vehicle.capsule.axis_length,
        collisionFrameOrientation=ALONG_X,
        physicsClientId=client,
    )
    body = int(pybullet.createMultiBody(mass, shape, physicsClientId=client))
    pybullet.changeDynamics(
        body,
        -1,
        linearDamping=0.0,
        angularDamping=0.0,
        lateralFriction=FRICTION,
        restitution=0.0,
        localInertiaDiagonal=[inertia] * 3,
        physicsClientId=client,
    )
    return body
