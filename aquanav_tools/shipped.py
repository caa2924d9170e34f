"""Finding the project's content: the recipes, scenarios and protocols that come with aquanav as plain files.

In a checkout they lie beside the package (`pipelines/`, `scenarios/`, `eval/protocols/`); a wheel carries them inside,
in `aquanav_tools/content/`, under the same names.
"""

from __future__ import annotations

from pathlib import Path

from aquanav_tools.errors import InputError, did_you_mean

_PACKAGE = Path(__file__).resolve().parent
_IN_WHEEL = _PACKAGE / "content"
CONTENT_DIR = _IN_WHEEL if _IN_WHEEL.is_dir() else _PACKAGE.parent
"""Folder that holds pipelines/, scenarios/ and eval/protocols/."""


def shipped_names(folder: str) -> list[str]:
    """Return the sorted names, without ".toml", of the TOML files in a content folder such as "pipelines/build"."""
    return sorted(path.stem for path in (CONTENT_DIR / folder).glob("*.toml"))


def shipped_path(folder: str, name: str) -> Path:
    """Return the TOML file called `name` (without ".toml") in a content folder such as "pipelines/build".

    Raises:
        InputError: there is none of that name; the message has the closest match. Since only listed names are
            taken, no name leads out of the folder.
    """
    known = shipped_names(folder)
    if name not in known:
        raise InputError(f"aquanav ships no '{name}' in {folder}.{did_you_mean(name, known)}")
    return CONTENT_DIR / folder / f"{name}.toml"
