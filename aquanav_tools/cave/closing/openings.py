"""Openings: the patches of a closed surface that nobody scanned, and which of them are open ends of the passage.

A patch is either a hole in the wall, which stays filled, or the open end of a passage, which becomes a portal. It is an
end when the vehicle could pass through it and when no passage goes by behind it. Just inside an end, the view sideways
meets scanned wall about where the patch's rim is; just inside a hole in the side of a passage or chamber, water goes on
beyond the patch to two opposite sides. Where the passage winds no view tells: there water is followed (`front.py`).
Cameras tell more: through an end they look into the dark.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.cave.closing.front import Front, front_behind
from aquanav_tools.cave.closing.solid import ClosedSurface
from aquanav_tools.cave.scan.sight import NO_WALL, Sight
from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

MAX_REACH = 1.4
"""Just inside an open end, water reaches at most this many times as far as the patch does, to one of any two opposite
sides. Measured on about 130 damaged caves (500 openings): ends up to 1.25, most below 1.13; holes up to 2.4 m wide 1.65
and more. Where half of the floor is missing up to an end, both come nearer: 1.27 and 1.58."""
MAX_REACH_IN_VAIN = 1.6
"""The same where cameras looked into a patch and saw no wall: then a ragged or swollen rim does not make it a hole."""
MIN_SHARE_IN_VAIN = 0.8
"""They did on at least this share of its area. Measured on the demo's photos: both ends 1.0, floor in the shadow of
boulders 0.03 to 0.5."""
MIN_CAMERAS_IN_VAIN = 3
"""... that many of them."""
NUM_SAMPLES_IN_VAIN = 200
BEFORE_PATCH = 0.98
"""Rays from a camera end at this share of the way to a patch: it is no obstacle to itself."""
MAX_SLENDER = 3.0
"""A patch more than this many times as long as wide lies along the passage, not across it, ..."""
MAX_SHALLOW = 3.0
"""... where it is also this many times as long as the water before it is deep: it is unseen floor, wall or ceiling."""
INWARD_TILTS = np.deg2rad([0.0, -45.0, 45.0])
"""How deep the water is, is asked straight inwards and, behind a flat patch, so far towards its far sides, and measured
straight inwards: a low passage may turn aside right behind its end. Over a floor it is as deep by all of them."""
MIN_FLAT_SHARE = 0.95
"""A patch that faces one way with this share of its area is flat; one that runs from a floor up an end is not."""
VIEW_DEPTH = 0.25
"""The view sideways is taken this many diameters inside the rim."""
START_OFFSET = 1e-3
"""Rays into the water start this share of a patch's length before it."""
NUM_SIDES = 72
VIEW_TILTS = np.deg2rad([-15.0, 0.0, 15.0])
"""Of three rays to each side the middle one counts: a single boulder or crack decides nothing."""
FLAT_RIM_DEPTH = 0.25
"""A patch whose rim reaches at most this many diameters into the passage is one flat opening, however ragged."""
AT_END_RADII = 1.5
"""What was invented this many radii around an end's middle belongs to it; chosen."""
LOOKS = np.array([[0.36, 0.48, 0.8], [-0.8, 0.36, 0.48], [0.48, -0.8, 0.36]])
"""(3, 3) directions, along no axis, in which a place looks to know whether it lies in the water."""
NUM_DIRECTIONS = 64
"""Normals of a patch that are tried as its main direction."""
MIN_AGREEMENT = float(np.cos(np.deg2rad(50.0)))
"""Faces of one opening face its main direction within 50 degrees."""
MAX_RIM_DEPTH = 0.5
"""The rim of an open end reaches at most this many diameters into the passage; more, and no flat cut would do."""


@dataclass(frozen=True, eq=False)
class Opening:
    """Invented surface across a hole in the wall or the end of a passage."""

    centre: Array
    """(3,) m."""
    normal: Array
    """(3,) unit vector out of the water."""
    area: float
    """Of its faces projected along the normal, m^2."""
    radius: float
    """Distance from the centre to the farthest vertex, m."""
    innermost: float
    """How far its rim reaches into the water, against the normal, m; not positive."""
    outermost: float
    """How far it bulges out of the plane through its centre, along the normal, m."""
    faces: IntArray
    """(N,) of the closed mesh."""
    patch: IntArray
    """(K,) all that was invented in one piece with them, whichever way it faces."""
    is_portal: bool = False
    """Whether it is the open end of a passage, not a hole in a wall."""

    @property
    def diameter(self) -> float:
        """Of the circle with the same area, m."""
        return float(np.sqrt(4.0 * self.area / np.pi))


def find_openings(closed: ClosedSurface, min_diameter: float, sight: Sight | None = None) -> tuple[Opening, ...]:
    """Return the patches of invented surface, largest first.

    Args:
        closed: the solid.
        min_diameter: smaller ones are left out, m.
        sight: what cameras saw, of scans from photos.
    """
    view = _View(closed, sight)
    openings = []
    for patch in _unobserved_patches(closed):
        whole = _measure(closed.mesh, patch, patch)
        if whole.diameter < min_diameter:
            continue
        if -whole.innermost <= FLAT_RIM_DEPTH * whole.diameter and view.ends_at(whole):
            openings.append(replace(whole, is_portal=True))
            continue
        for part in _split_by_direction(closed.mesh, patch):
            opening = _measure(closed.mesh, part, patch)
            if opening.diameter >= min_diameter:
                openings.append(replace(opening, is_portal=view.ends_at(opening, whole)))
    return _without_overlaps(sorted(openings, key=lambda opening: -opening.area))


def _without_overlaps(openings: list[Opening]) -> tuple[Opening, ...]:
    """Return openings, given largest first, without portals whose middle lies in a larger one: one end, one portal."""
    kept: list[Opening] = []
    for opening in openings:
        larger = [other for other in kept if other.is_portal]
        is_part = any(np.linalg.norm(opening.centre - other.centre) < other.radius for other in larger)
        kept.append(replace(opening, is_portal=opening.is_portal and not is_part))
    return tuple(kept)


def holes_in_wall(openings: tuple[Opening, ...], mesh: Mesh) -> Mesh:
    """Return the faces of a closed mesh that were invented across holes in the wall, and not at an end.

    A ceiling that nobody saw is often in one piece with what was invented across an end.
    """
    is_hole = np.zeros(len(mesh.faces), dtype=np.bool_)
    for opening in openings:
        is_hole[opening.patch] = True
    middles = mesh.triangles.mean(axis=1)
    for opening in openings:
        if opening.is_portal:
            away = np.linalg.norm(middles[opening.patch] - opening.centre, axis=1)
            is_hole[opening.patch[away < AT_END_RADII * opening.radius]] = False
    return Mesh(mesh.vertices, mesh.faces[is_hole])


class _View:
    """Looks around in the closed water."""

    def __init__(self, closed: ClosedSurface, sight: Sight | None = None) -> None:
        self._closed, self._sight = closed, sight
        self._scene = RayScene(closed.mesh)

    def ends_at(self, opening: Opening, whole: Opening | None = None) -> bool:
        """Return whether the passage ends at an opening, and none goes by behind it, or behind the whole it is part of.

        Fronts are looked at as far off as the opening is long: behind a strip of roof they have met the floor by then.
        """
        if -opening.innermost > MAX_RIM_DEPTH * opening.diameter or self._is_along(opening, opening.faces):
            return False
        reach = self.reach(opening, opening.faces)
        if reach > MAX_REACH_IN_VAIN:
            return False
        if reach > MAX_REACH and self.share_in_vain(opening.faces) < MIN_SHARE_IN_VAIN:
            return False
        front = self._front(opening, 2.0 * opening.radius)
        if whole is None or front.passes or not self._front(whole, 2.0 * whole.radius).passes:
            return not front.passes
        return not (front.is_sideways or self._front(opening, 2.0 * whole.radius).is_sideways)

    def _front(self, opening: Opening, distance: float) -> Front:
        corners = self._closed.mesh.triangles[opening.faces]
        return front_behind(corners, opening.centre, opening.normal, opening.area, distance, self._are_in_water)

    def _are_in_water(self, places: Array) -> BoolArray:
        """Return the (N,) flags of (N, 3) places from which most of three rays meet the wall's inner side first."""
        normals, votes = self._closed.mesh.normals, np.zeros(len(places), dtype=np.int64)
        for way in LOOKS:
            faces = self._scene.faces(places, np.tile(way, (len(places), 1)))
            votes += (faces >= 0) & (normals[faces] @ way > 0.0)
        return np.asarray(votes >= 2)

    def _is_along(self, opening: Opening, patch: IntArray) -> bool:
        """Return whether a patch lies along the passage: much longer than wide, and than the water before it is deep.

        Along such a patch both of the view's opposite sides are its own, so that it would pass for an end.
        """
        part = Mesh(self._closed.mesh.vertices, self._closed.mesh.faces[patch])
        middles = part.triangles.mean(axis=1)
        axes = plane_axes(opening.normal)
        variances, directions = _spread(part.triangles @ axes.T, part.areas)
        length = np.sqrt(12.0 * variances[1])  # as a rectangle
        width = opening.area / length  # across, also of a patch that winds
        if length <= MAX_SLENDER * width:
            return False
        starts = middles - START_OFFSET * length * opening.normal
        along = directions[:, 1] @ axes
        tilts = INWARD_TILTS if opening.area > MIN_FLAT_SHARE * part.areas.sum() else INWARD_TILTS[:1]
        ways = np.cos(tilts)[:, None] * -opening.normal + np.sin(tilts)[:, None] * along
        distances = np.array([self._scene.lengths(starts, np.broadcast_to(way, starts.shape)) for way in ways])
        depths = (distances * -(ways @ opening.normal)[:, None]).max(axis=0)
        return bool(length > MAX_SHALLOW * float(np.median(depths)))

    def share_in_vain(self, patch: IntArray) -> float:
        """Return the share of a patch's area into which several cameras looked without seeing wall; 0 without any."""
        if self._sight is None:
            return 0.0
        part = Mesh(self._closed.mesh.vertices, self._closed.mesh.faces[patch])
        every = np.cumsum(part.areas)
        asked = np.searchsorted(every, every[-1] * (np.arange(NUM_SAMPLES_IN_VAIN) + 0.5) / NUM_SAMPLES_IN_VAIN)
        points = part.triangles[asked].mean(axis=1)
        in_vain = self._sight.look(points)[1] == NO_WALL
        for camera, centre in enumerate(self._sight.centres):
            asked = np.flatnonzero(in_vain[:, camera])
            ways = BEFORE_PATCH * (points[asked] - centre)
            in_vain[asked, camera] = self._scene.is_clear(centre, ways)
        return float((in_vain.sum(axis=1) >= MIN_CAMERAS_IN_VAIN).mean())

    def reach(self, opening: Opening, patch: IntArray) -> float:
        """Return how many times as far as a patch the water behind it reaches to both of two opposite sides."""
        angle = np.linspace(0.0, 2.0 * np.pi, NUM_SIDES, endpoint=False)
        sides = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ plane_axes(opening.normal)
        own = ((self._closed.mesh.triangles[patch].reshape(-1, 3) - opening.centre) @ sides.T).max(axis=0)
        place = opening.centre + (opening.innermost - VIEW_DEPTH * opening.diameter) * opening.normal
        water = np.median([self._look(place, np.cos(t) * sides + np.sin(t) * opening.normal) for t in VIEW_TILTS], 0)
        ratio = water / own
        return float(np.minimum(ratio, np.roll(ratio, NUM_SIDES // 2)).max())

    def _look(self, place: Array, ways: Array) -> Array:
        """Return the (N,) distances at which scanned wall is seen in (N, 3) directions; inf through other openings."""
        seen = self._scene.hits(place, ways)
        return np.where(seen.is_hit & self._closed.is_scan[np.maximum(seen.faces, 0)], seen.lengths, np.inf)


def _unobserved_patches(closed: ClosedSurface) -> list[IntArray]:
    """Return the face indices of each connected patch that the scan did not see."""
    import trimesh

    solid = closed.mesh.to_trimesh()
    unseen = np.flatnonzero(~closed.is_scan)
    pairs = solid.face_adjacency[~closed.is_scan[solid.face_adjacency].any(axis=1)]
    groups = trimesh.graph.connected_components(pairs, nodes=unseen, min_len=1)
    return [np.asarray(group, dtype=np.int64) for group in groups]


def _split_by_direction(mesh: Mesh, patch: IntArray) -> list[IntArray]:
    """Return the parts of a patch that face one way each, largest first.

    Where a hole in the floor runs into the open end of a passage, both are one patch; a plane through it would cut the
    passage slantwise. Its end faces along the passage, its floor down.
    """
    import trimesh

    part = Mesh(mesh.vertices, mesh.faces[patch])
    areas, normals = part.areas, part.normals
    adjacency = trimesh.graph.face_adjacency(part.faces)
    parts, is_left = [], areas > 0.0
    while is_left.any():
        largest = np.flatnonzero(is_left)[np.argsort(-areas[is_left])[:NUM_DIRECTIONS]]
        agreeing = (normals @ normals[largest].T > MIN_AGREEMENT) & is_left[:, None]
        facing = agreeing[:, np.argmax(areas @ agreeing)]
        is_left &= ~facing
        pairs = adjacency[facing[adjacency].all(axis=1)]
        parts += trimesh.graph.connected_components(pairs, nodes=np.flatnonzero(facing), min_len=1)
    return [patch[np.asarray(part, dtype=np.int64)] for part in parts]


def _measure(mesh: Mesh, faces: IntArray, patch: IntArray) -> Opening:
    """Return the place and size of faces of a patch; nothing is said about their being a portal yet."""
    part = Mesh(mesh.vertices, mesh.faces[faces])
    corners, vector_area = part.triangles, part.vector_areas.sum(axis=0)
    area = float(np.linalg.norm(vector_area))
    normal = vector_area / max(area, 1e-12)
    centre = np.average(corners.mean(axis=1), axis=0, weights=part.areas + 1e-12)
    offsets = mesh.vertices[rim(mesh.faces[faces])] - centre
    innermost = min(float((offsets @ normal).min()), 0.0) if len(offsets) else 0.0
    radius = float(np.linalg.norm(corners.reshape(-1, 3) - centre, axis=1).max())
    outermost = float(((corners.reshape(-1, 3) - centre) @ normal).max())
    return Opening(centre, normal, area, radius, innermost, outermost, faces, patch)


def rim(faces: IntArray) -> IntArray:
    """Return the vertices on the border of a patch."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    return np.unique(unique[counts == 1])


def _spread(corners: Array, areas: Array) -> tuple[Array, Array]:
    """Return (2,) principal variances of the area of (T, 3, 2) triangles, the smaller first, m^2, and their directions.

    The directions are (2, 2): a column for each.
    """
    weights = areas / areas.sum()
    middles = corners.mean(axis=1)
    middle = weights @ middles
    own = corners - middles[:, None]  # a triangle's own second moment is a twelfth of its corners'
    moments = np.einsum("tci,tcj->tij", own, own) / 12.0
    offsets = middles - middle
    moments += offsets[:, :, None] * offsets[:, None, :]
    variances, directions = np.linalg.eigh(np.tensordot(weights, moments, axes=1))
    return variances, directions
