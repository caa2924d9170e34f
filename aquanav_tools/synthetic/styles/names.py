"""The names of styles, apart from what draws them: a name must be read without loading numpy."""

from __future__ import annotations

import hashlib

from aquanav_tools.errors import InputError, did_you_mean

FIRST_STYLES = (
    "phreatic-tube", "vadose-canyon", "bedding-plane", "breakdown-chamber", "shaft-ramp", "maze", "sump-series",
    "flooded-gallery", "mine-drift",
)  # fmt: skip
STYLE_NAMES = (*FIRST_STYLES, "fault-fissure", "crawlway")
"""In the order in which they came."""
MIXED = "mixed"
"""Stands for a style that the seed picks, each as often as every other. A style that comes takes its part of the seeds
of all before it; what they keep stays the cave that it was."""
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
    return style if style != MIXED else _picked(seed)


def _picked(seed: int) -> str:
    """Return the style of a mixed seed."""
    for count in range(len(STYLE_NAMES), len(FIRST_STYLES), -1):
        if number_of(f"{MIXED}, {count} styles", seed) % count == 0:
            return STYLE_NAMES[count - 1]
    return FIRST_STYLES[number_of(MIXED, seed) % len(FIRST_STYLES)]


def number_of(style: str, seed: int) -> int:
    """Return a number that no other style and seed share."""
    return int.from_bytes(hashlib.sha256(f"{style}/{seed}".encode()).digest()[:8], "big")
