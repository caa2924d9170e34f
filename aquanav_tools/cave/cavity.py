"""The cavity: the closed surface around the water, and the proof that it is closed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.contact import Surface
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

WALL = 0
"""Face label of rock; portal k has label k >= 1."""
MAX_PLACES = 20
"""Faulty places that an error lists."""


@dataclass(frozen=True, eq=False)
class Portal:
    """A flat lid over a place where the passage is open or was cut."""

    label: int
    """Face label of the lid, from 1."""
    centre: Array
    """(3,) world, m."""
    normal: Array
    """(3,) unit vector out of the water."""
    area: float
    """m^2."""


@dataclass(frozen=True, eq=False)
class Cavity:
    """The water volume: closed, 2-manifold, one component, normals out of the water."""

    mesh: Mesh
    labels: IntArray
    """(F,) WALL or the label of a portal, per face."""
    observed: BoolArray
    """(F,) whether the scan saw this piece of wall, per face."""
    portals: tuple[Portal, ...]

    @property
    def walls(self) -> Mesh:
        """The rock alone, without the lids of portals."""
        return Mesh(self.mesh.vertices, np.ascontiguousarray(self.mesh.faces[self.labels == WALL]))

    @cached_property
    def surface(self) -> Surface:
        """Exact distances from the rock and the lids."""
        return Surface(self.mesh)

    @cached_property
    def wall_surface(self) -> Surface:
        """Exact distances from the rock alone."""
        return Surface(self.walls)

    @property
    def volume(self) -> float:
        """Enclosed water, m^3."""
        return self.mesh.volume

    @property
    def observed_share(self) -> float:
        """Share of the wall's area that the scan saw, in [0, 1]; portals do not count."""
        areas, wall = self.mesh.areas, self.labels == WALL
        return float(areas[wall & self.observed].sum() / max(areas[wall].sum(), 1e-12))


def to_manifold(mesh: Mesh):  # type: ignore[no-untyped-def]  # manifold3d ships no types
    """Return the manifold3d solid of a closed mesh.

    Raises:
        MeshError: manifold3d refuses the mesh or finds it empty; the message carries its status.
    """
    import manifold3d

    solid = manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(mesh.vertices, dtype=np.float64),
            tri_verts=np.ascontiguousarray(mesh.faces, dtype=np.uint64),
        )
    )
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        raise MeshError(
            f"The surface of {len(mesh.faces)} triangles is not a closed solid (manifold3d: {solid.status()}). "
            "Faces cross or an edge has other than two faces. Repair the scan there, or rebuild with a larger voxel."
        )
    return solid


def from_manifold(solid) -> Mesh:  # type: ignore[no-untyped-def]  # manifold3d ships no types
    """Return the triangles of a manifold3d solid."""
    mesh = solid.to_mesh64()
    return Mesh(np.array(mesh.vert_properties[:, :3]), np.array(mesh.tri_verts, dtype=np.int64))


def prove_watertight(mesh: Mesh) -> None:
    """Check all that is promised of a cavity's surface.

    Raises:
        MeshError: naming the first promise that is broken: those of `prove_closed`, and no faces that cross.
    """
    prove_closed(mesh)
    crossing = self_intersections(mesh)
    if len(crossing):
        middles = mesh.triangles[crossing[:, 0]].mean(axis=1)
        raise MeshError(
            f"{len(crossing)} pairs of faces of the closed surface cross each other, the first at "
            f"{middles[0].round(2)} m. Rebuild with a larger voxel.",
            [((float(x), float(y), float(z)), "faces cross") for x, y, z in middles[:MAX_PLACES]],
        )


def prove_closed(mesh: Mesh) -> None:
    """Check all that is promised of a cavity's surface, but that no faces cross.

    Raises:
        MeshError: naming the first promise that is broken: accepted by manifold3d, watertight volume by trimesh's
            `is_volume`, one component, positive volume.
    """
    to_manifold(mesh)
    if not mesh.volume > 0.0:
        raise MeshError(
            f"The closed surface of {len(mesh.faces)} triangles encloses {mesh.volume:.3g} m3. It is flat or inside "
            "out. Scan the walls on all sides of the passage."
        )
    solid = mesh.to_trimesh()
    num_components = solid.body_count
    if num_components != 1:
        raise MeshError(
            f"The closed surface has {num_components} separate components instead of one. Stray pieces of the scan "
            "enclose space of their own. Remove them, or rebuild with a larger voxel."
        )
    if not solid.is_volume:
        raise MeshError(
            f"The closed surface of {len(mesh.faces)} triangles is not a consistent volume (trimesh is_volume: "
            f"watertight {solid.is_watertight}, winding {solid.is_winding_consistent}, volume {solid.volume:.3g} m3). "
            "Rebuild with a larger voxel."
        )
