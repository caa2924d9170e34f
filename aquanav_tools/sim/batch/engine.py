"""Contact engines outside of the kernels: what they are asked, and how their answers reach the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from aquanav_tools.sim.batch.state import ASKED, FREE, TOUCHED, BatchState, ContactExchange


class ContactEngine(Protocol):
    """Says for one vehicle what the wall does to a physics step. It knows nothing of water."""

    margin: float
    """Distance from the hull up to which it keeps contacts, m; farther from the wall it is not asked."""

    def reset(self) -> None:
        """Begin an episode: forget all contacts."""

    def solve(self, question: Sequence[float], is_continued: bool) -> Sequence[float] | None:
        """Move the vehicle for one step.

        Args:
            question: 13 numbers in the world frame: position, quaternion (w, x, y, z), and the velocity and rate of
                turn that lead to where it would go were there no wall.
            is_continued: Whether it is where the last step left it, and its contacts are to go on.

        Returns:
            None where the wall was not touched; else 13 numbers, as above, after the step, as far as the wall lets it.
        """

    def close(self) -> None:
        """Let go of the engine. Closing twice does nothing."""


IS_ASKED, IS_FREE, IS_TOUCHED = int(ASKED), int(FREE), int(TOUCHED)


class EngineLink:
    """Asks engines what the kernels want to know, on the processor."""

    def __init__(self, engines: Sequence[ContactEngine], state: BatchState, exchange: ContactExchange) -> None:
        """Link an engine to each of N vehicles."""
        self._engines = engines
        self._restarted = state.restarted.numpy()
        self._status, self._is_continued = exchange.status.numpy(), exchange.is_continued.numpy()
        self._questions, self._answers = exchange.questions.numpy(), exchange.answers.numpy()

    def forget_restarted(self) -> None:
        """Let the engines of vehicles whose episodes have just begun forget their contacts."""
        for n, is_restarted in enumerate(self._restarted.tolist()):
            if is_restarted:
                self._engines[n].reset()
                self._is_continued[n] = 0

    def answer(self) -> bool:
        """Answer what kernels have asked; return whether they have."""
        is_asked = False
        for n, status in enumerate(self._status.tolist()):
            if status == IS_ASKED:
                is_asked = True
                solved = self._engines[n].solve(self._questions[n].tolist(), bool(self._is_continued[n]))
                self._status[n] = IS_FREE if solved is None else IS_TOUCHED
                if solved is not None:
                    self._answers[n] = solved
        return is_asked

    def close(self) -> None:
        """Let go of the engines."""
        for engine in self._engines:
            engine.close()
