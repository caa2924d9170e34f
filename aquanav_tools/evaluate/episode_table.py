"""Episodes in columns: as objects they would take 3 kB each, and an evaluation may have a million."""

from __future__ import annotations

import dataclasses
from array import array
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np

from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.types import Array, BoolArray, IntArray

DIGEST_LENGTH = 64
"""Of a SHA-256 in hexadecimal digits."""
DYNAMICS = "dynamics/"
"""Before a name in the columns of what was drawn of the vehicle's dynamics."""
_TYPES = {field.name: str(field.type) for field in dataclasses.fields(EpisodeMetrics) if field.name != "dynamics"}
_CODES = {"float": "d", "float | None": "d", "int": "q", "int | None": "d", "str": "i"}
"""How a column is kept. Texts are numbered; where a number is missing, nan stands for it."""


class EpisodeTable(Sequence[EpisodeMetrics]):
    """A sequence of episodes, 0.3 kB each."""

    def __init__(self, episodes: Iterable[EpisodeMetrics] = ()) -> None:
        kinds = {name: kind for name, kind in _TYPES.items() if name != "digest"}
        self._columns: dict[str, array[Any]] = {name: array(_CODES[kind]) for name, kind in kinds.items()}
        texts = [name for name, kind in kinds.items() if kind == "str"]
        self._texts: dict[str, list[str]] = {name: [] for name in texts}
        self._numbers: dict[str, dict[str, int]] = {name: {} for name in texts}
        self._drawn: dict[str, array[Any]] = {}
        """Of each of the vehicle's dynamics that was drawn in any episode; nan in those that did not draw it."""
        self._digests = bytearray()
        self._num = 0
        for episode in episodes:
            self.append(episode)

    def __len__(self) -> int:
        return self._num

    @overload
    def __getitem__(self, place: int) -> EpisodeMetrics: ...
    @overload
    def __getitem__(self, place: slice) -> list[EpisodeMetrics]: ...
    def __getitem__(self, place: int | slice) -> EpisodeMetrics | list[EpisodeMetrics]:
        places = range(self._num)[place]
        return [self._row(one) for one in places] if isinstance(places, range) else self._row(places)

    def __iter__(self) -> Iterator[EpisodeMetrics]:
        return map(self._row, range(self._num))

    def append(self, episode: EpisodeMetrics) -> None:
        """Add an episode at the end.

        Raises:
            ValueError: its digest is longer than that of a SHA-256.
        """
        digest = episode.digest.encode()
        if len(digest) > DIGEST_LENGTH:
            raise ValueError(f"A digest has at most {DIGEST_LENGTH} characters, not {len(digest)}.")
        self._digests += digest.ljust(DIGEST_LENGTH)
        for name, column in self._columns.items():
            value = getattr(episode, name)
            if name in self._texts:
                value = self._number(name, value)
            column.append(np.nan if value is None else value)
        for name in episode.dynamics.keys() - self._drawn.keys():
            self._drawn[name] = array("d", [np.nan]) * self._num
        for name, column in self._drawn.items():
            column.append(episode.dynamics.get(name, np.nan))
        self._num += 1

    def column(self, name: str) -> Array:
        """Return (N,) values of a metric; nan where an episode lacks it, and of texts their numbers."""
        if name.startswith(DYNAMICS):
            return np.array(self._drawn[name.removeprefix(DYNAMICS)])
        return np.array(self._columns[name])

    @property
    def drawn(self) -> list[str]:
        """Names of what any episode drew of its vehicle's dynamics, in alphabetical order."""
        return sorted(self._drawn)

    def names(self, name: str) -> list[str]:
        """Return the different texts in a column, in the order in which they first came."""
        found, first = np.unique(self.column(name), return_index=True)
        return [self._texts[name][code] for code in found[np.argsort(first)]]

    def are(self, name: str, text: str) -> BoolArray:
        """Return (N,) whether episodes have a text in a column."""
        same: BoolArray = self.column(name) == self._numbers[name].get(text, -1)
        return same

    def rows(self, which: IntArray | BoolArray) -> EpisodeTable:
        """Return the episodes at some places, or those where a mask holds."""
        found = EpisodeTable()
        for name, column in self._columns.items():
            found._columns[name] = array(column.typecode, np.array(column)[which].tobytes())
        found._drawn = {name: array("d", np.array(column)[which].tobytes()) for name, column in self._drawn.items()}
        digests = np.frombuffer(bytes(self._digests), dtype=f"V{DIGEST_LENGTH}")[which]
        found._digests, found._num = bytearray(digests.tobytes()), len(digests)
        found._texts, found._numbers = self._texts, self._numbers
        return found

    def distinct(self) -> EpisodeTable:
        """Return the first of each lot of episodes that are the same to the bit."""
        keys = np.zeros(self._num, dtype=[("scenario", "i4"), ("digest", f"S{DIGEST_LENGTH}")])
        keys["scenario"] = self.column("scenario")
        keys["digest"] = np.frombuffer(bytes(self._digests), dtype=f"S{DIGEST_LENGTH}")
        _, first = np.unique(keys, return_index=True)
        return self if len(first) == self._num else self.rows(np.sort(first))

    def _number(self, name: str, text: str) -> int:
        """Return the number of a text in a column, a new one for a text that is new there."""
        numbers, texts = self._numbers[name], self._texts[name]
        if text not in numbers:
            numbers[text] = len(texts)
            texts.append(text)
        return numbers[text]

    def _row(self, place: int) -> EpisodeMetrics:
        start = place * DIGEST_LENGTH
        values: dict[str, Any] = {"digest": self._digests[start : start + DIGEST_LENGTH].decode().rstrip()}
        for name, column in self._columns.items():
            values[name] = self._as_value(name, column[place])
        # In an order that does not depend on which episode ended first.
        values["dynamics"] = {name: value for name in self.drawn if not np.isnan(value := self._drawn[name][place])}
        return EpisodeMetrics(**values)

    def _as_value(self, name: str, value: float) -> Any:
        """Return a value as it was given."""
        kind = _TYPES[name]
        if kind == "str":
            return self._texts[name][int(value)]
        if "None" in kind and np.isnan(value):
            return None
        return int(value) if kind.startswith("int") else value
