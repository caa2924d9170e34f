"""Finding the project's content: the recipes, scenarios, protocols and policies that come with aquanav as files.

In a checkout they lie beside the package (`pipelines/`, `scenarios/`, `eval/`); a wheel carries them inside,
in `aquanav_tools/content/`, under the same names.
"""

from __future__ import annotations

import re
from pathlib import Path

from aquanav_tools.errors import InputError, did_you_mean

_PACKAGE = Path(__file__).resolve().parent
_IN_WHEEL = _PACKAGE / "content"
CONTENT_DIR = _IN_WHEEL if _IN_WHEEL.is_dir() else _PACKAGE.parent
"""Folder that holds pipelines/, scenarios/, eval/protocols/, eval/policies/ and eval/sets/."""


def shipped_names(folder: str, suffix: str = ".toml") -> list[str]:
    """Return the names, without the suffix, of the files in a content folder such as "pipelines/build".

    They are sorted, numbers in them by their size: cave-2 comes before cave-10.
    """
    names = (path.stem for path in (CONTENT_DIR / folder).glob(f"*{suffix}"))
    return sorted(names, key=lambda name: re.sub(r"\d+", lambda number: number[0].zfill(9), name))


def shipped_path(folder: str, name: str, suffix: str = ".toml") -> Path:
    """Return the file called `name` (without the suffix) in a content folder such as "pipelines/build".

    Raises:
        InputError: there is none of that name; the message has the closest match. Since only listed names are
            taken, no name leads out of the folder.
    """
    known = shipped_names(folder, suffix)
    if name not in known:
        raise InputError(f"aquanav ships no '{name}' in {folder}.{did_you_mean(name, known)}")
    return CONTENT_DIR / folder / f"{name}{suffix}"
