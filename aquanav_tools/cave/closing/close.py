"""Closing: from an open, damaged surface to a solid that encloses the water.

A sound surface is closed exactly, by a lid over each hole (`lids`). Anything else is resampled (`winding`). Whatever
the way, the result is one solid and has no tunnel that nobody scanned. What is kept of it is proven after the open ends
were cut (`portals`), and held against what is known to be water (`from_scan`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import from_manifold, to_manifold
from aquanav_tools.cave.closing.carving import NO_CARVING, Carving
from aquanav_tools.cave.closing.columns import Column
from aquanav_tools.cave.closing.enclosure import MIN_ENCLOSURE, check_enclosure, enclosure
from aquanav_tools.cave.closing.evidence import NO_EVIDENCE, NO_LEGS, Evidence, contradictions
from aquanav_tools.cave.closing.fairing import fair_holes
from aquanav_tools.cave.closing.lids import close_with_lids
from aquanav_tools.cave.closing.winding import Sampler
from aquanav_tools.cave.mesh.decimation import without_excess
from aquanav_tools.cave.mesh.handles import Handle, find_handles
from aquanav_tools.cave.scan.orientation import face_areas
from aquanav_tools.errors import MeshError, UnseenWallsError
from aquanav_tools.types import Array, BoolArray, Mesh, Progress, ignore_progress

logger = logging.getLogger(__name__)

SCAN_VOXELS = 0.75
"""A resampled face follows the scan when its middle is within this distance of it, voxels."""
HOLE_VOXELS = 0.3
"""... and one is of a hole of the simplified surface likewise, voxels."""
SIMPLIFY_VOXELS = 0.1
"""Triangles of the resampled surface are merged where that moves it by no more than this, voxels."""
MIN_SECOND_CAVE = 0.2
"""Separate water with at least this share of the largest body's volume is a cave of its own, not a stray pocket."""
MAX_HOLLOW_SHARE = 0.3
"""Of several bodies of water, one with more of its surface invented is a hollow of an uneven sheet. Measured: under
waves 0.1 to 0.8 m high 90 to 33 %, passages four times as long as wide 8 %."""
NUM_VIEWPOINTS = 200
"""Places in a body of water from which is told whether it is a cave."""
CHORD_OFFSET = 1e-3
"""A ray across the water starts this far from its wall, m."""
MIN_FLOATING_ROCK = 1e-4
"""Pieces of rock floating in the water that are smaller than this share of it are noise and not worth a word."""
LEG_VOXELS = 1.5
"""Water that is carved around a blocked leg, voxels."""
FAULT_VOXELS = (1.5, 3.0, 5.0)
"""Tunnels that nobody scanned are smoothed away with balls of these radii in turn, voxels."""
NOISE_VOXELS = 1.0
"""Tunnels and pillars thinner than this come from noise, voxels."""
MIN_SEEN_SHARE = 0.5
"""A tunnel was scanned when at least this share of the shortest loop around it follows the scan."""

NO_HOLES = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))


@dataclass(frozen=True, eq=False)
class ClosedSurface:
    """A solid around the water, in one piece."""

    mesh: Mesh
    is_scan: BoolArray
    """(F,) whether the face follows the scan; the others were invented to close it."""
    method: str
    """"lids" (the scan's own triangles), "winding" (resampled), or "made-up" (closed from the start)."""
    cautions: tuple[tuple[str, str], ...] = ()
    """Codes and sentences about what had to be changed or left out."""


def refuse(error: UnseenWallsError) -> None:
    """Accept no open surface."""
    raise error


def close_surface(
    surface: Mesh,
    voxel: float,
    *,
    keep_triangles: bool,
    min_portal: float,
    evidence: Evidence = NO_EVIDENCE,
    progress: Progress = ignore_progress,
) -> ClosedSurface:
    """Return the solid enclosed by an open surface, normals out of the water; arguments and errors of `Closer`."""
    closer = Closer(surface, voxel, keep_triangles=keep_triangles, min_portal=min_portal, evidence=evidence)
    return closer.close(progress=progress)


class Closer:
    """Closes one surface, and again where more turns out to be water.

    Args:
        surface: normals out of the water.
        voxel: size of the grid's cells where the surface is resampled, m.
        keep_triangles: try lids first. For scans that come as meshes; a surface fitted to points is better resampled,
            which smooths the false handles that noise makes.
        min_portal: holes narrower than this are filled with the curvature of the wall around them, m.
        evidence: what is known to be water.
        accept: raises what it is given, or notes it.
    """

    def __init__(
        self,
        surface: Mesh,
        voxel: float,
        *,
        keep_triangles: bool,
        min_portal: float,
        evidence: Evidence = NO_EVIDENCE,
        accept: Callable[[UnseenWallsError], None] = refuse,
    ) -> None:
        self._surface, self._voxel, self._evidence, self._accept = surface, voxel, evidence, accept
        self._keep_triangles, self._min_portal = keep_triangles, min_portal
        self._carving = replace(NO_CARVING, leg_radius=LEG_VOXELS * voxel)

    def close(
        self,
        legs: Array = NO_LEGS,
        columns: tuple[Column, ...] = (),
        holes: Mesh = NO_HOLES,
        progress: Progress = ignore_progress,
    ) -> ClosedSurface:
        """Return the solid that is enclosed, normals out of the water.

        Legs between two places in its water are dug free where rock blocks them. Evidence outside of it stays there:
        ends are not drawn out by themselves.

        Args:
            legs: (M, 2, 3) lines that become water whatever the surface says, beside those of earlier calls, m.
            columns: water that is added at open ends.
            holes: invented faces of an earlier result that are to continue the curvature of the wall around them.
            progress: called with (parts done, parts in all).

        Raises:
            MeshError: no space is enclosed, or two caves are.
        """
        if self._keep_triangles and not (len(legs) or columns or len(holes.faces)):
            try:
                lidded = close_with_lids(self._surface, self._min_portal)
                if not contradictions(lidded.mesh, self._evidence, self._voxel).count:
                    return ClosedSurface(lidded.mesh, lidded.is_scan, "lids")
                logger.info("Lids seal a place that is known to be water; resampling at %.3g m", self._voxel)
            except MeshError as reason:
                logger.info("Lids do not close the surface (%s); resampling it at %.3g m", reason, self._voxel)
        self._carving = replace(self._carving, legs=np.concatenate([self._carving.legs, legs]), columns=columns)
        return self._resample(holes, progress)

    @cached_property
    def _sampler(self) -> Sampler:
        return Sampler(self._surface, self._voxel, self._evidence.sight)

    def _resample(self, holes: Mesh, progress: Progress) -> ClosedSurface:
        """Return the resampled solid, corrected until no leg is blocked and no tunnel left that nobody scanned."""
        surface, voxel, evidence = self._surface, self._voxel, self._evidence
        for fault_voxels in (*FAULT_VOXELS, None):
            waters = self._sampler.water_surface(self._carving, progress)
            solid, cautions = _main_water(waters, surface, evidence, voxel, self._accept)
            mesh = without_excess(self._faired(from_manifold(solid), holes), SIMPLIFY_VOXELS * voxel)
            if fault_voxels is None:
                break
            blocked = _blocked(mesh, waters, evidence, voxel)
            faults = _false_handles(mesh, surface, voxel)
            if not (len(blocked) or faults):
                break
            self._carving = _carve(self._carving, blocked, faults, fault_voxels, voxel)
        return ClosedSurface(mesh, faces_near(mesh, surface, SCAN_VOXELS * voxel), "winding", cautions)

    def _faired(self, mesh: Mesh, holes: Mesh) -> Mesh:
        if not len(holes.faces):
            return mesh
        is_hole = faces_near(mesh, holes, HOLE_VOXELS * self._voxel)
        is_hole &= ~faces_near(mesh, self._surface, SCAN_VOXELS * self._voxel)
        return fair_holes(mesh, is_hole, self._voxel)


def faces_near(closed: Mesh, surface: Mesh, distance: float) -> BoolArray:
    """Return the (F,) flags of faces whose middle lies within `distance` of the scanned surface."""
    import igl

    centroids = closed.triangles.mean(axis=1)
    squared = igl.point_mesh_squared_distance(centroids, surface.vertices, surface.faces)[0]
    near: BoolArray = np.asarray(squared) <= distance**2
    return near


def _blocked(mesh: Mesh, waters: Mesh, evidence: Evidence, voxel: float) -> Array:
    """Return the (M, 2, 3) legs that rock blocks although both their ends lie in water, be it of two bodies."""
    legs = evidence.legs[contradictions(mesh, evidence, voxel).legs]
    dry = contradictions(waters, Evidence(legs.reshape(-1, 3)), voxel).points
    blocked: Array = np.delete(legs, np.unique(dry // 2), axis=0)
    return blocked


def _carve(
    before: Carving,
    blocked: Array,
    faults: tuple[Handle, ...],
    fault_voxels: float,
    voxel: float,
) -> Carving:
    """Return the corrections so far and those for newly blocked legs and newly found tunnels."""
    balls = [
        (
            *handle.centre,
            0.5 * handle.length + 2.0 * fault_voxels * voxel,
            0.0 if handle.diameter < NOISE_VOXELS * voxel else voxel,
        )
        for handle in faults
    ]
    return replace(
        before,
        legs=np.concatenate([before.legs, blocked]),
        faults=np.concatenate([before.faults, np.array(balls).reshape(-1, 5)]),
        fault_radius=fault_voxels * voxel,
    )


def _false_handles(mesh: Mesh, surface: Mesh, voxel: float) -> tuple[Handle, ...]:
    """Return the tunnels and pillars of a closed mesh that the scan did not see, or cannot tell from its noise."""
    import igl

    def seen_share(handle: Handle) -> float:
        squared = igl.point_mesh_squared_distance(handle.points, surface.vertices, surface.faces)[0]
        return float((np.asarray(squared) <= voxel**2).mean())

    return tuple(
        handle
        for handle in find_handles(mesh)
        if handle.diameter < NOISE_VOXELS * voxel or seen_share(handle) < MIN_SEEN_SHARE
    )


def _main_water(
    mesh: Mesh, surface: Mesh, evidence: Evidence, voxel: float, accept: Callable[[UnseenWallsError], None]
) -> tuple[Any, tuple[tuple[str, str], ...]]:
    """Return the manifold3d solid of the main body of water, without rock floating in it, and what was left out."""
    bodies = to_manifold(mesh).decompose()
    waters = sorted((body for body in bodies if body.volume() > 0.0), key=lambda body: -body.volume())
    if not waters:
        raise MeshError("The closed surface encloses no water. It is inside out or flat: scan the walls on all sides.")
    chosen = max(waters, key=lambda body: (_num_inside(body, evidence.inside), body.volume()))
    second = next((body for body in waters if body is not chosen), None)
    if second is not None and not len(evidence.inside) and second.volume() > MIN_SECOND_CAVE * chosen.volume():
        try:
            _check_is_no_hollow(chosen, surface, voxel, len(waters))
            check_enclosure(surface, _middles(chosen), "the largest of several bodies of water")
        except UnseenWallsError as error:
            accept(error)
        is_cave = np.median(enclosure(surface, _middles(second))) >= MIN_ENCLOSURE
        if is_cave and _invented_share(second, surface, voxel) <= MAX_HOLLOW_SHARE:
            raise _two_caves(chosen, second)
    return chosen, tuple(_floating_rock(bodies, chosen.volume()))


def _check_is_no_hollow(body: Any, surface: Mesh, voxel: float, number: int) -> None:
    """Refuse a body of water under a wave of a sheet: the sheet is one half of its surface, the other was invented."""
    share = _invented_share(body, surface, voxel)
    if share > MAX_HOLLOW_SHARE:
        raise UnseenWallsError(
            "hollows",
            f"This is no cave: {share:.0%} of the surface around the largest of {number} bodies of water was never "
            f"scanned, and a passage has at most {MAX_HOLLOW_SHARE:.0%}. These are hollows of an uneven wall or floor.",
            "Scan the walls on all sides.",
            [(tuple(_middle(body).tolist()), f"{body.volume():.3g} m3")],
        )


def _invented_share(body: Any, surface: Mesh, voxel: float) -> float:
    """Return the share of the area around a body of water that does not follow the scan."""
    mesh = from_manifold(body)
    areas = face_areas(mesh)[0]
    return float(areas[~faces_near(mesh, surface, SCAN_VOXELS * voxel)].sum() / areas.sum())


def _num_inside(body: Any, points: Array) -> int:
    import igl

    if not len(points):
        return 0
    mesh = from_manifold(body)
    return int((igl.fast_winding_number(mesh.vertices, mesh.faces, points) > 0.5).sum())


def _middles(body: Any) -> Array:
    """Return (N, 3) places in a body of water, half-way from wall to wall where it is widest."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    mesh = from_manifold(body)
    chosen = np.linspace(0, len(mesh.faces) - 1, min(len(mesh.faces), 4 * NUM_VIEWPOINTS)).astype(np.int64)
    walls, inwards = mesh.triangles[chosen].mean(axis=1), -face_areas(mesh)[1][chosen]
    scene, origin = EmbreeScene(), walls.mean(axis=0)
    triangles = TriangleMesh(scene, (mesh.triangles - origin).astype(np.float32))
    starts = (walls - origin + CHORD_OFFSET * inwards).astype(np.float32)
    width = np.asarray(scene.run(starts, inwards.astype(np.float32), query="DISTANCE"), dtype=np.float64)
    del triangles  # the scene reads it while it is asked
    width = np.where(width < 1e30, width, 0.0)
    widest = np.argsort(-width)[:NUM_VIEWPOINTS]
    middles: Array = (walls + 0.5 * width[:, None] * inwards)[widest]
    return middles


def _two_caves(first: Any, second: Any) -> MeshError:
    places = [(tuple(_middle(body).tolist()), f"{body.volume():.3g} m3") for body in (first, second)]
    (one, one_size), (other, other_size) = ((np.round(place, 1), size) for place, size in places)
    return MeshError(
        f"The scan holds two separate caves: {one_size} around {one} m and {other_size} around {other} m. Scan the "
        "passage between them, or choose one with --inside X Y Z, a point in its water.",
        places,
    )


def _floating_rock(bodies: list[Any], volume: float) -> list[tuple[str, str]]:
    rocks = [body for body in bodies if body.volume() < -MIN_FLOATING_ROCK * volume]
    if not rocks:
        return []
    places = ", ".join(f"{-rock.volume():.2g} m3 at {_middle(rock).round(1)}" for rock in rocks[:5])
    return [
        (
            "floating-rock",
            f"{len(rocks)} pieces of rock float free in the water and were left out ({places}). Where a real boulder "
            "lies there, scan the place where it rests on the floor.",
        )
    ]


def _middle(body: Any) -> Array:
    low, high = np.array(body.bounding_box()).reshape(2, 3)
    middle: Array = 0.5 * (low + high)
    return middle
