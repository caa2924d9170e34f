"""Reading a survey, whatever its format."""

from __future__ import annotations

from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.survey.image import read_3d
from aquanav_tools.survey.model import Survey
from aquanav_tools.survey.svx import read_svx
from aquanav_tools.survey.therion import read_th

_READERS = {".3d": read_3d, ".svx": read_svx, ".th": read_th}
SURVEY_SUFFIXES = frozenset(_READERS)
"""Endings of files that `read_survey` reads."""


def read_survey(path: Path) -> Survey:
    """Return the survey in a file: Survex image (.3d), Survex data (.svx) or Therion data (.th).

    Raises:
        InputError: the file cannot be read; the message says where and why.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path} ends in '{path.suffix}'; surveys end in {', '.join(sorted(_READERS))}. Rename it.")
    return reader(path)
