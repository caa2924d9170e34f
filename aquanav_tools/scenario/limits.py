"""How long episodes may last. Light to import: command lines read it."""

from __future__ import annotations

ORIGINAL_DECISIONS = 2400
"""Episode limit of the original benchmark, in decisions of 0.1 s."""
MAX_DECISIONS = 1_000_000
"""Longest episode, in decisions."""
