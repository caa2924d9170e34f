"""The rules of an episode: when it ends, and how."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

COLLISION_RULES = ("continue", "end")
OUTCOMES = ("running", "success", "collision", "timeout", "ended")
"""The last is that of a rule of the user's own."""


@dataclass(frozen=True)
class EpisodeRules:
    """When an episode ends."""

    tolerance: float
    """The goal is reached with this much or less to go along the guide, m."""
    max_decisions: int
    """Then time is up."""
    ends_on_collision: bool
    """Whether the first contact with a wall ends the episode."""


class Episode:
    """What happened so far in one episode."""

    def __init__(self, rules: EpisodeRules) -> None:
        self.outcome = "running"
        """One of OUTCOMES."""
        self.num_decisions = 0
        self.num_collisions = 0
        """Contacts begun: one that lasts counts once, until a whole decision passes without."""
        self._rules = rules
        self._is_touching = False

    def advance(self, touched: Sequence[bool], remaining: float) -> str:
        """Count one decision and return the outcome.

        A contact during the decision comes before the goal at its end.

        Args:
            touched: For each physics step, whether the hull touched a wall.
            remaining: Metres still to go along the guide, after the decision.
        """
        self.num_decisions += 1
        was_touching, self._is_touching = self._is_touching, any(touched)
        self.num_collisions += self._is_touching and not was_touching
        if self._rules.ends_on_collision and self._is_touching:
            self.outcome = "collision"
        elif remaining <= self._rules.tolerance:
            self.outcome = "success"
        elif self.num_decisions >= self._rules.max_decisions:
            self.outcome = "timeout"
        return self.outcome
