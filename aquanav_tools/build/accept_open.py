"""Refused, or gone on with all the same by --accept-open: what is known of the walls may be of no cave."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquanav_tools.build.journal import Journal
from aquanav_tools.cave.closing.ambient_occlusion import ambient_occlusion, check_occlusion
from aquanav_tools.cave.options import ClosingOptions
from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.cave.scan.surface import Surface, surface_from_mesh
from aquanav_tools.errors import UnseenWallsError
from aquanav_tools.types import Array, Mesh, PointCloud


def accepting(options: ClosingOptions, journal: Journal) -> Callable[[UnseenWallsError], None]:
    """Return what raises an error about unseen walls, or where --accept-open goes on all the same, notes a warning."""

    def accept(error: UnseenWallsError) -> None:
        if not options.accept_open:
            raise error
        if error.code not in {code for code, _ in journal.notices}:
            journal.warn(*error.caution)

    return accept


def noting_guesswork(journal: Journal) -> Callable[[UnseenWallsError], None]:
    """Return what notes that little wall was seen from the widest places of a cavity that photos were taken in.

    That they were taken in one was told from where the cameras were. The widest places are often where wall is missing
    and the closing bulges out: of a workshop of which the cameras saw 89 % of the view all around, 42 %.
    """

    def note(error: UnseenWallsError) -> None:
        sides = "; ".join(f"({', '.join(f'{value:.1f}' for value in place)}) m: {what}" for place, what in error.places)
        journal.warn(
            "guessed-space",
            f"Where the cavity is widest much wall was not seen, so how far it reaches there is guesswork: {sides}. "
            "Wall that no photo saw is marked as unobserved. Take photos of it, or end the cave before it with --cut.",
        )

    return note


def median_occlusion(surface: Mesh, places: Array, accept: Callable[[UnseenWallsError], None]) -> float:
    """Return the median share of the view from (N, 3) places in the water that is scanned wall."""
    try:
        return check_occlusion(surface, places, "the middle of the passage")
    except UnseenWallsError as error:
        accept(error)
    return float(np.median(ambient_occlusion(surface, places)))


def surface_of(
    scan: Mesh | PointCloud, voxel: float, lamps: Array, accept: Callable[[UnseenWallsError], None]
) -> Surface:
    """Return the open surface in a scan; arguments as of `surface_from_cloud`, errors as `accept` decides."""
    if isinstance(scan, Mesh):
        return surface_from_mesh(scan, voxel, lamps)
    try:
        return surface_from_cloud(scan, voxel, lamps)
    except UnseenWallsError as error:
        accept(error)
    return surface_from_cloud(scan, voxel, lamps, accept_thick=True)
