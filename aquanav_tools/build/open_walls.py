"""Going on, where --accept-open says so, with a cave of whose wall too little was seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquanav_tools.build.journal import Journal
from aquanav_tools.cave.closing.enclosure import check_enclosure, enclosure
from aquanav_tools.cave.options import ClosingOptions
from aquanav_tools.errors import UnseenWallsError
from aquanav_tools.types import Array, Mesh


def accepting(options: ClosingOptions, journal: Journal) -> Callable[[UnseenWallsError], None]:
    """Return what raises an error about unseen walls, or where --accept-open goes on all the same, notes a warning."""

    def accept(error: UnseenWallsError) -> None:
        if not options.accept_open:
            raise error
        if error.code not in {code for code, _ in journal.notices}:
            journal.warn(*error.caution)

    return accept


def seen_share(surface: Mesh, places: Array, accept: Callable[[UnseenWallsError], None]) -> float:
    """Return the median share of the view from (N, 3) places in the water that is scanned wall."""
    try:
        return check_enclosure(surface, places, "the middle of the passage")
    except UnseenWallsError as error:
        accept(error)
    return float(np.median(enclosure(surface, places)))
