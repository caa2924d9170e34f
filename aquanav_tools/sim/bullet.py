"""PyBullet's contacts, the reference for our own. The only module that imports pybullet.

Bullet knows neither added mass nor Coriolis forces in water, and feeding added mass back as a force diverges. So our
integrator moves the vehicle, and Bullet is asked only what the wall does to that motion: it gets the mean velocity of
our step, which in free water takes it exactly to our pose, and where a wall is in the way its pose and its change of
velocity are taken over. Where the distance field says that the hull cannot touch, Bullet is not asked at all.

All worlds of a cave share one client with its tens of megabytes of triangles. Only the vehicle that moves is awake in
it: Bullet passes over pairs of which both are asleep, so that the others keep their contacts, from which the next ones
go on, to the bit. No world can tell whether there are others.
"""

from __future__ import annotations

import os
import tempfile
import threading
import weakref
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.libraries import stderr_silenced
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array, Mesh

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
SLEEP, STAY_AWAKE = 8, 2
"""Activation states of pybullet.changeDynamics: asleep from now on, and awake however slow."""
REST = 1 | 8 | 32
"""A third one: may sleep, sleeps and is not woken by others."""
VEHICLES, CAVES = 1, 2
"""Bits of Bullet's collision filter."""
NO_BODY = -1
OUTSIDE = 1000.0
"""Distance from the cave at which no vehicle touches it, m."""
ALONG_X = (0.0, float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5)))
"""Quaternion (x, y, z, w) that turns Bullet's capsule, along z, to body x."""


class _Arena:
    """A cave in a Bullet client, with one body per world; the client is freed with the last world that uses it.

    The cave is what Bullet calls a multibody, a kind that keeps internal-edge correction; the vehicles are rigid
    bodies, a kind that falls asleep at once when told to.
    """

    def __init__(self, cave: Mesh, dt: float) -> None:
        self.mesh = cave
        """Kept, so that no other mesh gets its id."""
        # Bullet reads float32 coordinates from the file, so it works near the cave's middle.
        middle = cave.vertices.mean(axis=0)
        self._middle: list[float] = middle.tolist()
        self._client = _connect(dt)
        weakref.finalize(self, pybullet.disconnect, physicsClientId=self._client)
        self._cave = _load_cave(cave, middle, self._client)
        self._outside = (float(np.ptp(cave.vertices, axis=0).max()) + OUTSIDE, 0.0, 0.0)
        self._awake = NO_BODY
        self._abandoned: list[int] = []
        self._lock = threading.Lock()  # Bullet takes no two threads, and waking and moving belong together

    def enter(self, vehicle: Vehicle) -> int:
        """Return the id of a new body of a vehicle, asleep."""
        with self._lock:
            while self._abandoned:
                self._remove(self._abandoned.pop())
            body = _load_vehicle(vehicle, self._client)
        self.forget(body)
        return body

    def leave(self, body: int) -> None:
        """Take a body out before the next one enters. Safe while another call is under way, as a finaliser must be."""
        self._abandoned.append(body)

    def forget(self, body: int) -> None:
        """Bring a body to where nothing has happened to it yet, to the bit: at rest, upright, outside the cave."""
        client = self._client
        with self._lock:
            self._awaken(body)
            pybullet.resetBasePositionAndOrientation(body, self._outside, (0.0, 0.0, 0.0, 1.0), physicsClientId=client)
            pybullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), physicsClientId=client)
            # Inertia in the world follows mass and orientation at the end of a step only.
            pybullet.stepSimulation(physicsClientId=client)
            # Bullet drops all that it knows of the pairs of a body whose filter is set, even to what it was.
            pybullet.setCollisionFilterGroupMask(body, -1, VEHICLES, CAVES, physicsClientId=client)

    def solve(self, body: int, question: Sequence[float], is_continued: bool) -> tuple[float, ...] | None:
        """Move a body, from `enter`, for one step; see `ContactEngine.solve`."""
        client, (x, y, z) = self._client, self._middle
        with self._lock:
            self._awaken(body)
            if not is_continued:
                east, north, up, rw, rx, ry, rz = question[:7]
                pybullet.resetBasePositionAndOrientation(
                    body, (east - x, north - y, up - z), (rx, ry, rz, rw), physicsClientId=client
                )
            pybullet.resetBaseVelocity(body, question[7:10], question[10:13], physicsClientId=client)
            pybullet.stepSimulation(physicsClientId=client)
            contacts = pybullet.getContactPoints(body, self._cave, physicsClientId=client)
            if not any([contact[NORMAL_FORCE] > 0.0 for contact in contacts]):
                return None
            return self.motion(body)

    def motion(self, body: int) -> tuple[float, ...]:
        """Return where a body is and how it moves: 13 numbers, as in `ContactEngine.solve`."""
        place, (rx, ry, rz, rw) = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
        linear, angular = pybullet.getBaseVelocity(body, physicsClientId=self._client)
        x, y, z = self._middle
        return (place[0] + x, place[1] + y, place[2] + z, rw, rx, ry, rz, *linear, *angular)

    def _awaken(self, body: int) -> None:
        """Put the body that moved last to sleep, and wake this one."""
        if body == self._awake:
            return
        if self._awake != NO_BODY:
            pybullet.changeDynamics(self._awake, -1, activationState=SLEEP, physicsClientId=self._client)
        pybullet.changeDynamics(body, -1, activationState=STAY_AWAKE, physicsClientId=self._client)
        self._awake = body

    def _remove(self, body: int) -> None:
        pybullet.removeBody(body, physicsClientId=self._client)
        if body == self._awake:
            self._awake = NO_BODY


_arenas: weakref.WeakValueDictionary[tuple[int, float], _Arena] = weakref.WeakValueDictionary()
# A forked child makes its own: another thread of its parent may have been in the middle of a step.
os.register_at_fork(after_in_child=_arenas.clear)


def _arena_of(cave: Mesh, dt: float) -> _Arena:
    """Return the arena of a cave, made where there is none yet."""
    arena = _arenas.get((id(cave), dt))
    if arena is None:
        arena = _arenas[id(cave), dt] = _Arena(cave, dt)
    return arena


class BulletContacts:
    """What a cave's wall does to one vehicle, as `sim.batch.engine.ContactEngine` has it. Close it after use."""

    margin = CONTACT_MARGIN

    def __init__(self, scenario: Scenario, vehicle: Vehicle) -> None:
        """Put a vehicle's hull into a scenario's collision mesh."""
        arena = _arena_of(scenario.collision, scenario.settings.limits.dt)
        self._arena: _Arena | None = arena
        self._body = arena.enter(vehicle)
        self._leave = weakref.finalize(self, arena.leave, self._body)

    def reset(self) -> None:
        """Forget all contacts."""
        self._open_arena().forget(self._body)

    def solve(self, question: Sequence[float], is_continued: bool) -> tuple[float, ...] | None:
        """Move the vehicle for one step; return None, or where the wall lets it: see `ContactEngine`."""
        return self._open_arena().solve(self._body, question, is_continued)

    def close(self) -> None:
        """Leave the cave. Closing twice does nothing."""
        self._leave()
        self._arena = None

    def _open_arena(self) -> _Arena:
        if self._arena is None:
            raise InputError("This environment was closed. Make a new one to go on.")
        return self._arena


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
    pybullet.changeDynamics(
        body, -1, lateralFriction=FRICTION, restitution=0.0, activationState=REST, physicsClientId=client
    )
    pybullet.setCollisionFilterGroupMask(body, -1, CAVES, VEHICLES, physicsClientId=client)
    pybullet.stepSimulation(physicsClientId=client)  # a multibody falls asleep at the end of a step
    return body


def _load_vehicle(vehicle: Vehicle, client: int) -> int:
    """Return the id of a body with the capsule along x and isotropic total mass and inertia.

    Bullet would add gyroscopic moments to a body with unequal inertias; ours are integrated outside.
    """
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_CAPSULE,
        radius=vehicle.capsule.radius,
        height=vehicle.capsule.axis_length,
        collisionFrameOrientation=ALONG_X,
        physicsClientId=client,
    )
    mass = float(vehicle.total_mass[:3].mean())
    body = int(pybullet.createMultiBody(mass, shape, useMaximalCoordinates=1, physicsClientId=client))
    pybullet.changeDynamics(
        body,
        -1,
        mass=mass,  # Bullet takes no inertia without a mass
        linearDamping=0.0,
        angularDamping=0.0,
        lateralFriction=FRICTION,
        restitution=0.0,
        localInertiaDiagonal=[float(vehicle.total_mass[3:].mean())] * 3,
        activationState=SLEEP,
        physicsClientId=client,
    )
    return body
