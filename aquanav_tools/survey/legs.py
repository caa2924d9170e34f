"""A survey's stations and legs under ground, for drawings and export: names as short as tells them apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.survey.model import StationFlag, Survey, shared_levels
from aquanav_tools.survey.passage_graph import passage_graph
from aquanav_tools.types import Array, BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class SurveyLegs:
    """The connected passages of a survey."""

    names: tuple[str, ...]
    """Of each station, without the surveys that all of them are in; empty where anonymous."""
    positions: Array
    """(N, 3) m."""
    legs: IntArray
    """(M, 2) stations at both ends."""
    is_entrance: BoolArray
    """(N,)"""

    @property
    def segments(self) -> Array:
        """(M, 2, 3) both ends of the legs, m."""
        ends: Array = self.positions[self.legs]
        return ends

    @property
    def num_neighbours(self) -> IntArray:
        """(N,) legs that meet at each station: 1 at the end of a passage, 3 and more at a junction."""
        return np.bincount(self.legs.ravel(), minlength=len(self.positions))


def survey_legs(survey: Survey, offset: Array) -> SurveyLegs:
    """Return the stations and legs that `passage_graph` joins, moved by -offset (m).

    Raises:
        InputError: the survey has no legs under ground.
    """
    graph = passage_graph(survey)
    names, is_entrance = [""] * len(graph.nodes), np.zeros(len(graph.nodes), dtype=bool)
    is_end = {end for leg in survey.centreline for end in (leg.start, leg.end)}
    for index, (station, node) in enumerate(zip(survey.stations, graph.node_of.tolist(), strict=True)):
        if node >= 0:
            names[node] = names[node] or (station.name if index in is_end else "")
            is_entrance[node] |= bool(station.flags & StationFlag.ENTRANCE)
    short = _without_shared(names, survey.separator)
    return SurveyLegs(short, graph.nodes - offset, graph.legs, is_entrance)


def _without_shared(names: list[str], separator: str) -> tuple[str, ...]:
    """Return names without the levels that all of them begin with."""
    shared = len(shared_levels((name for name in names if name), separator))
    return tuple(separator.join(name.split(separator)[shared:]) if name else "" for name in names)
