"""Which side of a scanned wall is water: the side from which more wall is in view.

Windings of triangles and normals of points cannot be trusted: programs write them either way round, some parts this way
and some that. But a cave surrounds its water. From just before a wall nearly every ray hits some other wall; from just
behind it most rays leave into the open. Where both sides are closed in, as between two sheets of the same wall or in
the thickness of a shell, the water is on the roomier side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from aquanav_tools.geometry.mesh.patches import Patches
from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

NUM_RAYS = 24
"""Rays per side; a share of hits is then known to about 0.1."""
MAX_SAMPLES = 20_000
"""Faces that are asked, spread over the patches; neighbours agree."""
MIN_AGREEMENT = 0.6
"""A patch is turned as one when its votes agree by at least this margin; otherwise every face is turned by its own."""
MIN_ENCLOSED = 0.3
"""... provided that its faces see this share of wall around them; votes about open space mean little."""
HIDDEN_SHARE = 0.6
"""A face whose rays into its water hit this share of other walls from behind lies hidden behind them."""


@dataclass(frozen=True, eq=False)
class FacingSurface:
    """A surface whose normals point out of the water."""

    mesh: Mesh
    faces: IntArray
    """(F,) which of the given faces were kept."""
    turned_share: float
    """Share of the area that was wound the other way."""
    hidden_share: float
    """Share of the area that was left out because it lies behind other wall."""


def orient_outward(patches: Patches, offset: float, *, drop_hidden: bool = True) -> FacingSurface:
    """Return the patches wound with their normals out of the water, without walls hidden behind other walls.

    Args:
        patches: any triangles.
        offset: distance from a face at which its rays start, m; beyond its noise.
        drop_hidden: leave out hidden walls.
    """
    mesh = patches.mesh
    areas, normals = face_areas(mesh)
    asked = _choose_faces(patches.ids, areas)
    caster = Caster(mesh)
    votes = _side_votes(caster, mesh.triangles[asked].mean(axis=1), normals[asked], offset)
    is_turned = _turns(patches, areas, asked, votes)
    turned = Mesh(mesh.vertices, np.where(is_turned[:, None], mesh.faces[:, ::-1], mesh.faces))
    hidden = np.zeros(len(areas), dtype=bool)
    if drop_hidden:
        turned_normals = np.where(is_turned[:, None], -normals, normals)
        hidden = _hidden_faces(caster, turned, turned_normals, patches, areas, asked, offset)
    total = max(float(areas.sum()), 1e-15)
    return FacingSurface(
        Mesh(turned.vertices, turned.faces[~hidden]),
        np.flatnonzero(~hidden),
        float(areas[is_turned].sum()) / total,
        float(areas[hidden].sum()) / total,
    )


def face_areas(mesh: Mesh) -> tuple[Array, Array]:
    """Return the (F,) areas, m^2, and (F, 3) unit normals of a mesh's faces."""
    areas, normals = np.empty(len(mesh.faces)), np.empty((len(mesh.faces), 3))
    _measure_faces(mesh.vertices, mesh.faces, areas, normals)
    return areas, normals


@numba.njit(cache=True, parallel=True)
def _measure_faces(vertices, faces, areas, normals):  # type: ignore[no-untyped-def]
    """Fill the areas and unit normals of faces; a face without an area has next to no normal."""
    for n in numba.prange(len(faces)):
        a, b, c = faces[n]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        doubled = np.sqrt(x * x + y * y + z * z)
        areas[n] = 0.5 * doubled
        size = max(doubled, 1e-15)
        normals[n, 0], normals[n, 1], normals[n, 2] = x / size, y / size, z / size


def is_gap(mesh: Mesh, faces: IntArray, width: float, offset: float) -> BoolArray:
    """Return for each of some faces whether what lies before it is no water: a gap behind other wall.

    Scanners leave second layers of a wall behind or before the first, and flat bubbles between them.

    Args:
        mesh: normals out of the water.
        faces: (K,) which faces to ask.
        width: the space before a face is a gap when rays into it end within this distance on average, m.
        offset: distance from a face at which its rays start, m.
    """
    _, normals = face_areas(mesh)
    caster = Caster(mesh)
    starts = mesh.triangles[faces].mean(axis=1) - offset * normals[faces]
    distance, struck = caster.cast(starts, -normals[faces])
    is_hit = np.isfinite(distance)
    reach = np.where(is_hit, distance, 0.0).sum(axis=1) / np.maximum(is_hit.sum(axis=1), 1)
    from_behind = is_hit & (np.einsum("frk,frk->fr", normals[struck], caster.directions(-normals[faces])) < 0.0)
    is_behind = from_behind.sum(axis=1) > HIDDEN_SHARE * np.maximum(is_hit.sum(axis=1), 1)
    narrow: BoolArray = is_behind | (reach < width)
    return narrow


def _choose_faces(ids: IntArray, areas: Array) -> IntArray:
    """Return up to about MAX_SAMPLES faces: the largest of every patch, and a regular share of all."""
    if len(ids) <= MAX_SAMPLES:
        return np.arange(len(ids))
    by_patch = np.lexsort((-areas, ids))
    largest = by_patch[np.unique(ids[by_patch], return_index=True)[1]]
    spread = np.arange(0, len(ids), len(ids) // MAX_SAMPLES)
    chosen: IntArray = np.unique(np.concatenate([largest, spread]))
    return chosen


def _side_votes(caster: Caster, middles: Array, normals: Array, offset: float) -> Array:
    """Return one vote in [-1, 1] per face: positive when the water is behind its normal, as it should be."""
    scores, shares = [], []
    for side in (-1.0, 1.0):
        distance, _ = caster.cast(middles + side * offset * normals, side * normals)
        is_hit = np.isfinite(distance)
        reach = np.where(is_hit, distance, 0.0).sum(axis=1) / np.maximum(is_hit.sum(axis=1), 1)
        # Ambient occlusion decides; between two enclosed sides the roomier one does.
        shares.append(is_hit.mean(axis=1))
        scores.append(shares[-1] ** 2 * np.sqrt(reach))
    certainty = np.maximum(*shares)
    votes: Array = certainty * (scores[0] - scores[1]) / np.maximum(scores[0] + scores[1], 1e-12)
    return votes


def _turns(patches: Patches, areas: Array, asked: IntArray, votes: Array) -> BoolArray:
    """Return the (F,) flags of faces to turn over."""
    ids = patches.ids[asked]
    weights = areas[asked]
    for_it = np.bincount(ids, weights * votes, minlength=patches.count)
    against_none = np.bincount(ids, weights * np.abs(votes), minlength=patches.count)
    total = np.bincount(ids, weights, minlength=patches.count)
    is_torn = (np.abs(for_it) < MIN_AGREEMENT * against_none) & (against_none > MIN_ENCLOSED * total)
    is_turned: BoolArray = (for_it < 0.0)[patches.ids]
    torn_faces = np.flatnonzero(is_torn[patches.ids])
    if len(torn_faces):
        is_turned[torn_faces] = _nearest_value(patches.mesh, torn_faces, asked, votes) < 0.0
    return is_turned


def _hidden_faces(
    caster: Caster, mesh: Mesh, normals: Array, patches: Patches, areas: Array, asked: IntArray, offset: float
) -> BoolArray:
    """Return the (F,) flags of faces from whose water most other walls are seen from behind."""
    starts = mesh.triangles[asked].mean(axis=1) - offset * normals[asked]
    distance, struck = caster.cast(starts, -normals[asked])
    is_hit = np.isfinite(distance)
    from_behind = is_hit & (np.einsum("frk,frk->fr", normals[struck], caster.directions(-normals[asked])) < 0.0)
    behind = from_behind.sum(axis=1) / np.maximum(is_hit.sum(axis=1), 1)
    ids = patches.ids[asked]
    weights = areas[asked]
    hidden = np.bincount(ids, weights * (behind > HIDDEN_SHARE), minlength=patches.count)
    share = hidden / np.maximum(np.bincount(ids, weights, minlength=patches.count), 1e-15)
    is_hidden: BoolArray = (share >= HIDDEN_SHARE)[patches.ids]
    mixed_faces = np.flatnonzero(((share > 1.0 - MIN_AGREEMENT) & (share < HIDDEN_SHARE))[patches.ids])
    if len(mixed_faces):
        is_hidden[mixed_faces] = _nearest_value(mesh, mixed_faces, asked, behind) > HIDDEN_SHARE
    return is_hidden


def _nearest_value(mesh: Mesh, faces: IntArray, asked: IntArray, values: Array) -> Array:
    """Return for each face the value of the asked face nearest to it, its own where it was asked."""
    from scipy.spatial import cKDTree

    middles = mesh.triangles.mean(axis=1)
    _, nearest = cKDTree(middles[asked]).query(middles[faces])
    found: Array = values[nearest]
    return found


class Caster:
    """Casts fans of rays against a mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self.scene = RayScene(mesh)

    def directions(self, axes: Array) -> Array:
        """Return (N, NUM_RAYS, 3) unit vectors within 75 degrees of (N, 3) unit axes, spread evenly."""
        helper = np.where(np.abs(axes[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        side = np.cross(axes, helper)
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        up = np.cross(axes, side)
        index = np.arange(NUM_RAYS) + 0.5
        along = 1.0 - (1.0 - np.cos(np.deg2rad(75.0))) * index / NUM_RAYS
        across = np.sqrt(1.0 - along**2)
        angle = np.pi * (1.0 + np.sqrt(5.0)) * index
        rays: Array = (
            along[:, None] * axes[:, None]
            + (across * np.cos(angle))[:, None] * side[:, None]
            + (across * np.sin(angle))[:, None] * up[:, None]
        )
        return rays

    def cast(self, starts: Array, axes: Array) -> tuple[Array, IntArray]:
        """Return the (N, NUM_RAYS) distances, inf where nothing is hit, and the faces hit (0 where none)."""
        met = self.scene.hits(np.repeat(starts, NUM_RAYS, axis=0), self.directions(axes).reshape(-1, 3))
        return met.lengths.reshape(-1, NUM_RAYS), np.maximum(met.faces, 0).reshape(-1, NUM_RAYS)
