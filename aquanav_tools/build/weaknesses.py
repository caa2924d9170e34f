"""What is poor about a cave but usable, as sentences for the report."""

from __future__ import annotations

from typing import TYPE_CHECKING

from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.source_words import words_for

if TYPE_CHECKING:
    from aquanav_tools.build.cave_stages import BuiltCave

MIN_OBSERVED_SHARE = 0.9
MAX_DROPPED_SHARE = 0.05
MAX_MEDIAN_VOXELS = 0.25
"""Half of the scan lies at most this far from the cavity, and 95 % within a voxel; or the report says so."""


def note_weaknesses(built: BuiltCave, options: BuildOptions, journal: Journal) -> None:
    """Warn of all that a user should look at before trusting a cave."""
    kind = built.scenario.settings.built.kind
    words, statistics, fit, voxel = words_for(kind), built.statistics, built.fit, built.resolution.voxel
    for code, sentence in built.closed.cautions:
        journal.warn(code, sentence)
    if built.surface.dropped_share > MAX_DROPPED_SHARE:
        journal.warn(
            "left-out",
            f"{built.surface.dropped_share:.0%} of the {words.name} was left out: stray objects, outliers, or walls "
            "hidden behind others. If part of the cave is missing, look at the picture.",
        )
    # Of a survey, "modelled-wall" has said how little is measured.
    if statistics.observed_share < MIN_OBSERVED_SHARE and kind != "survey":
        journal.warn(
            "unobserved-wall",
            f"Only {statistics.observed_share:.0%} of the wall was {words.seen}; the rest was {words.filled}. "
            f"{words.advice}.",
        )
    if fit.percentile_95 > voxel or fit.median > MAX_MEDIAN_VOXELS * voxel:
        journal.warn(
            "loose-fit",
            f"Points of the {words.name} lie {fit.median:.3f} m from the cavity (median), 95 % within "
            f"{fit.percentile_95:.3f} m; a voxel is {voxel:.3f} m. Noise or thin walls were smoothed away; look at the "
            "picture.",
        )
    if statistics.num_portals < 2:
        journal.warn(
            "few-portals",
            f"{'One open end was' if statistics.num_portals else 'No open ends were'} found, so the goal is the "
            "farthest place inside the cave. If the "
            f"passage goes on, {words.reopen}.",
        )
    if len(built.scenario.starts) < options.starts.count:
        journal.warn(
            "few-starts",
            f"{len(built.scenario.starts)} of {options.starts.count} starts were found: parts of the way are too tight "
            "to float in.",
        )
