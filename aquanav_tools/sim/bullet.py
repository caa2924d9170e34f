"""One vehicle in one cave: our own motion, PyBullet's contacts. The only module that imports pybullet.

Bullet knows neither added mass nor Coriolis forces in water, and feeding added mass back as a force diverges. So our
integrator moves the vehicle, and Bullet is asked only what the wall does to that motion: it gets the mean velocity of
our step, which in free water takes it exactly to our pose, and where a wall is in the way its pose and its change of
velocity are taken over. Where the distance field says that the hull cannot touch, Bullet is not asked at all.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from aquanav_tools.cave.water.field import DistanceField
from aquanav_tools.errors import ResourceError
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


class BulletWorld:
    """A cave with one vehicle in a Bullet client of its own. Close it after use."""

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
        # Bullet reads float32 coordinates from the file, so it works near the cave's middle.
        self._middle = scenario.collision.vertices.mean(axis=0)
        self._client = _connect(self._dt)
        try:
            self._cave = _load_cave(scenario.collision, self._middle, self._client)
            self._body = _load_vehicle(vehicle, self._client)
            self._pristine = pybullet.saveState(physicsClientId=self._client)
        except pybullet.error:
            self.close()
            raise
        self._is_body_placed = False

    def reset(self, pose: Pose) -> None:
        """Put the vehicle at rest at a pose and forget all contacts."""
        self.state[:] = self._vehicle.state_at(pose)
        pybullet.restoreState(stateId=self._pristine, physicsClientId=self._client)
        self._is_body_placed = False

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
        """Free the client. Closing twice does nothing."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1

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
        if last > first:
            self._is_body_placed = False
        return int(last)

    def _step_beside_wall(self) -> bool:
        """Take the step to _free with Bullet watching the wall; return whether there was contact."""
        intended = mean_velocity(self.state, self._free, self._dt)
        self._place_body()
        client, body = self._client, self._body
        velocity = intended.tolist()
        pybullet.resetBaseVelocity(body, velocity[:3], velocity[3:], physicsClientId=client)
        pybullet.stepSimulation(physicsClientId=client)
        contacts = pybullet.getContactPoints(body, self._cave, physicsClientId=client)
        if not any([contact[NORMAL_FORCE] > 0.0 for contact in contacts]):
            self.state[:] = self._free
            return False
        last_pose = self.state[:7].copy()
        take_over_contact(self._free, intended, self._solved_motion(), self._mass, self.state)
        if self._field.clearance_at(self.state[:3]) < 0.0:
            # It tunnelled through, or was pressed through, the thin shell: back to the last place in the water.
            self.state[:7], self.state[7:13] = last_pose, 0.0
            self._is_body_placed = False
        return True

    def _place_body(self) -> None:
        """Tell Bullet where the vehicle is, unless its last step left it there."""
        if self._is_body_placed:
            return
        w, x, y, z = self.state[3:7].tolist()
        position = (self.state[:3] - self._middle).tolist()
        pybullet.resetBasePositionAndOrientation(self._body, position, (x, y, z, w), physicsClientId=self._client)
        self._is_body_placed = True

    def _solved_motion(self) -> Array:
        """Return Bullet's (13,) position, quaternion (x, y, z, w), linear and angular velocity, in the world."""
        position, orientation = pybullet.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        linear, angular = pybullet.getBaseVelocity(self._body, physicsClientId=self._client)
        solved = np.array((*position, *orientation, *linear, *angular))
        solved[:3] += self._middle
        return solved


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
    # File caching would share meshes of the same name between environments.
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
    body = int(pybullet.createMultiBody(float(vehicle.total_mass[:3].mean()), shape, physicsClientId=client))
    pybullet.changeDynamics(
        body,
        -1,
        linearDamping=0.0,
        angularDamping=0.0,
        lateralFriction=FRICTION,
        restitution=0.0,
        localInertiaDiagonal=[float(vehicle.total_mass[3:].mean())] * 3,
        physicsClientId=client,
    )
    return body
