"""Lists that users write: CSV files with a line of column names."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.text_files import read_text
from aquanav_tools.types import Array


@dataclass(frozen=True)
class Row:
    """One line of a list."""

    cells: dict[str, str]
    place: str
    """File and line, for messages."""

    def numbers(self, columns: str) -> Array:
        """Return the (C,) numbers in columns named by words.

        Raises:
            InputError: a cell holds something else than a finite number.
        """
        names = columns.split()
        try:
            values = np.array([float(self.cells[name]) for name in names])
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{self.place}: {', '.join(names)} are not {len(names)} numbers ({error}). Correct the line."
            ) from error
        if not np.all(np.isfinite(values)):
            raise InputError(f"{self.place}: {values} is not finite. Correct the line, or remove it.")
        return values


def read_rows(path: Path, columns: Sequence[str], what: str) -> Iterator[Row]:
    """Yield the lines of a CSV file that has at least some columns, in any order.

    Args:
        path: The file.
        columns: Their names.
        what: What a message calls the file.

    Raises:
        InputError: it does not exist, is no text, or lacks a column.
    """
    if not path.is_file():
        raise InputError(f"The {what} {path} does not exist. Give a CSV file that begins with: {','.join(columns)}")
    text = read_text(path, encoding="utf-8-sig")
    try:
        table = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
        lacking = set(columns) - set(table.fieldnames or ())
        if lacking:
            raise InputError(
                f"{path} lacks the columns {', '.join(sorted(lacking))}; its first line is {table.fieldnames}. "
                f"The first line must be: {','.join(columns)}"
            )
        for cells in table:
            yield Row(cells, f"{path}, line {table.line_num}")
    except csv.Error as error:
        raise InputError(f"{path} is no CSV file: {error}. Save it as CSV in UTF-8.") from error
