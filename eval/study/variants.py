"""What the paper varied: each variant a shipped pipeline, and each question two of them side by side."""

from __future__ import annotations

from dataclasses import dataclass

VARIANTS = {
    "curriculum": "paper",
    "end-to-end": "paper-end-to-end",
    "clip-0.1": "paper-clip-01",
    "clip-0.2": "paper-clip-02",
    "sparse": "paper-sparse",
    "safe": "paper-safe",
}
"""Pipelines by the names that the page gives them. The curriculum has the dense reward, and clips at 0.2, then 0.1."""

CAVES = ("cave-test-1", "cave-test-2", "cave-test-3", "han")
"""Where every policy is scored; the last is the scan of Han-sur-Lesse."""

CURRENTS = {"still": 0.0, "half": 0.5, "full": 1.0}
"""Shares of each cave's full current."""


@dataclass(frozen=True)
class Question:
    """Two variants that differ in one thing."""

    title: str
    first: str
    second: str
    claim: str
    """What the paper concludes, put as the advantage of the first."""


QUESTIONS = (
    Question("Curriculum or end to end", "curriculum", "end-to-end", "it makes policies safer, and they generalise"),
    Question("Clip range 0.1 or 0.2", "clip-0.1", "clip-0.2", "small updates learn more steadily"),
    Question("Dense or sparse reward", "curriculum", "sparse", "without a dense reward learning does not converge"),
    Question("Safe or standard reward", "safe", "curriculum", "a price on nearness keeps policies off the walls"),
)
