"""Portals: the places where the passage goes on but the scan does not, cut flat and labelled.

Where that is, is told in `openings` and `ends`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, Portal, from_manifold, prove_watertight, to_manifold
from aquanav_tools.cave.closing.ends import End
from aquanav_tools.cave.closing.solid import ClosedSurface, faces_within, refuse
from aquanav_tools.errors import MeshError, UnseenWallsError
from aquanav_tools.geometry.mesh.handles import genus
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.geometry.mesh.proximity import SurfaceTree, surface_tree
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.types import Array, Mesh

logger = logging.getLogger(__name__)

OBSERVED_VOXELS = 2.0
"""A piece of wall counts as observed when the scan lies within this distance of it, voxels."""
MAX_CUT_SHARE, MAX_ACCEPTED_CUT_SHARE = 0.5, 0.1
"""A flat cut that would remove more of the volume than this is a mistake; and where open walls were accepted, among
which hardly one is an end. (Chosen: photos of a kitchen, all taken one way, lost half of it to such a cut.)"""
FLAT_LID = 1e-3
"""Faces within this share of a voxel of a lid's plane belong to it ..."""
ROUNDING = 4.0 * float(np.finfo(np.float32).eps)
"""... or within this share of the largest coordinate: they are stored as float32."""
MIN_CUT_LID = 0.5
"""Share of a user's cut that must be left as its portal once all ends are cut."""
MIN_END_LEFT = 0.5
"""An open end of which the user's cuts leave less than this share ends at the cut."""
CUT_STEPS = (0.0, 0.1, 0.25, 0.5, 1.0)
"""Voxels by which a cut moves inwards until its rim leaves no slivers that cross each other when stored in float32, and
it makes no pillar out of rock that ended freely beyond it."""
CRUMB = 1.0
"""Water of fewer cubic voxels belongs to the ragged rim of an end; more is another passage."""
TOUCH = 0.1
"""Water within this distance of an end's invented surface lies before that end, voxels."""
SLIT = 1e-3
"""Thickness of the slit that a user's cut makes before one side is dropped, m."""
TURN = "The last three numbers of a cut point towards the part that goes: turn them round, or leave out one of the two."
MOVE = "Move the plane farther into the cave, or leave it out: that end becomes a portal without it."


@dataclass(frozen=True, eq=False)
class Cut:
    """A plane across the passage where the user ends the cave."""

    point: Array
    """(3,) in the water, m."""
    normal: Array
    """(3,) unit vector towards the part that is cut away."""


def cut_portals(
    closed: ClosedSurface,
    surface: Mesh,
    ends: tuple[End, ...],
    voxel: float,
    cuts: tuple[Cut, ...] = (),
    accept: Callable[[UnseenWallsError], None] = refuse,
    max_share: float = MAX_CUT_SHARE,
    tree: SurfaceTree | None = None,
) -> Cavity:
    """Return the cavity with every open end cut flat, and where the user wants it, and labelled.

    Args:
        closed: the solid, drawn out to the cuts by the columns of its ends.
        surface: the scan it was made from, for the `observed` flags.
        ends: from `find_ends`.
        voxel: resolution of the scan, m.
        cuts: the user's own.
        accept: raises what it is given, or notes it; an end that no flat cut fits then stays wall.
        max_share: a flat cut of an end that would remove more of the volume than this is a mistake.
        tree: over the triangles of `surface`, where it is at hand.

    Raises:
        MeshError: a cut of the user misses the cave, does not divide it, or makes no portal because another cut takes
            it away; the message says which. Or the result is no proven solid.
    """
    solid = to_manifold(closed.mesh)
    mesh, lids = _cut_soundly(solid, ends, cuts, voxel, accept, max_share)
    prove_watertight(mesh)
    labels = np.full(len(mesh.faces), WALL, dtype=np.int64)
    portals: list[Portal] = []
    for lid in lids:
        on_lid = _faces_on_lid(mesh, lid, voxel) & (labels == WALL)
        if not on_lid.any():
            logger.warning("The opening at %s was cut away with another one", lid.point.round(2))
            continue
        labels[on_lid] = len(portals) + 1
        portals.append(_portal(mesh, labels == len(portals) + 1, len(portals) + 1, lid.normal))
    observed = faces_within(mesh, tree or surface_tree(surface), OBSERVED_VOXELS * voxel) & (labels == WALL)
    return Cavity(mesh, labels, observed, tuple(portals))


def _cut_soundly(
    solid: Any,
    ends: tuple[End, ...],
    cuts: tuple[Cut, ...],
    voxel: float,
    accept: Callable[[UnseenWallsError], None],
    max_share: float,
) -> tuple[Mesh, list[End]]:
    """Return the mesh of a solid after all cuts, as far inwards as it takes, and the lids they leave."""
    found = None
    for step in CUT_STEPS:
        mesh, lids = _cut_all(solid, ends, cuts, voxel, step * voxel, accept, max_share)
        if len(self_intersections(mesh)):
            continue
        if genus(mesh) <= solid.genus():
            return mesh, lids
        found = found or (mesh, lids)
    # Longer rock is left with its tip at the end.
    return found or (mesh, lids)


def _cut_all(
    solid: Any,
    ends: tuple[End, ...],
    cuts: tuple[Cut, ...],
    voxel: float,
    inwards: float,
    accept: Callable[[UnseenWallsError], None],
    max_share: float,
) -> tuple[Mesh, list[End]]:
    """Return the mesh of a solid after all cuts, as it will be stored, and the lids they leave."""
    lids: list[End] = []
    for cut in cuts:
        rest, lid = _cut_across(solid, replace(cut, point=cut.point - inwards * cut.normal), cuts[: len(lids)], voxel)
        _check_are_left(rest, lids, voxel, f"the {_name(cut)} takes it away with all beyond. {TURN}")
        lids.append(lid)
        solid = rest
    for end in _left_by(solid, ends, voxel) if cuts else ends:
        if not _is_cut_away(solid, end, voxel):
            lid = end if end.is_flat else replace(end, point=end.point - inwards * end.normal)
            try:
                solid = solid if end.is_flat else _cut_flat(solid, lid, voxel, max_share)
            except UnseenWallsError as error:
                accept(error)
                continue
            reason = f"the open end at {end.point.round(2)} m lies so near that cutting it flat takes it away. {MOVE}"
            _check_are_left(solid, lids[: len(cuts)], voxel, reason)
            lids.append(lid)
    rest = from_manifold(solid)
    # The scenario stores float32: prove what will be read back.
    return Mesh(rest.vertices.astype(np.float32).astype(np.float64), rest.faces), lids


def _name(cut: Cut) -> str:
    return f"cut at {cut.point.round(2)} m across {cut.normal.round(2)}"


def _check_are_left(solid: Any, lids: list[End], voxel: float, reason: str) -> None:
    """Check that of every cut of the user most is left on a solid.

    Raises:
        MeshError: with the cut of which it is not, and the reason.
    """
    mesh = from_manifold(solid)
    for lid in lids:
        area = float(mesh.areas[_faces_on_lid(mesh, lid, voxel)].sum())
        if area < MIN_CUT_LID * 0.25 * np.pi * lid.diameter**2:
            raise MeshError(f"The {_name(Cut(lid.point, lid.normal))} makes no portal: {reason}")


def _left_by(solid: Any, ends: tuple[End, ...], voxel: float) -> tuple[End, ...]:
    """Return the ends of which most is left on the solid after the user's cuts."""
    import igl

    mesh = from_manifold(solid)

    def share(end: End) -> float:
        squared = igl.point_mesh_squared_distance(end.places, mesh.vertices, mesh.faces)[0]
        is_within = igl.fast_winding_number(mesh.vertices, mesh.faces, end.places) > 0.5
        return float((is_within | (squared < voxel**2)).mean())

    return tuple(end for end in ends if share(end) >= MIN_END_LEFT)


def _cut_across(solid: Any, cut: Cut, earlier: tuple[Cut, ...], voxel: float) -> tuple[Any, End]:
    """Return what is left of the solid behind a user's plane, and the end that makes."""
    import manifold3d
    import shapely

    section = section_polygon(from_manifold(solid), cut.point, cut.normal)
    where = f"The {_name(cut)}"
    if section is None or section.distance(shapely.Point(0.0, 0.0)) > voxel:
        gone = "".join(
            f" Or the {_name(one)} takes that place away. {TURN}"
            for one in earlier
            if (cut.point - one.point) @ one.normal > 0.0
        )
        raise MeshError(f"{where} misses the cave. Name a point in its water; the report's plan has coordinates.{gone}")
    outline = shapely.geometry.polygon.orient(section.buffer(0.5 * voxel))
    slit = manifold3d.CrossSection([np.asarray(outline.exterior.coords)[:-1]]).extrude(SLIT)
    axes = plane_axes(cut.normal)
    slit = slit.transform(np.column_stack([*axes, cut.normal, cut.point]))
    pieces = (solid - slit).decompose()
    middle = np.asarray(section.representative_point().coords[0]) @ axes + cut.point
    kept = [piece for piece in pieces if _holds(piece, middle - SLIT * cut.normal)]
    dropped = [piece for piece in pieces if _holds(piece, middle + 2.0 * SLIT * cut.normal)]
    if not kept or not dropped or kept[0] is dropped[0]:
        raise MeshError(
            f"{where} does not divide the cave: both sides stay connected another way round. Add a cut across that "
            "way too, or move the plane."
        )
    edge = np.asarray(section.exterior.coords)
    centre = np.asarray(section.centroid.coords[0]) @ axes + cut.point
    radius = float(np.linalg.norm(edge @ axes + cut.point - centre, axis=1).max()) + voxel
    return kept[0], End(centre, cut.normal, radius, float(np.sqrt(4.0 * section.area / np.pi)), centre[None], False)


def _holds(solid: Any, point: Array) -> bool:
    import igl

    mesh = from_manifold(solid)
    return bool(igl.fast_winding_number(mesh.vertices, mesh.faces, point[None])[0] > 0.5)


def _is_cut_away(solid: Any, end: End, voxel: float) -> bool:
    """Return whether an earlier cut took an end with it."""
    import igl

    if _holds(solid, end.point):
        return False
    mesh = from_manifold(solid)
    squared = igl.point_mesh_squared_distance(end.point[None], mesh.vertices, mesh.faces)[0]
    return float(np.sqrt(squared[0])) > max(2.0 * voxel, 0.5 * end.diameter)


def section_polygon(mesh: Mesh, point: Array, normal: Array) -> Any:
    """Return the shapely polygon of the cross-section around (or nearest to) a point, in plane coordinates.

    The plane's axes are those of `plane_axes(normal)`, its origin is `point`. None where the plane misses the mesh.
    """
    import shapely
    import trimesh

    lines = trimesh.intersections.mesh_plane(mesh.to_trimesh(), plane_normal=normal, plane_origin=point)
    if not len(lines):
        return None
    flat = (np.asarray(lines) - point) @ plane_axes(normal).T
    snapped = shapely.set_precision(shapely.multilinestrings([shapely.linestrings(line) for line in flat]), 1e-6)
    rings = list(shapely.polygonize([snapped]).geoms) if not snapped.is_empty else []
    if not rings:
        return None
    origin = shapely.Point(0.0, 0.0)
    return min(rings, key=lambda ring: (ring.distance(origin), -ring.area))


def _cut_flat(solid: Any, lid: End, voxel: float, max_share: float) -> Any:
    """Return the solid without what an end has beyond its plane."""
    rest = solid - _beyond(solid, lid, voxel)
    kept = max(rest.decompose(), key=lambda piece: piece.volume(), default=rest)  # what it cuts off goes with it
    if kept.volume() < (1.0 - max_share) * solid.volume():
        raise UnseenWallsError(
            "open-side",
            f"Cutting the opening at {lid.point.round(2)} m ({lid.diameter:.2f} m wide) flat would remove "
            f"{1.0 - kept.volume() / solid.volume():.0%} of the {solid.volume():.3g} m3, and {max_share:.0%} may go. "
            "The scan is open along its side and not only at its ends.",
            "Scan the missing walls, or give a larger --min-portal so that the hole is filled instead.",
            [(tuple(lid.point.tolist()), f"opening, {lid.diameter:.2f} m wide")],
        )
    return kept


def _beyond(solid: Any, lid: End, voxel: float) -> Any:
    """Return a solid on the plane of an end that holds what is cut away.

    A box, or where another passage runs through it, a prism around what the end has there.
    """
    import manifold3d

    half, depth = 1.2 * lid.radius, 2.4 * lid.radius
    box = manifold3d.Manifold.cube((2 * half, 2 * half, depth)).translate((-half, -half, 0.0))
    axes = np.column_stack([*plane_axes(lid.normal), lid.normal])
    # In the plane's frame. A column's water reaches to beyond the plane: look for it there.
    water = solid.transform(np.column_stack([axes.T, -axes.T @ lid.point])) ^ box
    places = (lid.places - lid.point) @ axes
    places[places[:, 2] < 0.0, 2] = 0.5 * voxel
    end, passages = _divided(water, places, voxel)
    if not passages.is_empty():
        margin = 0.5 * end.min_gap(passages, voxel)
        height = end.bounding_box()[5] + margin
        box = end.project().offset(margin, manifold3d.JoinType.Miter).extrude(height)
    return box.transform(np.column_stack([axes, lid.point]))


def _divided(water: Any, places: Array, voxel: float) -> tuple[Any, Any]:
    """Return the pieces of a solid that hold or touch any of (N, 3) places, crumbs with them, and the other ones."""
    import igl
    import manifold3d

    ends: list[Any] = []
    passages: list[Any] = []
    for piece in water.decompose():
        mesh = from_manifold(piece)
        squared = igl.point_mesh_squared_distance(places, mesh.vertices, mesh.faces)[0]
        is_touching = squared.min() < (TOUCH * voxel) ** 2
        is_holding = (igl.fast_winding_number(mesh.vertices, mesh.faces, places) > 0.5).any()
        is_end = is_touching or is_holding or piece.volume() < CRUMB * voxel**3
        (ends if is_end else passages).append(piece)
    return manifold3d.Manifold.compose(ends), manifold3d.Manifold.compose(passages)


def _faces_on_lid(mesh: Mesh, lid: End, voxel: float) -> Any:
    offsets = mesh.triangles - lid.point
    tolerance = max(FLAT_LID * voxel, ROUNDING * float(np.abs(mesh.vertices).max()))
    in_plane = np.abs(offsets @ lid.normal).max(axis=1) < tolerance
    return in_plane & (np.linalg.norm(offsets, axis=2).max(axis=1) <= 1.5 * lid.radius)


def _portal(mesh: Mesh, faces: Any, label: int, normal: Array) -> Portal:
    areas, middles = mesh.areas[faces], mesh.triangles[faces].mean(axis=1)
    return Portal(label, np.average(middles, axis=0, weights=areas), normal, float(areas.sum()))
