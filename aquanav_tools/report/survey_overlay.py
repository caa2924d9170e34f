"""The stations and legs of the survey that a cave was made from, drawn into its plan and sections."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.labels import Labels
from aquanav_tools.survey.legs import SurveyLegs
from aquanav_tools.types import Array, BoolArray, IntArray

LEG: dict[str, Any] = {"color": "#8a4b2a", "linewidth": 0.7}
SURVEY_STATION: dict[str, Any] = {
    "marker": "^", "markerfacecolor": "#8a4b2a", "markeredgecolor": "white", "markeredgewidth": 0.3, "linestyle": "",
}  # fmt: skip
NAME: dict[str, Any] = {"color": "#8a4b2a", "fontsize": 6.5}
MAX_STRETCH = 2.0
"""A long section draws a leg longer than it is where the route winds beside it, at most by this factor."""
NAMED_EVERY_PT = 40.0
"""No two names stand closer than this, points, so that the passage can still be seen behind them."""

Project = Callable[[Array], Array]


def draw_legs(axes: Any, survey: SurveyLegs, shown: BoolArray, project: Project) -> None:
    """Draw the legs whose stations are both shown, and these stations; `shown` has a flag (N,) per station."""
    from matplotlib.collections import LineCollection

    places = project(survey.positions)
    legs = survey.legs[shown[survey.legs].all(axis=1)]
    # A leg that is much longer on the drawing jumps from one stretch of the route to another.
    drawn = np.linalg.norm(np.diff(places[legs], axis=1)[:, 0], axis=1)
    legs = legs[drawn <= MAX_STRETCH * np.linalg.norm(np.diff(survey.positions[legs], axis=1)[:, 0], axis=1)]
    axes.add_collection(LineCollection(list(places[legs]), colors=LEG["color"], linewidths=LEG["linewidth"], zorder=2))
    axes.plot(*places[shown].T, **SURVEY_STATION, markersize=3, zorder=3, clip_on=False)


def name_stations(labels: Labels, survey: SurveyLegs, shown: BoolArray, project: Project) -> None:
    """Write names where there is room: entrances first, then ends and junctions of passages, then every other one."""
    places = project(survey.positions)
    for station in _by_importance(survey):
        if shown[station] and survey.names[station]:
            labels.add(places[station], survey.names[station], must=False, apart=NAMED_EVERY_PT, **NAME)


def in_profile(cave: CaveMap, survey: SurveyLegs, along: Array, floor: Array, ceiling: Array) -> BoolArray:
    """Return the (N,) flags of stations in the passage that the route takes, as a long section shows it.

    Args:
        cave: the route and its sections.
        survey: the stations.
        along: (P,) distances along the route at which floor and ceiling are known, m.
        floor: (P,) height of the floor, m.
        ceiling: (P,) height of the ceiling, m.
    """
    from scipy.spatial import cKDTree

    beside, nearest = cKDTree(cave.centreline).query(survey.positions)
    here = cave.along(survey.positions)
    widths = [section.width for section in cave.sections]
    reach = np.interp(here, [section.arc_length for section in cave.sections], widths)
    heights = survey.positions[:, 2]
    is_between = (heights >= np.interp(here, along, floor)) & (heights <= np.interp(here, along, ceiling))
    is_along: BoolArray = is_between & (beside <= np.maximum(reach, np.abs(heights - cave.centreline[nearest, 2])))
    return is_along


def _by_importance(survey: SurveyLegs) -> IntArray:
    """Return the stations in the order in which their names are worth the room."""
    meets = survey.num_neighbours
    rank = np.where(survey.is_entrance, 0, np.where(meets >= 3, 1, np.where(meets == 1, 2, 3)))
    order: IntArray = np.argsort(rank, kind="stable")
    return order
