"""Checking names that a user picks from a list."""

from __future__ import annotations

from collections.abc import Iterable

from aquanav_tools.errors import InputError, did_you_mean


def check_choice(what: str, name: object, known: Iterable[str]) -> None:
    """Raise an InputError with the closest match when `name` is not one of the known names of a `what`."""
    known = list(known)
    if name not in known:
        raise InputError(f"There is no {what} '{name}'.{did_you_mean(str(name), known)}")
