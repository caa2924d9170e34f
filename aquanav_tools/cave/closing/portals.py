"""Portals: the places where the passage goes on but the scan does not, cut flat and labelled.

Which openings are open ends is told in `openings`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import WALL, Cavity, Portal, from_manifold, prove_watertight, to_manifold
from aquanav_tools.cave.closing.close import ClosedSurface, faces_near
from aquanav_tools.cave.closing.dents import CRUMB, carve_dents
from aquanav_tools.cave.mesh.intersections import self_intersections
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

OBSERVED_VOXELS = 2.0
"""A piece of wall counts as observed when the scan lies within this distance of it, voxels."""
MAX_CUT_SHARE = 0.5
"""A flat cut that would remove more of the volume than this is a mistake."""
FLAT_LID = 1e-3
"""An end whose rim is flat to this share of a voxel needs no cut: its lid is the portal."""
CUT_STEPS = (0.0, 0.1, 0.25, 0.5, 1.0)
"""Voxels by which a cut moves inwards until its rim leaves no slivers that cross each other when stored in float32."""
SPREADS = (1.05, 0.9, 0.0)
"""How what is carved is evened (`carve_dents`), in turn until no faces cross: the last one leaves it as it is."""
CAMERA_VOXELS = 2.0
"""A cut passes a camera at least this far outside, voxels: more than it may move inwards later."""
NO_CAMERAS = np.zeros((0, 3))
NO_FACES: IntArray = np.zeros(0, dtype=np.int64)
TOUCH = 0.1
"""Water within this distance of an end's invented surface lies before that end, voxels."""
SLIT = 1e-3
"""Thickness of the slit that a user's cut makes before one side is dropped, m."""


@dataclass(frozen=True, eq=False)
class Cut:
    """A plane across the passage where the user ends the cave."""

    point: Array
    """(3,) in the water, m."""
    normal: Array
    """(3,) unit vector towards the part that is cut away."""


@dataclass(frozen=True, eq=False)
class Opening:
    """A patch of invented surface."""

    centre: Array
    """(3,) m."""
    normal: Array
    """(3,) unit vector out of the water."""
    area: float
    """Of the patch projected along the normal, m^2."""
    radius: float
    """Distance from the centre to the farthest vertex, m."""
    innermost: float
    """How far its rim reaches into the water, against the normal, m; not positive."""
    outermost: float
    """How far it bulges out of the plane through its centre, along the normal, m."""
    is_portal: bool
    """Whether it is the open end of a passage, not a hole in a wall."""
    faces: IntArray
    """(N,) of the closed mesh: the patch."""
    folds: IntArray
    """(K,) more of them: what was invented before a portal, facing more sideways."""

    @property
    def diameter(self) -> float:
        """Of the circle with the same area, m."""
        return float(np.sqrt(4.0 * self.area / np.pi))


def cut_portals(
    closed: ClosedSurface,
    surface: Mesh,
    openings: tuple[Opening, ...],
    voxel: float,
    cuts: tuple[Cut, ...] = (),
    cameras: Array = NO_CAMERAS,
) -> Cavity:
    """Return the cavity with every open end cut flat just inside its rim, and where the user wants it, and labelled.

    Args:
        closed: the solid.
        surface: the scan it was made from, for the `observed` flags.
        openings: from `find_openings`.
        voxel: resolution of the scan, m.
        cuts: the user's own.
        cameras: (N, 3) places in the water that an end's cut leaves in it, m, however ragged its rim, if it can.

    Raises:
        MeshError: a cut misses the cave or does not divide it, or the result is no proven solid.
    """
    mesh, lids = _cut_cleanly(closed.mesh, _ways(closed.mesh, openings, cameras, voxel), cuts, voxel)
    prove_watertight(mesh)
    labels = np.full(len(mesh.faces), WALL, dtype=np.int64)
    portals: list[Portal] = []
    for lid in lids:
        on_lid = _faces_on_lid(mesh, lid, voxel) & (labels == WALL)
        if not on_lid.any():
            logger.warning("The opening at %s was cut away with another one", lid.centre.round(2))
            continue
        labels[on_lid] = len(portals) + 1
        portals.append(_portal(mesh, labels == len(portals) + 1, len(portals) + 1, lid.normal))
    observed = faces_near(mesh, surface, OBSERVED_VOXELS * voxel) & (labels == WALL)
    return Cavity(mesh, labels, observed, tuple(portals))


def _beyond_cameras(opening: Opening, mesh: Mesh, cameras: Array, voxel: float) -> Opening:
    """Return an opening whose cut passes outside of the cameras before it: they were in the water that is kept.

    Cameras that the invented surface shuts out count too. The water is then drawn out to the cut (`carve_dents`).
    """
    import igl

    if not opening.is_portal or not len(cameras) or _is_flat(opening, mesh, voxel):
        return opening
    offsets = cameras - opening.centre
    ahead = offsets @ opening.normal
    is_near = (ahead > opening.innermost - CAMERA_VOXELS * voxel) & (np.linalg.norm(offsets, axis=1) < opening.radius)
    if not is_near.any():
        return opening
    near, ahead = cameras[is_near], ahead[is_near]
    is_inside = np.asarray(igl.fast_winding_number(mesh.vertices, mesh.faces, near)) > 0.5
    is_shut_out = ~is_inside & _are_before(opening, mesh, near)
    farthest = float(ahead[is_inside | is_shut_out].max(initial=-np.inf))
    moved = farthest + CAMERA_VOXELS * voxel
    if not is_shut_out.any():
        # Half-way to the top of the patch at most: beyond it there is no water to cut through.
        moved = min(moved, 0.5 * (farthest + opening.outermost))
    return replace(opening, innermost=max(opening.innermost, moved))


def _is_flat(opening: Opening, mesh: Mesh, voxel: float) -> bool:
    faces = np.concatenate([opening.faces, opening.folds])
    heights = (mesh.triangles[faces] - opening.centre) @ opening.normal
    return bool(np.abs(heights).max() < FLAT_LID * voxel)


def _are_before(opening: Opening, mesh: Mesh, places: Array) -> BoolArray:
    """Return the (N,) flags of places from which the way into the cave, against the normal, first meets the patch."""
    directions = np.broadcast_to(-opening.normal, places.shape)
    hits = mesh.to_trimesh().ray.intersects_first(places, directions)
    return np.isin(hits, np.concatenate([opening.faces, opening.folds]))


def _ways(
    mesh: Mesh, openings: tuple[Opening, ...], cameras: Array, voxel: float
) -> Iterator[tuple[tuple[Opening, ...], Any]]:
    """Yield ends with the solid to cut them from: drawn out past cameras and with their folds, then with ever less."""
    drawn_out = tuple(_beyond_cameras(opening, mesh, cameras, voxel) for opening in openings)
    found = [drawn_out]
    if any(len(opening.folds) for opening in openings):
        found.append(tuple(replace(opening, folds=NO_FACES) for opening in drawn_out))
    if any(end is not opening for end, opening in zip(drawn_out, openings, strict=True)):
        found.append(tuple(replace(opening, folds=NO_FACES) for opening in openings))
    for ends in found:
        for spread in SPREADS:
            yield ends, _without_dents(mesh, ends, voxel, spread)
    logger.warning("No open end could be carved without faces that cross: all are cut inside their rims as they are")
    yield found[-1], to_manifold(mesh)


def _cut_cleanly(
    mesh: Mesh, ways: Iterator[tuple[tuple[Opening, ...], Any]], cuts: tuple[Cut, ...], voxel: float
) -> tuple[Mesh, list[Opening]]:
    """Return what `_cut_all` does the first way that leaves no crossing faces and no new tunnel.

    Where every way leaves a tunnel, the first without crossing faces; where all cross, the last that was tried.
    """
    tunnelled = None
    for openings, solid in ways:
        for step in CUT_STEPS:
            cut, lids = _cut_all(solid, mesh, openings, cuts, voxel, step * voxel)
            if len(self_intersections(cut)):
                continue
            if cut.to_trimesh().euler_number >= mesh.to_trimesh().euler_number:
                return cut, lids
            tunnelled = tunnelled or (cut, lids)
            break
    return tunnelled or (cut, lids)


def _without_dents(mesh: Mesh, openings: tuple[Opening, ...], voxel: float, spread: float) -> Any:
    """Return the solid of a closed mesh whose open ends reach out to their cuts everywhere.

    All before the first cut: what is carved for one end may lie beyond the cut of another.
    """
    solid = to_manifold(mesh)
    for opening in openings:
        if opening.is_portal:
            on_plane = opening.centre + opening.innermost * opening.normal
            faces = np.concatenate([opening.faces, opening.folds])
            solid = carve_dents(solid, mesh, faces, on_plane, opening.normal, voxel, spread=spread)
    return solid


def _cut_all(
    solid: Any, mesh: Mesh, openings: tuple[Opening, ...], cuts: tuple[Cut, ...], voxel: float, inwards: float
) -> tuple[Mesh, list[Opening]]:
    """Return the mesh of a solid after all cuts, as it will be stored, and the lids they leave.

    The solid is that of the closed mesh, whose faces the openings name, with its dents carved out.
    """
    lids = []
    for cut in cuts:
        solid, lid = _cut_across(solid, replace(cut, point=cut.point - inwards * cut.normal), voxel)
        lids.append(lid)
    for opening in openings:
        if opening.is_portal and not _is_cut_away(solid, opening, voxel):
            is_flat = _is_flat(opening, mesh, voxel)
            lid = opening if is_flat else replace(opening, innermost=opening.innermost - inwards)
            solid = solid if is_flat else _cut_flat(solid, lid, mesh.triangles[opening.faces].mean(axis=1), voxel)
            lids.append(lid)
    rest = from_manifold(solid)
    # The scenario stores float32: prove what will be read back.
    return Mesh(rest.vertices.astype(np.float32).astype(np.float64), rest.faces), lids


def _cut_across(solid: Any, cut: Cut, voxel: float) -> tuple[Any, Opening]:
    """Return what is left of the solid behind a user's plane, and the opening that makes."""
    import manifold3d
    import shapely

    section = section_polygon(from_manifold(solid), cut.point, cut.normal)
    where = f"The cut at {cut.point.round(2)} m across {cut.normal.round(2)}"
    if section is None or section.distance(shapely.Point(0.0, 0.0)) > voxel:
        raise MeshError(f"{where} misses the cave. Name a point in its water; the report's plan has coordinates.")
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
    return kept[0], Opening(centre, cut.normal, section.area, radius, 0.0, 0.0, True, NO_FACES, NO_FACES)


def _holds(solid: Any, point: Array) -> bool:
    import igl

    mesh = from_manifold(solid)
    return bool(igl.fast_winding_number(mesh.vertices, mesh.faces, point[None])[0] > 0.5)


def _is_cut_away(solid: Any, opening: Opening, voxel: float) -> bool:
    """Return whether an earlier cut took an opening with it."""
    import igl

    mesh = from_manifold(solid)
    squared = igl.point_mesh_squared_distance(opening.centre[None], mesh.vertices, mesh.faces)[0]
    return float(np.sqrt(squared[0])) > max(2.0 * voxel, 0.5 * opening.diameter)


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


def plane_axes(normal: Array) -> Array:
    """Return the (2, 3) axes of a plane: first horizontal, second as upright as the plane allows."""
    horizontal = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(horizontal) < 1e-6:
        horizontal = np.array([1.0, 0.0, 0.0])
    horizontal = horizontal / np.linalg.norm(horizontal)
    return np.stack([horizontal, np.cross(normal, horizontal)])


def _cut_flat(solid: Any, lid: Opening, patch: Array, voxel: float) -> Any:
    """Return the solid without what an end has beyond the plane just inside its rim.

    Args:
        solid: manifold3d.Manifold.
        lid: the end, with the plane.
        patch: (N, 3) places on the surface invented across it, m.
        voxel: resolution of the scan, m.
    """
    rest = solid - _beyond(solid, lid, patch, voxel)
    if rest.is_empty() or rest.volume() < (1.0 - MAX_CUT_SHARE) * solid.volume():
        raise MeshError(
            f"Cutting the opening at {lid.centre.round(2)} m ({lid.diameter:.2f} m wide) flat would remove more than "
            f"half of the {solid.volume():.3g} m3. The scan is open along its side and not only at its ends: it is no "
            "passage. Scan the missing walls, or give a larger --min-portal so that the hole is filled instead."
        )
    return max(rest.decompose(), key=lambda piece: piece.volume())


def _beyond(solid: Any, lid: Opening, patch: Array, voxel: float) -> Any:
    """Return a solid on the plane of an end that holds what is cut away; arguments as in `_cut_flat`.

    A box, or where another passage runs through it, a prism around what the end has there.
    """
    import manifold3d

    half, depth = 1.2 * lid.radius, 2.4 * lid.radius
    box = manifold3d.Manifold.cube((2 * half, 2 * half, depth)).translate((-half, -half, 0.0))
    base = lid.centre + lid.innermost * lid.normal
    axes = np.column_stack([*plane_axes(lid.normal), lid.normal])
    # In the plane's frame. A dent's water was carved to beyond the plane: look for it there.
    water = solid.transform(np.column_stack([axes.T, -axes.T @ base])) ^ box
    places = (patch - base) @ axes
    places[places[:, 2] < 0.0, 2] = 0.5 * voxel
    end, passages = _divided(water, places, voxel)
    if not passages.is_empty():
        margin = 0.5 * end.min_gap(passages, voxel)
        height = end.bounding_box()[5] + margin
        box = end.project().offset(margin, manifold3d.JoinType.Miter).extrude(height)
    return box.transform(np.column_stack([axes, base]))


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


def _faces_on_lid(mesh: Mesh, lid: Opening, voxel: float) -> Any:
    offsets = mesh.triangles - (lid.centre + lid.innermost * lid.normal)
    in_plane = np.abs(offsets @ lid.normal).max(axis=1) < FLAT_LID * voxel
    return in_plane & (np.linalg.norm(offsets, axis=2).max(axis=1) <= 1.5 * lid.radius)


def _portal(mesh: Mesh, faces: Any, label: int, normal: Array) -> Portal:
    areas, middles = mesh.areas[faces], mesh.triangles[faces].mean(axis=1)
    return Portal(label, np.average(middles, axis=0, weights=areas), normal, float(areas.sum()))
