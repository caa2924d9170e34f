"""The centreline as a graph: where the passages run and how they hang together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.survey.model import Survey
from aquanav_tools.types import Array, IntArray

MIN_LEG = 0.01
"""Legs shorter than this, m, join two names of one place."""


@dataclass(frozen=True, eq=False)
class PassageGraph:
    """Nodes are places; several stations may share one."""

    nodes: Array
    """(N, 3) m."""
    legs: IntArray
    """(M, 2) nodes, each pair once."""
    node_of: IntArray
    """(S,) node of each station of the survey, -1 where no passage leads to it."""
    others: tuple[str, ...]
    """A station of each smaller part that hangs together with nothing else, and was left out."""

    @property
    def segments(self) -> Array:
        """(M, 2, 3) ends of the legs, m."""
        ends: Array = self.nodes[self.legs]
        return ends

    @property
    def lengths(self) -> Array:
        """(M,) m."""
        ends = self.segments
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)

    def neighbours(self, node: int) -> Array:
        """Return the (K, 3) positions of the nodes that a leg joins to this one."""
        others = np.concatenate([self.legs[self.legs[:, 0] == node, 1], self.legs[self.legs[:, 1] == node, 0]])
        positions: Array = self.nodes[others]
        return positions


def passage_graph(survey: Survey) -> PassageGraph:
    """Return the largest connected part of a survey's centreline.

    Raises:
        InputError: the survey has no legs under ground.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    pairs = np.array([(leg.start, leg.end) for leg in survey.centreline], dtype=np.int64).reshape(-1, 2)
    if not len(pairs):
        raise InputError(
            f"The survey '{survey.title}' has {len(survey.legs)} legs, none of them along a passage under ground. "
            "A cave needs legs that are neither splays nor flagged as surface."
        )
    places, place_of = np.unique(survey.positions, axis=0, return_inverse=True)
    legs = np.unique(np.sort(place_of.reshape(-1)[pairs], axis=1), axis=0)
    lengths = np.linalg.norm(places[legs[:, 1]] - places[legs[:, 0]], axis=1)
    graph = coo_matrix((np.ones(len(legs)), legs.T), shape=(len(places), len(places)))
    count, part_of = connected_components(graph, directed=False)
    sizes = np.bincount(part_of[legs[:, 0]], weights=lengths, minlength=count)
    largest = int(sizes.argmax())
    legs = legs[(part_of[legs[:, 0]] == largest) & (lengths >= MIN_LEG)]
    used = np.unique(legs)
    new_index = np.full(len(places), -1, dtype=np.int64)
    new_index[used] = np.arange(len(used))
    others = _names_of_parts(survey, part_of[place_of.reshape(-1)], np.flatnonzero(sizes > 0), largest)
    return PassageGraph(places[used], new_index[legs], new_index[place_of.reshape(-1)], others)


def _names_of_parts(survey: Survey, part_of: IntArray, parts: IntArray, largest: int) -> tuple[str, ...]:
    names: dict[int, str] = {}
    for station, part in zip(survey.stations, part_of.tolist(), strict=True):
        if part != largest and station.name:
            names.setdefault(part, station.name)
    return tuple(names.get(int(part), "(no name)") for part in parts if part != largest)
