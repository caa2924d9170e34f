"""The solid around the water: which of several bodies of water it is, and whether it is a cave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.closing.ambient_occlusion import MIN_OCCLUSION, ambient_occlusion, check_occlusion
from aquanav_tools.cave.scan.orientation import face_areas
from aquanav_tools.errors import MeshError, UnseenWallsError
from aquanav_tools.geometry.mesh.components import component, component_ids, component_volumes
from aquanav_tools.geometry.mesh.proximity import SurfaceTree, are_within
from aquanav_tools.geometry.mesh.rays import RayScene
from aquanav_tools.types import Array, BoolArray, Mesh

SCAN_VOXELS = 0.75
"""A resampled face follows the scan when its middle is within this distance of it, voxels."""
MIN_SECOND_CAVE = 0.2
"""Separate water with at least this share of the largest body's volume is a cave of its own, not a stray pocket."""
MAX_HOLLOW_SHARE = 0.3
"""Of several bodies of water, one with more of its surface invented is a hollow of an uneven sheet. Measured: under
waves 0.1 to 0.8 m high 90 to 33 %, passages four times as long as wide 8 %."""
NUM_VIEWPOINTS = 200
"""Places in a body of water from which is told whether it is a cave."""
MIN_THICKNESS = 0.5
"""Twice its volume over its area: water of less than so many voxels is what noise leaves between two samples. Round
passages have their radius, so that this is one voxel wide."""
CHORD_OFFSET = 1e-3
"""A ray across the water starts this far from its wall, m."""
MIN_FLOATING_ROCK = 1e-4
"""Pieces of rock floating in the water that are smaller than this share of it are noise and not worth a word."""


@dataclass(frozen=True, eq=False)
class ClosedSurface:
    """A solid around the water, in one piece."""

    mesh: Mesh
    is_scan: BoolArray
    """(F,) whether the face follows the scan; the others were invented to close it."""
    method: str
    """"caps" (the scan's own triangles), "winding" (resampled), or "made-up" (closed from the start)."""
    cautions: tuple[tuple[str, str], ...] = ()
    """Codes and sentences about what had to be changed or left out."""


def refuse(error: UnseenWallsError) -> None:
    """Accept no open surface."""
    raise error


def no_space(surface: Mesh, voxel: float) -> MeshError:
    """Return the error that a scan encloses no water."""
    return MeshError(
        f"The scan of {len(surface.faces)} triangles encloses no space at {voxel:.3g} m. It is a single wall or floor "
        "and no passage. Scan the surroundings too, or give a smaller --voxel if the passage is narrower."
    )


def faces_within(mesh: Mesh, surface: SurfaceTree, distance: float) -> BoolArray:
    """Return the (F,) flags of faces whose middle lies within `distance` (m) of a surface."""
    return are_within(surface, mesh.triangles.mean(axis=1), distance)


def main_water(
    mesh: Mesh,
    surface: Mesh,
    tree: SurfaceTree,
    inside: Array,
    voxel: float,
    accept: Callable[[UnseenWallsError], None],
) -> tuple[Mesh, tuple[tuple[str, str], ...]]:
    """Return one body of water out of all, without rock floating in it, and what was left out.

    Args:
        mesh: closed, of any number of pieces, normals out of the water.
        surface: the scan.
        tree: over the scan's triangles.
        inside: (N, 3) places in the water that is wanted, m; the largest body without any.
        voxel: resolution, m.
        accept: raises what it is given, or notes it.

    Raises:
        MeshError: there is no water, or two caves are.
    """
    ids, count = component_ids(mesh)
    volumes = component_volumes(mesh, ids, count)
    waters = np.flatnonzero(volumes > 0.0)
    if not len(waters):
        raise MeshError("The closed surface encloses no water. It is inside out or flat: scan the walls on all sides.")
    waters = waters[np.argsort(-volumes[waters], kind="stable")]
    bodies = [component(mesh, ids == body) for body in waters[: 2 if not len(inside) else len(waters)]]
    chosen = max(range(len(bodies)), key=lambda n: (_num_inside(bodies[n], inside), -n))
    if len(waters) > 1 and not len(inside) and volumes[waters[1]] > MIN_SECOND_CAVE * volumes[waters[0]]:
        _check_is_the_cave(bodies, volumes[waters[:2]], len(waters), surface, tree, voxel, accept)
    if 2.0 * volumes[waters[chosen]] < MIN_THICKNESS * voxel * face_areas(bodies[chosen])[0].sum():
        raise no_space(surface, voxel)
    is_rock = volumes < -MIN_FLOATING_ROCK * volumes[waters[chosen]]
    rocks = [(component(mesh, ids == rock), float(-volumes[rock])) for rock in np.flatnonzero(is_rock)]
    return bodies[chosen], tuple(_floating_rock(rocks))


def _check_is_the_cave(
    bodies: list[Mesh],
    volumes: Array,
    number: int,
    surface: Mesh,
    tree: SurfaceTree,
    voxel: float,
    accept: Callable[[UnseenWallsError], None],
) -> None:
    """Check that the first of two bodies of water is a cave, and that the second is none."""
    first, second = bodies
    try:
        _check_is_no_hollow(first, float(volumes[0]), tree, voxel, number)
        check_occlusion(surface, _middles(first), "the largest of several bodies of water")
    except UnseenWallsError as error:
        accept(error)
    is_cave = np.median(ambient_occlusion(surface, _middles(second))) >= MIN_OCCLUSION
    if is_cave and _invented_share(second, tree, voxel) <= MAX_HOLLOW_SHARE:
        raise _two_caves(bodies, volumes)


def _check_is_no_hollow(body: Mesh, volume: float, tree: SurfaceTree, voxel: float, number: int) -> None:
    """Refuse a body of water under a wave of a sheet: the sheet is one half of its surface, the other was invented."""
    share = _invented_share(body, tree, voxel)
    if share > MAX_HOLLOW_SHARE:
        raise UnseenWallsError(
            "hollows",
            f"This is no cave: {share:.0%} of the surface around the largest of {number} bodies of water was never "
            f"scanned, and a passage has at most {MAX_HOLLOW_SHARE:.0%}. These are hollows of an uneven wall or floor.",
            "Scan the walls on all sides.",
            [(tuple(_middle(body).tolist()), f"{volume:.3g} m3")],
        )


def _invented_share(body: Mesh, tree: SurfaceTree, voxel: float) -> float:
    """Return the share of the area around a body of water that does not follow the scan."""
    areas = face_areas(body)[0]
    return float(areas[~faces_within(body, tree, SCAN_VOXELS * voxel)].sum() / areas.sum())


def _num_inside(body: Mesh, points: Array) -> int:
    import igl

    is_in_box = ((points >= body.vertices.min(axis=0)) & (points <= body.vertices.max(axis=0))).all(axis=1)
    if not is_in_box.any():
        return 0
    return int((igl.fast_winding_number(body.vertices, body.faces, points[is_in_box]) > 0.5).sum())


def _middles(body: Mesh) -> Array:
    """Return (N, 3) places in a body of water, half-way from wall to wall where it is widest."""
    chosen = np.linspace(0, len(body.faces) - 1, min(len(body.faces), 4 * NUM_VIEWPOINTS)).astype(np.int64)
    walls, inwards = body.triangles[chosen].mean(axis=1), -face_areas(body)[1][chosen]
    width = RayScene(body).lengths(walls + CHORD_OFFSET * inwards, inwards)
    width[np.isinf(width)] = 0.0
    widest = np.argsort(-width)[:NUM_VIEWPOINTS]
    middles: Array = (walls + 0.5 * width[:, None] * inwards)[widest]
    return middles


def _two_caves(bodies: list[Mesh], volumes: Array) -> MeshError:
    places = [(tuple(_middle(body).tolist()), f"{volume:.3g} m3") for body, volume in zip(bodies, volumes, strict=True)]
    (one, one_size), (other, other_size) = ((np.round(place, 1), size) for place, size in places)
    return MeshError(
        f"The scan holds two separate caves: {one_size} around {one} m and {other_size} around {other} m. Scan the "
        "passage between them, or choose one with --inside X Y Z, a point in its water.",
        places,
    )


def _floating_rock(rocks: list[tuple[Mesh, float]]) -> list[tuple[str, str]]:
    if not rocks:
        return []
    places = ", ".join(f"{volume:.2g} m3 at {_middle(rock).round(1)}" for rock, volume in rocks[:5])
    return [
        (
            "floating-rock",
            f"{len(rocks)} pieces of rock float free in the water and were left out ({places}). Where a real boulder "
            "lies there, scan the place where it rests on the floor.",
        )
    ]


def _middle(body: Mesh) -> Array:
    middle: Array = 0.5 * (body.vertices.min(axis=0) + body.vertices.max(axis=0))
    return middle
