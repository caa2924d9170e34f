"""The rules of an episode: when it ends, and how."""

from __future__ import annotations

COLLISION_RULES = ("continue", "end")
OUTCOMES = ("running", "success", "collision", "timeout", "ended")
"""The last is that of a rule of the user's own."""
