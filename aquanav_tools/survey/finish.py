"""From a field book to a survey: positions adjusted, references checked."""

from __future__ import annotations

import numpy as np

from aquanav_tools.survey.fieldbook import FieldBook
from aquanav_tools.survey.model import Leg, Passage, Station, Survey
from aquanav_tools.survey.network import adjust
from aquanav_tools.types import IntArray


def finish(book: FieldBook, title: str) -> Survey:
    """Return the adjusted survey.

    Args:
        book: filled by a reader.
        title: taken where the book has none.

    Raises:
        InputError: no stations, or some tied to no fixed point.
    """
    positions = adjust(book)
    stations = tuple(
        Station(name, position, flags) for name, position, flags in zip(book.names, positions, book.flags, strict=True)
    )
    legs = tuple(Leg(leg.start, leg.end, leg.flags, leg.length) for leg in book.measurements)
    passages = tuple(
        Passage(_indices([station for station, _ in rows]), np.array([lrud for _, lrud in rows]))
        for rows in book.passages
    )
    return Survey(book.title or title, stations, legs, passages, book.coordinate_system, warnings=tuple(book.warnings))


def _indices(stations: list[int]) -> IntArray:
    return np.array(stations, dtype=np.int64)
