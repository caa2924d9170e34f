"""Boats are data: a TOML file each, in the folder `boats` beside this module or anywhere else. Hulls are prisms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import (
    Six,
    Three,
    check_finite,
    check_inertia,
    check_not_negative,
    check_positive,
    rest_state,
)
from aquanav_tools.sim.windage import Windage
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.types import Array, IntArray, Mesh, Pose

BOAT_DIR = Path(__file__).parent / "boats"
PANEL = 0.35
"""Longest side of a hull's triangles over its length: waves of twice that follow the hull; chosen."""
DENSITY = 1025.0
"""Of seawater, kg/m^3."""
ORIGINAL_DRAUGHT = 0.59
"""How deep the original's boat is taken to lie, m: half of its hull's 1.18 m, since its water is not known."""
ROUNDING = 9
"""Digits behind the point at which coordinates are the same, m."""


class Skin(NamedTuple):
    """The surface of a boat's hulls in the body frame.

    Hulls are prisms, so that many vertices share a value along an axis: waves are looked up for these few values.
    """

    vertices: Array
    """(V, 3) sorted by x, then y, then z, m."""
    faces: IntArray
    """(F, 3) normals outwards."""
    ticks: Array
    """(T, 2) axis and value of the different coordinates, m."""
    numbers: IntArray
    """(V, 3) tick of each of a vertex's coordinates."""


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


NO_SKIN = Skin(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 3), dtype=np.int64))


@dataclass(frozen=True)
class Hull:
    """An upright prism with a pointed bow, or none."""

    length: float
    """m."""
    beam: float
    """m."""
    height: float
    """m."""
    bow: float = 0.0
    """Length over which it comes to a point ahead, m."""
    position: Three = (0.0, 0.0, 0.0)
    """Centroid of its outline and half its height, in the body frame, m: afloat alone it is level with x and y 0."""

    def __post_init__(self) -> None:
        check_positive("length, beam and height", self.length, self.beam, self.height)
        check_not_negative("bow", self.bow)
        check_finite("position", *self.position)
        if self.bow >= self.length:
            raise ValueError(f"bow must be shorter than the hull's {self.length:g} m, got {self.bow:g}.")

    @property
    def outline(self) -> Array:
        """(C, 2) from above, counter-clockwise, body frame, m."""
        x, y = 0.5 * self.length, 0.5 * self.beam
        corners = [[-x, -y], [x - self.bow, -y], [x, 0.0], [x - self.bow, y], [-x, y]]
        outline = np.array(corners if self.bow > 0.0 else corners[:2] + corners[3:])
        block, tip = 2.0 * x - self.bow, 0.5 * self.bow  # a bow has half the area of a block as long
        centroid = (block * (-0.5 * self.bow) + tip * (x - self.bow * 2.0 / 3.0)) / (block + tip)
        placed: Array = outline + self.position[:2] - np.array([centroid, 0.0])
        return placed

    @property
    def triangles(self) -> Mesh:
        """Its surface in triangles with sides of at most PANEL of its length, normals outwards, body frame."""
        import trimesh

        outline, count = self.outline, len(self.outline)
        low, high = (np.column_stack([outline, np.full(count, self.position[2] + z)]) for z in self._ends)
        whole = trimesh.convex.convex_hull(np.concatenate([low, high]))
        vertices, faces = trimesh.remesh.subdivide_to_size(whole.vertices, whole.faces, PANEL * self.length)
        return Mesh(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64))

    @property
    def _ends(self) -> tuple[float, float]:
        return -0.5 * self.height, 0.5 * self.height


@dataclass(frozen=True)
class Boat:
    """A rigid body on one hull or several, the body frame's origin in its centre of mass."""

    name: str
    mass: float
    """kg."""
    inertia: Three
    """kg m^2."""
    added_mass: Three
    """Of water that moves with it along body x, y, z, kg."""
    added_inertia: Three
    """kg m^2."""
    linear_damping: Six
    """By waves that it makes, against the velocity through the water, N s/m and N m s/rad."""
    normal_drag: float
    """Drag coefficient of a panel that is pushed into the water."""
    friction: float
    """Drag coefficient of a panel along the water."""
    surge_force: float
    """Full thrust ahead, N."""
    reverse_fraction: float
    """Full thrust in reverse, as a share of surge_force."""
    yaw_moment: float
    """Full steer, N m; it works without thrust."""
    hulls: tuple[Hull, ...]
    windage: Windage | None = None
    """What it shows to the wind; None leaves the wind out."""

    def __post_init__(self) -> None:
        for name in ("mass", "surge_force", "reverse_fraction", "yaw_moment"):
            check_positive(name, getattr(self, name))
        check_inertia("inertia", self.inertia)
        for name in ("added_mass", "added_inertia", "linear_damping"):
            check_not_negative(name, *getattr(self, name))
        check_not_negative("normal_drag", self.normal_drag)
        check_not_negative("friction", self.friction)
        if not self.hulls:
            raise ValueError("hulls must be at least one.")

    @cached_property
    def surface(self) -> Skin:
        """All hulls' triangles."""
        meshes = [hull.triangles for hull in self.hulls]
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=False)])
        vertices = np.concatenate([mesh.vertices for mesh in meshes]).round(ROUNDING)
        order = np.lexsort(vertices.T[::-1])
        ticks: list[Array] = []
        numbers: list[IntArray] = []
        for axis in range(3):
            values, number = np.unique(vertices[order, axis], return_inverse=True)
            numbers.append(number + sum(len(one) for one in ticks))
            ticks.append(np.column_stack([np.full(len(values), float(axis)), values]))
        return Skin(vertices[order], np.argsort(order)[faces], np.concatenate(ticks), np.stack(numbers, axis=1))

    @property
    def total_mass(self) -> Array:
        """(6,) what resists acceleration along and about body x, y, z: kg and kg m^2, with added mass."""
        return np.array([self.mass] * 3 + list(self.inertia)) + np.array([*self.added_mass, *self.added_inertia])

    @property
    def volume(self) -> float:
        """All that the hulls can displace, m^3."""
        from aquanav_tools.sea.outlines import outline_area

        return float(sum(outline_area(hull.outline) * hull.height for hull in self.hulls))

    def draught(self, density: float) -> float:
        """Return how deep the hulls' bottom lies when all are level and equally deep, m."""
        from aquanav_tools.sea.outlines import outline_area

        return self.mass / (density * sum(outline_area(hull.outline) for hull in self.hulls))

    def state_at(self, position: Array, yaw: float, density: float) -> Array:
        """Return the (13,) state afloat at rest on still water over a (2,) place, m, heading to `yaw`, rad."""
        bottom = self.hulls[0].position[2] - 0.5 * self.hulls[0].height
        height = -self.draught(density) - bottom
        orientation = np.array([np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)])
        return rest_state(Pose(np.array([*position, height]), orientation), 0)


def footprint_of(boat: Boat | OriginalVehicle) -> Footprint:
    """Return a boat's hull from above; the space between several hulls counts as boat."""
    if isinstance(boat, OriginalVehicle):
        half = 0.5 * boat.capsule.axis_length
        return Footprint(np.array([[-half, 0.0], [half, 0.0]]), boat.capsule.radius, -ORIGINAL_DRAUGHT)
    from scipy.spatial import ConvexHull

    corners = np.concatenate([hull.outline for hull in boat.hulls])
    bottom = min(hull.position[2] - 0.5 * hull.height for hull in boat.hulls)
    return Footprint(np.ascontiguousarray(corners[ConvexHull(corners).vertices]), 0.0, bottom)


def load_boat(name: str | Path) -> Boat:
    """Return a boat by its name, or from the TOML file at a path that ends in .toml.

    Raises:
        InputError: no such boat (with the closest name), or the file has an unknown, missing or senseless value.
    """
    path = boat_path(name)
    return from_table(Boat, read_toml(path), path.name)


def boat_path(name: str | Path) -> Path:
    """Return the file of a boat by its name; a path that ends in .toml is returned as it is.

    Raises:
        InputError: no boat of that name ships with aquanav; the message has the closest one.
    """
    path = Path(name) if Path(name).suffix == ".toml" else BOAT_DIR / f"{name}.toml"
    known = sorted(one.stem for one in BOAT_DIR.glob("*.toml"))
    if path.parent == BOAT_DIR and path.stem not in known:
        raise InputError(f"There is no boat '{name}'.{did_you_mean(str(name), known)}")
    return path
