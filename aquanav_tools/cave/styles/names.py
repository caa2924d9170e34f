"""The names of styles, apart from what draws them: a name must be read without loading numpy."""

from __future__ import annotations

import hashlib

from aquanav_tools.errors import InputError, did_you_mean

STYLE_NAMES = (
    "phreatic-tube", "vadose-canyon", "bedding-plane", "breakdown-chamber", "shaft-ramp", "maze", "sump-series",
    "flooded-gallery", "mine-drift", "fault-fissure",
)  # fmt: skip
MIXED = "mixed"
"""Stands for a style that the seed picks."""
MAX_SEED = 2**31 - 1


def style_of(style: str, seed: int) -> str:
    """Return the style of a name, picked by the seed where it is MIXED.

    Raises:
        InputError: there is no such style, or the seed is out of range.
    """
    known = [*STYLE_NAMES, MIXED]
    if style not in known:
        raise InputError(f"There is no style '{style}'.{did_you_mean(style, known)} Styles: {', '.join(known)}.")
    if not 0 <= seed <= MAX_SEED:
        raise InputError(f"seed = {seed} is outside 0 to {MAX_SEED}.")
    return style if style != MIXED else STYLE_NAMES[number_of(MIXED, seed) % len(STYLE_NAMES)]


def number_of(style: str, seed: int) -> int:
    """Return a number that no other style and seed share."""
    return int.from_bytes(hashlib.sha256(f"{style}/{seed}".encode()).digest()[:8], "big")
