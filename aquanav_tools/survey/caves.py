"""The caves that a survey file holds: parts under ground that hang together, each named by its survey."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.survey.model import Leg, Survey, shared_levels
from aquanav_tools.types import Array, BoolArray, IntArray

MAX_LEFT_OUT = 0.05
"""With more than this share of the length in other parts, the user must say which one is meant."""
_MAX_NAMED = 20


@dataclass(frozen=True, eq=False)
class SurveyedCave:
    """A part of a survey that no leg under ground joins to the rest."""

    name: str
    """The shortest survey that holds all of it and nothing of the others; else that of its first station."""
    length: float
    """Of its legs, m."""
    stations: BoolArray
    """(S,) flags of the survey's stations in it."""


def caves_in(survey: Survey) -> tuple[SurveyedCave, ...]:
    """Return the caves of a survey, the longest first; none when it has no legs under ground."""
    legs = survey.centreline
    if not legs:
        return ()
    part_of, lengths = _parts(survey, legs)
    parts = [part_of == part for part in np.argsort(-lengths, kind="stable") if lengths[part] > 0.0]
    # Other names of a place, such as that of a fix, name no cave.
    is_end = np.zeros(len(survey.stations), dtype=bool)
    is_end[[end for leg in legs for end in (leg.start, leg.end)]] = True
    surveys = [_shared_survey(survey, stations & is_end) for stations in parts]
    names = [_shortest(own, surveys[:n] + surveys[n + 1 :], survey.separator) for n, own in enumerate(surveys)]
    return tuple(
        SurveyedCave(
            name or _first_name(survey, stations & is_end), float(lengths[part_of[np.argmax(stations)]]), stations
        )
        for name, stations in zip(names, parts, strict=True)
    )


def choose_cave(survey: Survey, name: str = "") -> Survey:
    """Return the part of a survey that a cave's name, or that of any survey in it, stands for.

    Without a name a survey of one cave is returned as it is, small loose parts included.

    Raises:
        InputError: there are several caves and no name, or nothing of that name.
    """
    caves = caves_in(survey)
    if not name:
        total = sum(cave.length for cave in caves)
        if len(caves) > 1 and total - caves[0].length > MAX_LEFT_OUT * total:
            raise InputError(
                f"The survey '{survey.title}' holds {len(caves)} caves that no leg under ground joins: {_list(caves)}. "
                "Choose one with --cave NAME."
            )
        return survey
    for cave in caves:
        if cave.name.lower() == name.lower():
            return _only(survey, cave.stations, cave.name)
    inside = _in_survey(survey, name)
    if not inside.any():
        known = {cave.name for cave in caves} | _surveys(survey)
        raise InputError(
            f"The survey '{survey.title}' holds no cave or survey '{name}'.{did_you_mean(name, known)} "
            f"Its caves: {_list(caves)}."
        )
    return _only(survey, inside, name)


def _parts(survey: Survey, legs: Sequence[Leg]) -> tuple[IntArray, Array]:
    """Return the (S,) connected part of each station, by place, and the length of the legs of each part, m."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    places, place_of = np.unique(survey.positions, axis=0, return_inverse=True)
    place_of = place_of.reshape(-1)
    ends = np.array([(leg.start, leg.end) for leg in legs], dtype=np.int64)
    graph = coo_matrix((np.ones(len(ends)), place_of[ends].T), shape=(len(places), len(places)))
    count, part_of = connected_components(graph, directed=False)
    part_of = part_of.astype(np.int64)[place_of]
    metres = np.linalg.norm(np.diff(survey.positions[ends], axis=1)[:, 0], axis=1)
    return part_of, np.bincount(part_of[ends[:, 0]], metres, count).astype(np.float64)


def _only(survey: Survey, stations: BoolArray, title: str) -> Survey:
    """Return a survey without the legs and passages that leave some of its stations."""
    legs = tuple(leg for leg in survey.legs if stations[leg.start] and (stations[leg.end] or _is_wall(survey, leg)))
    passages = tuple(passage for passage in survey.passages if stations[passage.stations].all())
    return replace(survey, title=title, legs=legs, passages=passages)


def _is_wall(survey: Survey, leg: Leg) -> bool:
    """Return whether a leg ends at a point without a name, as splays do."""
    return not survey.stations[leg.end].name


def _in_survey(survey: Survey, name: str) -> BoolArray:
    start = name.lower() + survey.separator
    return np.array([station.name.lower().startswith(start) for station in survey.stations], dtype=bool)


def _surveys(survey: Survey) -> set[str]:
    """Return the full names of all surveys that hold stations."""
    names = set()
    for station in survey.stations:
        levels = station.name.split(survey.separator)[:-1]
        names |= {survey.separator.join(levels[: n + 1]) for n in range(len(levels))}
    return names


def _shared_survey(survey: Survey, stations: BoolArray) -> list[str]:
    """Return the levels of the innermost survey that holds all named stations of a part."""
    named = (survey.stations[n].name for n in np.flatnonzero(stations))
    return shared_levels((name for name in named if name), survey.separator)


def _shortest(own: list[str], others: Iterable[list[str]], separator: str) -> str:
    """Return the fewest levels of `own` that no other part begins with; all of them where that is not enough."""
    others = list(others)
    for count in range(1, len(own)):
        if all(other[:count] != own[:count] for other in others):
            return separator.join(own[:count])
    return separator.join(own)


def _first_name(survey: Survey, stations: BoolArray) -> str:
    return next((survey.stations[n].name for n in np.flatnonzero(stations) if survey.stations[n].name), "(no name)")


def _list(caves: Sequence[SurveyedCave]) -> str:
    named = ", ".join(f"{cave.name} ({cave.length:.0f} m)" for cave in caves[:_MAX_NAMED])
    return named + (f" and {len(caves) - _MAX_NAMED} more" if len(caves) > _MAX_NAMED else "")
