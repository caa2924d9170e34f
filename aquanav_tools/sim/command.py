"""What a vehicle's actuators are told for one decision, and the choices that stand for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Command(NamedTuple):
    """What the actuators are told for one decision."""

    ballast: float
    """-1 heavier to 1 lighter; 0 keeps the trim."""
    steer: float
    """-1 right to 1 left."""
    thrust: float
    """-1 reverse to 1 ahead."""


IDLE = Command(0.0, 0.0, 0.0)
NUM_CHOICES = 3
DIVING, AFLOAT = Command._fields, Command._fields[1:]
"""What vehicles under water are told, and boats."""


def command_of(parts: Sequence[str], choices: Sequence[int]) -> Command:
    """Return the command of choices from 0 to 2: the first is up, left and reverse."""
    levels = {
        part: choice - 1.0 if part == "thrust" else 1.0 - choice for part, choice in zip(parts, choices, strict=True)
    }
    return Command(levels.get("ballast", 0.0), levels["steer"], levels["thrust"])
