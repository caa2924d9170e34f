"""Which walls light reaches from places that are known to be water, straight or thrown back by other walls.

A block of rock with a passage through it, as a mesh editor or a CSG program writes it, is closed all around: nothing in
it tells water from rock. But a lamp in the passage lights the passage only. What escapes through its mouths meets
nothing, and the outside of the block stays dark.
"""

from __future__ import annotations

import logging

import numpy as np

from aquanav_tools.cave.scan.orientation import MAX_SAMPLES, Caster, face_areas
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

MAX_DARK_SHARE = 0.2
"""Up to this share of dark wall is what every scan has: nooks, second layers, strays. They are told from wall later."""
MIN_LIT_SHARE = 0.1
"""A side of a wall is lit when it sees lit wall in this share of its directions; less leaks through cracks."""
LARGEST_SHARE = 0.1
"""The largest faces, this share of the samples, are always asked: six sides of a box beside a million small faces."""
NUM_LAMPS = 4
"""Lamps that a side is asked about; what lies in the shadow of these is lit by the walls that they light."""
NORMAL_SPACINGS = 4.0
"""A face turned away by a right angle is as unlike as one this many spacings of the asked faces away."""


def dark_faces(mesh: Mesh, lamps: Array, offset: float) -> BoolArray:
    """Return the (F,) flags of faces that no light from (N, 3) lamps reaches; none where few are dark or no lamp is.

    Args:
        mesh: any triangles.
        lamps: places in the water, m.
        offset: distance from a face at which its rays start, m; beyond its noise.
    """
    nothing = np.zeros(len(mesh.faces), dtype=bool)
    if not len(lamps):
        return nothing
    areas, normals = face_areas(mesh)
    is_dark = ~_lit_faces(mesh, areas, normals, lamps, offset)
    share = float(areas[is_dark].sum() / areas.sum())
    if share <= MAX_DARK_SHARE or is_dark.all():
        return nothing
    logger.info("Left out %.0f %% of the scan's area, which is not in view from the water", 100.0 * share)
    return is_dark


def _lit_faces(mesh: Mesh, areas: Array, normals: Array, lamps: Array, offset: float) -> BoolArray:
    """Return the (F,) flags of faces with a lit side."""
    asked = _choose_faces(areas)
    place = _most_alike(mesh.triangles.mean(axis=1), areas, normals, asked)
    caster = Caster(mesh)

    def sides_seen(starts: Array, axes: Array) -> IntArray:
        """Return the (N, R) sides of asked faces that rays meet: twice its place, plus one behind; -1 for none."""
        distance, struck = caster.cast(starts, axes)
        is_behind = np.einsum("nrk,nrk->nr", normals[struck], caster.directions(axes)) > 0.0
        seen: IntArray = np.where(np.isfinite(distance), 2 * place[struck] + is_behind, -1)
        return seen

    middles = mesh.triangles[asked].mean(axis=1)
    axes = np.stack([normals[asked], -normals[asked]], axis=1).reshape(-1, 3)
    starts = np.repeat(middles, 2, axis=0) + offset * axes
    is_lit = np.append(_sees_a_lamp(caster, starts, axes, lamps), False)  # the last is what rays into the open meet
    views = sides_seen(starts, axes)
    _spread(is_lit, views)
    return np.asarray(is_lit[:-1].reshape(-1, 2).any(axis=1))[place]


def _sees_a_lamp(caster: Caster, starts: Array, axes: Array, lamps: Array) -> BoolArray:
    """Return the (N,) flags of points with nothing between them and one of the lamps nearest to them, before them."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(lamps).query(starts, k=min(NUM_LAMPS, len(lamps)))
    is_lit = np.zeros(len(starts), dtype=bool)
    for column in nearest.reshape(len(starts), -1).T:
        ways = lamps[column] - starts
        is_lit |= (np.einsum("nk,nk->n", ways, axes) > 0.0) & caster.scene.is_clear(starts, ways)
    return is_lit


def _spread(is_lit: BoolArray, views: IntArray) -> None:
    """Light the sides that see enough of lit ones, in place, until no more are lit."""
    before = -1
    while (count := int(is_lit.sum())) > before:
        before = count
        is_lit[:-1] |= is_lit[views].mean(axis=1) >= MIN_LIT_SHARE


def _choose_faces(areas: Array) -> IntArray:
    """Return up to about MAX_SAMPLES faces: a regular share of all, and the largest."""
    if len(areas) <= MAX_SAMPLES:
        return np.arange(len(areas))
    largest = np.argpartition(-areas, round(LARGEST_SHARE * MAX_SAMPLES))[: round(LARGEST_SHARE * MAX_SAMPLES)]
    chosen: IntArray = np.union1d(largest, np.arange(0, len(areas), len(areas) // MAX_SAMPLES))
    return chosen


def _most_alike(middles: Array, areas: Array, normals: Array, asked: IntArray) -> IntArray:
    """Return the (F,) rank of the asked face that is near each face and faces the same way, its own where asked."""
    from scipy.spatial import cKDTree

    scale = NORMAL_SPACINGS * float(np.sqrt(areas.sum() / len(asked) / 2.0))
    features = np.concatenate([middles, scale * normals], axis=1)
    _, rank = cKDTree(features[asked]).query(features)
    rank[asked] = np.arange(len(asked))
    return np.asarray(rank, dtype=np.int64)
