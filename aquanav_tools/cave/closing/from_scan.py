"""From a prepared scan to its cavity: closed, its ends found and cut, and held against what is known to be water.

The surface invented across an end may shut out cameras that stood in it. They are judged only after the end was drawn
out past them; what is in rock then was sealed, and is dug free along the legs that lead there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.closing.close import ClosedSurface, Closer
from aquanav_tools.cave.closing.ends import NO_CAMERAS, find_ends
from aquanav_tools.cave.closing.evidence import NO_EVIDENCE, Evidence, contradictions
from aquanav_tools.cave.closing.openings import find_openings, holes_in_wall
from aquanav_tools.cave.closing.portals import MAX_ACCEPTED_CUT_SHARE, MAX_CUT_SHARE, Cut, cut_portals
from aquanav_tools.cave.scan.surface import Surface, without_gaps
from aquanav_tools.errors import UnseenWallsError
from aquanav_tools.types import Progress, ignore_progress


@dataclass(frozen=True, eq=False)
class ClosedScan:
    """The cavity in a scan, and what it was made from."""

    surface: Surface
    """The scan without what the closing passed by."""
    closed: ClosedSurface
    """The solid before its ends were cut, drawn out to where they are."""
    cavity: Cavity


def close_scan(
    surface: Surface,
    voxel: float,
    *,
    keep_triangles: bool,
    min_portal: float,
    cuts: tuple[Cut, ...] = (),
    evidence: Evidence = NO_EVIDENCE,
    accept_open: bool = False,
    progress: Progress = ignore_progress,
) -> ClosedScan:
    """Return the cavity in a prepared scan.

    Args:
        surface: normals out of the water.
        voxel: size of the grid's cells where the surface is resampled, m.
        keep_triangles: try lids first; see `close_surface`.
        min_portal: narrower openings are no portals, m.
        cuts: where the user ends the cave.
        evidence: what is known to be water.
        accept_open: go on where what was scanned may be no cave, and note that among the cautions.
        progress: called with (parts done, parts in all), from the start again where water has to be dug free.

    Raises:
        MeshError: no space is enclosed, two caves are, or known water cannot be kept.
    """
    accepted: dict[str, str] = {}

    def accept(error: UnseenWallsError) -> None:
        if not accept_open:
            raise error
        accepted.setdefault(*error.caution)

    max_share = MAX_ACCEPTED_CUT_SHARE if accept_open else MAX_CUT_SHARE
    closer = Closer(
        surface.mesh, voxel, keep_triangles=keep_triangles, min_portal=min_portal, evidence=evidence, accept=accept
    )
    cameras = NO_CAMERAS if evidence.sight is None else evidence.sight.centres

    def finish(closed: ClosedSurface) -> ClosedScan:
        openings = find_openings(closed, min_portal, evidence.sight)
        holes = holes_in_wall(openings, closed.mesh)
        ends = find_ends(openings, closed.mesh, voxel, cameras)
        columns = tuple(end.column for end in ends if end.column is not None)
        if columns or (len(holes.faces) and closed.method == "winding"):
            closed = closer.close(columns=columns, holes=holes, progress=progress)
        kept = without_gaps(surface, closed.mesh, voxel)
        cavity = cut_portals(closed, kept.mesh, ends, voxel, cuts, accept, max_share)
        return ClosedScan(kept, replace(closed, cautions=(*closed.cautions, *accepted.items())), cavity)

    closed = closer.close(progress=progress)
    dry = _dry(closed, evidence, voxel)
    scan = finish(closed)
    sealed = dry.chosen(contradictions(scan.cavity.mesh, dry, voxel))
    if not sealed.count:
        return scan
    closed = closer.close(sealed.legs, progress=progress)
    dry = _dry(closed, evidence, voxel)
    if dry.count:
        accept(_contradiction(dry))
    return finish(closed)


def _dry(closed: ClosedSurface, evidence: Evidence, voxel: float) -> Evidence:
    return evidence.chosen(contradictions(closed.mesh, evidence, voxel))


def _contradiction(dry: Evidence) -> UnseenWallsError:
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
