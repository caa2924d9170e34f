"""Pieces of wall that nobody saw, and from where to look at each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, IntArray

MIN_AREA = 0.05
"""Smaller pieces are not worth a photo, m^2; chosen: a square of 22 cm."""
PIECE_REACH = 2.0
"""A patch that reaches farther than this from its middle is cut up, m: one view shows no more of it at TO_WALL."""
TURN_METRES = 1.0
"""Wall that faces another way counts as this much farther off per unit of difference of normals, m."""
TO_WALL = 1.5
"""Distance that photos of rock are best taken from, m: two are half as sharp, one shows a quarter of the area."""
STEP = 0.05
FARTHEST = 3.0
"""Places up to this far before the wall are tried, m."""
ROOM = 0.4
"""Clearance that a diver or a vehicle needs at that place, m."""


@dataclass(frozen=True, eq=False)
class UnseenPatch:
    """Wall that hangs together, was not seen, and fits one view."""

    faces: IntArray
    """(K,) of the cavity."""
    centre: Array
    """(3,) place on the wall in its middle, m."""
    area: float
    """m^2."""
    outward: Array
    """(3,) unit vector out of the water."""
    stand: Array
    """(3,) place in the water to look from, m."""
    clearance: float
    """There, m; below ROOM where the passage is nowhere wider before the patch."""

    @property
    def ahead(self) -> Array:
        """(3,) unit vector to look along."""
        way = self.centre - self.stand
        ahead: Array = way / max(float(np.linalg.norm(way)), 1e-12)
        return ahead


def unseen_patches(cavity: Cavity, field: DistanceField) -> tuple[UnseenPatch, ...]:
    """Return the unseen wall in patches of at least MIN_AREA, the largest first."""
    is_unseen = (cavity.labels == WALL) & ~cavity.observed
    faces = np.flatnonzero(is_unseen)
    if not len(faces):
        return ()
    areas, normals = cavity.mesh.areas, cavity.mesh.normals
    middles = cavity.mesh.triangles.mean(axis=1)
    pieces = [
        piece
        for whole in _connected(cavity.mesh.faces, faces)
        if areas[whole].sum() >= MIN_AREA
        for piece in _cut(whole, middles, normals)
    ]
    patches = [_patch(piece, areas, normals, middles, field) for piece in pieces if areas[piece].sum() >= MIN_AREA]
    return tuple(sorted(patches, key=lambda patch: -patch.area))


def _connected(corners: IntArray, faces: IntArray) -> list[IntArray]:
    """Return sets of some faces that hang together by edges; (F, 3) corners of all faces."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(corners[faces][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    count, rows = len(faces), np.repeat(np.arange(len(faces)), 3)
    by_edge = coo_matrix((np.ones(len(rows)), (rows, edge.ravel())), shape=(count, int(edge.max()) + 1)).tocsr()
    number, labels = connected_components(by_edge @ by_edge.T, directed=False)
    order = np.argsort(labels, kind="stable")
    return np.split(faces[order], np.searchsorted(labels[order], np.arange(1, number)))


def _cut(whole: IntArray, middles: Array, normals: Array) -> list[IntArray]:
    """Return connected faces in pieces that fit one view: none farther than PIECE_REACH from its own seed."""
    from scipy.cluster.vq import kmeans2

    places = np.hstack([middles[whole], TURN_METRES * normals[whole]])
    seeds = [int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))]
    reach = np.linalg.norm(places - places[seeds[0]], axis=1)
    while reach.max() > PIECE_REACH:
        seeds.append(int(np.argmax(reach)))
        reach = np.minimum(reach, np.linalg.norm(places - places[seeds[-1]], axis=1))
    if len(seeds) == 1:
        return [whole]
    _, labels = kmeans2(places, places[seeds], minit="matrix", iter=5)
    return [whole[labels == label] for label in np.unique(labels)]


def _patch(piece: IntArray, areas: Array, normals: Array, middles: Array, field: DistanceField) -> UnseenPatch:
    weights = areas[piece] / areas[piece].sum()
    nearest = int(np.argmin(np.linalg.norm(middles[piece] - weights @ middles[piece], axis=1)))
    outward = weights @ normals[piece]
    if np.linalg.norm(outward) < 0.3:  # it surrounds a place: take the side that its middle is on
        outward = normals[piece[nearest]]
    outward = outward / np.linalg.norm(outward)
    centre = middles[piece[nearest]]
    stand, clearance = _stand(centre, -outward, field)
    return UnseenPatch(piece, centre, float(areas[piece].sum()), outward, stand, clearance)


def _stand(wall: Array, inward: Array, field: DistanceField) -> tuple[Array, float]:
    """Return the place before the wall nearest to TO_WALL that has ROOM, else the roomiest, and its clearance, m."""
    distances = np.arange(STEP, FARTHEST + 0.5 * STEP, STEP)
    places = wall + distances[:, None] * inward
    clearances = field.clearance(places)
    water = np.flatnonzero(clearances > 0.0)
    if len(water):  # no farther than where the next wall begins
        rock = np.flatnonzero(clearances[water[0] :] <= 0.0)
        clearances[water[0] + rock[0] if len(rock) else len(distances) :] = -np.inf
    roomy = np.flatnonzero(clearances >= ROOM)
    chosen = roomy[np.argmin(np.abs(distances[roomy] - TO_WALL))] if len(roomy) else np.argmax(clearances)
    return places[chosen], float(clearances[chosen])
