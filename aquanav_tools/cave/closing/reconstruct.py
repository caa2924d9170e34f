"""From a prepared scan to its cavity: closed, its ends cut, and held against what is known to be water.

A sound surface is closed exactly, by a cap over each hole (`hole_capping`). Anything else is resampled (`tiles`). What
comes out is examined, and while it is wrong, corrections are added and it is extracted anew, where they reach: legs
that rock blocks, tunnels that nobody scanned, ends to be drawn out, known water that an end shut out. That is the one
loop of `close_scan`; it ends with a proven cavity, and what could not be put right is told among the cautions.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.closing.ends import NO_CAMERAS, End, find_ends, without_passed
from aquanav_tools.cave.closing.fairing import fair_holes
from aquanav_tools.cave.closing.field_edits import NO_EDITS, FieldEdits
from aquanav_tools.cave.closing.free_space import NONE_KNOWN, FreeSpace, contradictions
from aquanav_tools.cave.closing.hole_capping import cap_holes
from aquanav_tools.cave.closing.openings import find_openings, holes_in_wall
from aquanav_tools.cave.closing.portals import MAX_ACCEPTED_CUT_SHARE, MAX_CUT_SHARE, Cut, cut_portals
from aquanav_tools.cave.closing.solid import SCAN_VOXELS, ClosedSurface, faces_within, main_water
from aquanav_tools.cave.closing.tiles import ImplicitField, TileCache, implicit_field, water_surface
from aquanav_tools.cave.scan.sight import believed
from aquanav_tools.cave.scan.surface import Surface, without_gaps
from aquanav_tools.errors import MeshError, UnseenWallsError
from aquanav_tools.geometry.mesh.decimation import merge_faces, simplify
from aquanav_tools.geometry.mesh.handles import Handle, find_handles
from aquanav_tools.geometry.mesh.proximity import SurfaceTree, are_within, surface_tree
from aquanav_tools.types import Array, Mesh, Progress, ignore_progress

logger = logging.getLogger(__name__)

SHOWN_VOXELS = 4.0
"""A photo that shows wall farther than this from the scan, voxels, errs there, and nothing is carved for its sake.
Measured along a corridor: of wall up to 4 m from the camera 0.5 %, at 9 m and more 25 %; of what made a tunnel of 3 m
beyond its end, most (median: 11 voxels)."""
HOLE_VOXELS = 0.3
"""A face is of a hole of the simplified surface when its middle is within this distance of it, voxels."""
SIMPLIFY_VOXELS = 0.1
"""Triangles of the resampled surface are merged where that moves it by no more than this, voxels."""
LEG_VOXELS = 1.5
"""Water that is carved around a blocked leg, voxels ..."""
CARRIED_SHARE = 0.25
"""... and this share of the narrowest portal where cameras were shut out: the vehicle's radius. Where a camera was
carried there is as much room."""
SMOOTHING_VOXELS = (1.5, 3.0, 5.0)
"""Tunnels that nobody scanned are smoothed away with balls of these radii in turn, voxels."""
NOISE_VOXELS = 1.0
"""Tunnels and pillars thinner than this come from noise, voxels."""
MIN_SEEN_SHARE = 0.5
"""A tunnel was scanned when at least this share of the shortest loop around it follows the scan."""
MAX_PLACES = 5
"""Places that a caution names."""

NO_HOLES = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))


@dataclass(frozen=True, eq=False)
class ReconstructionOptions:
    """How to close a scan."""

    voxel: float
    """Size of the grid's cells where the surface is resampled, m."""
    min_portal: float
    """Narrower openings are no portals and are filled with the curvature of the wall around them, m."""
    keep_triangles: bool = True
    """Try caps first. For scans that come as meshes; a surface fitted to points is better resampled, which smooths the
    false handles that noise makes."""
    cuts: tuple[Cut, ...] = ()
    """Where the user ends the cave."""
    accept_open: bool = False
    """Go on where what was scanned may be no cave, and note that among the cautions."""


@dataclass(frozen=True, eq=False)
class ClosedScan:
    """The cavity in a scan, and what it was made from."""

    surface: Surface
    """The scan without what the closing passed by."""
    closed: ClosedSurface
    """The solid before its ends were cut, drawn out to where they are."""
    cavity: Cavity


@dataclass(frozen=True, eq=False)
class _Draft:
    """What the next extraction has to respect."""

    edits: FieldEdits = NO_EDITS
    """Corrections of the sampled field."""
    holes: Mesh = NO_HOLES
    """Invented faces of an earlier extraction that are to continue the curvature of the wall around them."""
    num_smoothed: int = 0
    """How often tunnels were smoothed away since the ends or the known water changed."""
    unsmoothed: FieldEdits = NO_EDITS
    """The corrections before tunnels were last smoothed away ..."""
    num_spurious: float = np.inf
    """... and how many there were with them."""
    ends: tuple[End, ...] | None = None
    """Where the passage is open; None until that was looked for."""
    dry: FreeSpace = NONE_KNOWN
    """Known water that is in rock before the ends are cut."""
    is_dug: bool = False
    """Whether known water that was sealed was dug free."""

    def is_worse(self, num_spurious: int) -> bool:
        """Return whether the last smoothing made more tunnels than it closed: large balls do where wall is ragged."""
        return num_spurious > self.num_spurious and len(self.edits.legs) == len(self.unsmoothed.legs)


@dataclass(frozen=True, eq=False)
class _Scan:
    """What stays the same in all extractions."""

    surface: Surface
    free_space: FreeSpace
    options: ReconstructionOptions
    tree: SurfaceTree
    """Over the triangles of the scan."""
    cache: TileCache = field(default_factory=TileCache)
    """Tiles that were sampled so far."""
    accepted: dict[str, str] = field(default_factory=dict)
    """Cautions about what the user accepts, by code."""

    @cached_property
    def water(self) -> ImplicitField:
        """The field of the water in the scan."""
        return implicit_field(self.surface.mesh, self.options.voxel, self.free_space.sight)

    def accept(self, error: UnseenWallsError) -> None:
        """Raise an error, or note it where the user accepts open walls."""
        if not self.options.accept_open:
            raise error
        self.accepted.setdefault(*error.caution)


def close_scan(
    surface: Surface,
    options: ReconstructionOptions,
    free_space: FreeSpace = NONE_KNOWN,
    progress: Progress = ignore_progress,
) -> ClosedScan:
    """Return the cavity in a prepared scan.

    Args:
        surface: normals out of the water.
        options: see there.
        free_space: what is known to be water.
        progress: called with (parts done, parts in all), from the start again where something has to be corrected.

    Raises:
        MeshError: no space is enclosed, two caves are, or known water cannot be kept.
    """
    scan = _scan(surface, free_space, options)
    closed, draft = _with_caps(scan), _Draft()
    while True:  # it ends: tunnels, ends and sealed water are each corrected a fixed number of times
        if closed is None:
            closed, draft = _extracted(scan, draft, progress)
        elif draft.ends is None:
            closed, draft = _with_ends(scan, draft, closed)
        else:
            found = _cut(scan, draft, closed)
            sealed = draft.dry.chosen(contradictions(found.cavity.mesh, draft.dry, options.voxel))
            if sealed.count and not draft.is_dug:
                closed, draft = None, _dug(draft, sealed, options)
                continue
            if sealed.count:
                scan.accept(_contradiction(sealed))
            cautions = (*found.closed.cautions, *scan.accepted.items())
            return replace(found, closed=replace(found.closed, cautions=cautions))


def close_surface(surface: Mesh, options: ReconstructionOptions, free_space: FreeSpace = NONE_KNOWN) -> ClosedSurface:
    """Return the solid that a surface encloses, before its ends are looked for; see `close_scan`."""
    scan = _scan(Surface(surface, surface.vertices), free_space, options)
    closed, draft = _with_caps(scan), _Draft()
    while closed is None:
        closed, draft = _extracted(scan, draft, ignore_progress)
    return closed


def _scan(surface: Surface, free_space: FreeSpace, options: ReconstructionOptions) -> _Scan:
    """Return what stays the same in all extractions; of what cameras saw, only what fits the scan."""
    tree, distance = surface_tree(surface.mesh), SHOWN_VOXELS * options.voxel
    if free_space.sight is not None:
        sight = believed(free_space.sight, lambda places: are_within(tree, places, distance))
        free_space = replace(free_space, sight=sight)
    return _Scan(surface, free_space, options, tree)


def _with_caps(scan: _Scan) -> ClosedSurface | None:
    """Return a sound surface closed exactly; None where it is better resampled."""
    options = scan.options
    if not options.keep_triangles:
        return None
    try:
        capped = cap_holes(scan.surface.mesh, options.min_portal)
    except MeshError as reason:
        logger.info("Caps do not close the surface (%s); resampling it at %.3g m", reason, options.voxel)
        return None
    if contradictions(capped.mesh, scan.free_space, options.voxel).count:
        logger.info("Caps seal a place that is known to be water; resampling at %.3g m", options.voxel)
        return None
    return ClosedSurface(capped.mesh, capped.is_scan, "caps")


def _extracted(scan: _Scan, draft: _Draft, progress: Progress) -> tuple[ClosedSurface | None, _Draft]:
    """Return the resampled solid; or None and a draft that corrects its blocked legs and its tunnels."""
    voxel = scan.options.voxel
    waters = water_surface(scan.water, draft.edits, scan.cache, progress)
    mesh, cautions = main_water(waters, scan.surface.mesh, scan.tree, scan.free_space.inside, voxel, scan.accept)
    spurious = _spurious_handles(mesh, scan.tree, voxel)
    if draft.is_worse(len(spurious)):
        return None, replace(draft, edits=draft.unsmoothed, num_spurious=np.inf, num_smoothed=len(SMOOTHING_VOXELS))
    if draft.num_smoothed < len(SMOOTHING_VOXELS):
        blocked = _blocked(mesh, waters, scan.free_space, voxel)
        if len(blocked) or spurious:
            radius = SMOOTHING_VOXELS[draft.num_smoothed] * voxel
            return None, replace(
                draft,
                edits=_with_corrections(draft.edits, blocked, spurious, radius, voxel),
                unsmoothed=draft.edits,
                num_spurious=len(spurious),
                num_smoothed=draft.num_smoothed + 1,
            )
    merged = simplify(_faired(scan, mesh, draft.holes), SIMPLIFY_VOXELS * voxel)
    is_scan = faces_within(merged, scan.tree, SCAN_VOXELS * voxel)
    return ClosedSurface(merged, is_scan, "winding", cautions + _handles_left(spurious)), draft


def _with_ends(scan: _Scan, draft: _Draft, closed: ClosedSurface) -> tuple[ClosedSurface | None, _Draft]:
    """Return the solid and the ends of its passage; None instead of it where they have to be drawn out first."""
    free_space, options = scan.free_space, scan.options
    dry = free_space.chosen(contradictions(closed.mesh, free_space, options.voxel))
    openings = find_openings(closed, options.min_portal, free_space.sight)
    cameras = NO_CAMERAS if free_space.sight is None else free_space.sight.centres
    if options.accept_open:
        openings = without_passed(openings, cameras)
    holes = holes_in_wall(openings, closed.mesh)
    ends = find_ends(openings, closed.mesh, options.voxel, cameras)
    draft = replace(draft, ends=ends, dry=dry)
    columns = tuple(end.column for end in ends if end.column is not None)
    if not columns and (not len(holes.faces) or closed.method != "winding"):
        return closed, draft
    return None, replace(
        draft, edits=replace(draft.edits, columns=columns), holes=holes, num_smoothed=0, num_spurious=np.inf
    )


def _cut(scan: _Scan, draft: _Draft, closed: ClosedSurface) -> ClosedScan:
    """Return the solid with its ends cut, proven."""
    options = scan.options
    kept = without_gaps(scan.surface, closed.mesh, options.voxel)
    tree = scan.tree if kept is scan.surface else None
    max_share = MAX_ACCEPTED_CUT_SHARE if options.accept_open else MAX_CUT_SHARE
    cavity = cut_portals(closed, kept.mesh, draft.ends or (), options.voxel, options.cuts, scan.accept, max_share, tree)
    return ClosedScan(kept, closed, cavity)


def _dug(draft: _Draft, sealed: FreeSpace, options: ReconstructionOptions) -> _Draft:
    """Return a draft in which water that an end or a missing ceiling shut out is dug free; ends are sought anew."""
    radius = LEG_VOXELS * options.voxel
    if sealed.sight is not None:
        radius = max(radius, CARRIED_SHARE * options.min_portal)
    return _Draft(replace(_carved(draft.edits, sealed.legs, radius), columns=()), is_dug=True)


def _carved(edits: FieldEdits, legs: Array, radius: float) -> FieldEdits:
    """Return edits with water around more (M, 2, 3) legs, m."""
    radii = np.concatenate([edits.leg_radii, np.full(len(legs), radius)])
    return replace(edits, legs=np.concatenate([edits.legs, legs]), leg_radii=radii)


def _faired(scan: _Scan, mesh: Mesh, holes: Mesh) -> Mesh:
    if not len(holes.faces):
        return mesh
    voxel = scan.options.voxel
    is_hole = faces_within(mesh, surface_tree(holes), HOLE_VOXELS * voxel)
    is_hole &= ~faces_within(mesh, scan.tree, SCAN_VOXELS * voxel)
    return fair_holes(mesh, is_hole, voxel)


def _blocked(mesh: Mesh, waters: Mesh, free_space: FreeSpace, voxel: float) -> Array:
    """Return the (M, 2, 3) legs that rock blocks although both their ends lie in water, be it of two bodies."""
    legs = free_space.legs[contradictions(mesh, free_space, voxel).legs]
    dry = contradictions(waters, FreeSpace(legs.reshape(-1, 3)), voxel).points
    blocked: Array = np.delete(legs, np.unique(dry // 2), axis=0)
    return blocked


def _with_corrections(
    before: FieldEdits, blocked: Array, spurious: tuple[Handle, ...], radius: float, voxel: float
) -> FieldEdits:
    """Return the corrections so far and those for newly blocked legs and newly found tunnels."""
    balls = [
        (
            *handle.centre,
            0.5 * handle.length + 2.0 * radius,
            0.0 if handle.diameter < NOISE_VOXELS * voxel else voxel,
        )
        for handle in spurious
    ]
    return replace(
        _carved(before, blocked, LEG_VOXELS * voxel),
        spurious=np.concatenate([before.spurious, np.array(balls).reshape(-1, 5)]),
        smoothing_radius=radius,
    )


def _spurious_handles(mesh: Mesh, tree: SurfaceTree, voxel: float) -> tuple[Handle, ...]:
    """Return the tunnels and pillars of a closed mesh that the scan did not see, or cannot tell from its noise."""
    if 2 * len(mesh.vertices) - len(mesh.faces) == 4:  # Euler: in one piece and without a handle
        return ()
    merged = merge_faces(mesh, np.zeros(len(mesh.faces), dtype=np.int64), SIMPLIFY_VOXELS * voxel)
    return tuple(
        handle
        for handle in find_handles(merged)
        if handle.diameter < NOISE_VOXELS * voxel or are_within(tree, handle.points, voxel).mean() < MIN_SEEN_SHARE
    )


def _handles_left(spurious: tuple[Handle, ...]) -> tuple[tuple[str, str], ...]:
    """Return the caution about tunnels and pillars that could not be smoothed away."""
    if not spurious:
        return ()
    places = ", ".join(
        f"{handle.diameter:.2g} m at {handle.centre.round(1)}" for handle in spurious[-MAX_PLACES:][::-1]
    )
    sentence = (
        f"{len(spurious)} tunnels or pillars that nobody scanned, or that are thinner than a voxel, could not be "
        f"smoothed away (the largest: {places}). A route may lead through them: scan these places again, or give a "
        "larger --voxel."
    )
    return (("spurious-handles", sentence),)


def _contradiction(dry: FreeSpace) -> UnseenWallsError:
    places = [(tuple(place.tolist()), "known water in rock") for place in (*dry.inside, *dry.legs.mean(axis=1))]
    advice = (
        "The scan does not fit them: check that both have the same unit and origin."
        if dry.sight is None
        else "The photos' depths contradict where they were taken. Take more photos there, or from farther apart."
    )
    return UnseenWallsError(
        "known-water-in-rock",
        f"{len(dry.inside)} places and {len(dry.legs)} legs that are known to be water end up in rock, the first at "
        f"{np.round(places[0][0], 2)} m.",
        advice,
        places,
    )
