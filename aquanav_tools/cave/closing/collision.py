"""The collision mesh: as few triangles as a bound on its error allows, proven on every face."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import Cavity, prove_closed
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.contact import Surface
from aquanav_tools.geometry.mesh.decimation import faces_near, merge_faces
from aquanav_tools.geometry.mesh.deviation import Deviation, measure_deviation
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.types import BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

TOLERANCE_SHARES = (0.7, 0.35, 0.15, 0.0)
"""Tolerances of the decimation tried, shares of the bound. Its errors add up to about twice its tolerance (measured);
the few places that stray beyond the bound at the first are protected."""
MAX_ROUNDS = 6
"""Times that faulty places are protected before a smaller tolerance is tried."""
NUM_PLACES = 200_000
"""Places where the error is measured, on either surface: one every 3 cm for 200 m^2 of wall."""
NUM_FARTHEST = 1000
"""Places whose side of the wall is found first."""
PROTECTED_SHARE = 2.0
"""Wall within this multiple of the bound of a faulty face is left as it is in the next round."""


@dataclass(frozen=True, eq=False)
class CollisionMesh:
    """The surface that vehicles collide with.

    Three distances say how true it is; none exceeds `bound`. By the first, no water farther than `bound` from the true
    wall has collision wall in it; by the third as well, no passage or niche wider than twice that is lost.
    """

    mesh: Mesh
    """Closed, one component, free of self-intersections, portals flat; coordinates are exact in 32-bit floats."""
    bound: float
    """What was asked for, m."""
    max_intrusion: float
    """How far the collision wall lies inside the true water at most, m."""
    max_invention: float
    """How far the collision wall lies inside the rock at most, so that free water is invented, m."""
    max_loss: float
    """How far the true wall is from the collision wall at most, m."""
    num_triangles_before: int
    """Triangles of the cavity."""

    @property
    def num_bytes(self) -> int:
        """Size as 32-bit floats and indices: what a simulator holds, without its search tree."""
        return 12 * (len(self.mesh.vertices) + len(self.mesh.faces))


def collision_mesh(cavity: Cavity, bound: float) -> CollisionMesh:
    """Return the cavity's surface with as few triangles as keep it within `bound` of the truth, both ways, m.

    The decimation is run and its result measured; where faces cross or stray too far, the wall is left as it is and
    the rest decimated anew.

    Raises:
        MeshError: the cavity crosses itself, or does so in 32-bit coordinates; the message says where.
    """
    for share in TOLERANCE_SHARES:
        is_protected = np.zeros(len(cavity.mesh.faces), dtype=np.bool_)
        for _ in range(MAX_ROUNDS):
            mesh = merge_faces(cavity.mesh, _labels(cavity, is_protected), share * bound)
            there = measure_deviation(mesh, cavity.surface, NUM_PLACES)
            back = measure_deviation(cavity.mesh, Surface(mesh), NUM_PLACES)
            crossing = self_intersections(mesh)
            if len(crossing) and not is_protected.any() and len(own := self_intersections(cavity.mesh)):
                raise _refusal(cavity.mesh, bound, np.unique(own))
            faulty = np.union1d(crossing, there.faces_beyond(bound))
            is_fault = faces_near(cavity.mesh, mesh, faulty, PROTECTED_SHARE * bound)
            is_fault[back.faces_beyond(bound)] = True
            if not is_fault.any():
                prove_closed(mesh)
                return _described(cavity, mesh, bound, there, back)
            logger.info("Decimated to %.2g m, %d faces of the wall are near faults", share * bound, is_fault.sum())
            if is_protected[is_fault].all():
                break
            is_protected |= is_fault
    raise _refusal(cavity.mesh, bound, np.flatnonzero(is_fault))


def _refusal(truth: Mesh, bound: float, faces: IntArray) -> MeshError:
    place = truth.triangles[faces[0]].mean(axis=0).round(2).tolist()
    return MeshError(
        f"No collision mesh within {bound:.3g} m of the cavity's {len(truth.faces)} triangles is free of faces that "
        f"cross: {len(faces)} cross or lie beside such places, one near {place} m. The wall folds over itself there. "
        "Repair the scan there, or rebuild with a larger voxel."
    )


def _described(cavity: Cavity, mesh: Mesh, bound: float, there: Deviation, back: Deviation) -> CollisionMesh:
    intrusion, invention = _largest_by_side(there, cavity.mesh)
    return CollisionMesh(mesh, bound, intrusion, invention, back.largest(), len(cavity.mesh.faces))


def _largest_by_side(there: Deviation, truth: Mesh) -> tuple[float, float]:
    """Return the largest distances of the places in the water and of those in the rock, m; 0 where there are none.

    The farthest places nearly always lie on both sides, so that the sides of all others need not be found.
    """
    import igl

    order = np.argsort(-there.distance, kind="stable")
    for places in (order[:NUM_FARTHEST], order):
        winding = igl.fast_winding_number(truth.vertices, truth.faces, there.points[places])
        is_in_water, distance = np.asarray(winding) > 0.5, there.distance[places]
        if is_in_water.any() and not is_in_water.all():
            break
    return float(distance[is_in_water].max(initial=0.0)), float(distance[~is_in_water].max(initial=0.0))


def _labels(cavity: Cavity, is_protected: BoolArray) -> IntArray:
    """Return the (F,) labels of what must not be merged: wall, portals, and each protected face."""
    labels = cavity.labels.copy()
    labels[is_protected] = labels.max() + 1 + np.arange(np.count_nonzero(is_protected))
    return labels
