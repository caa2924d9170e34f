"""Contact engines and laws of motion outside of the kernels: what they are asked, and how answers reach the kernels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from aquanav_tools.sim.batch.state import ASKED, FREE, MOVED, TOUCHED, UNMOVED, BatchState, ContactExchange
from aquanav_tools.types import Array


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
IS_UNMOVED, IS_MOVED = int(UNMOVED), int(MOVED)
MotionLaw = Callable[[Array, Array, Array, npt.NDArray[np.int64]], Array]
"""Returns the (M, 13) states of vehicles a physics step later were there no wall: position (world, m), quaternion
(w, x, y, z), velocity over ground and rate of turn (body, m/s and rad/s); of their (M, 13) states, (M, 3) commands
(ballast, steer and thrust in [-1, 1]), (M, 3) currents (world, m/s) and (M,) numbers in the batch."""


class EngineLink:
    """Asks engines what the kernels want to know, on the processor."""

    def __init__(
        self,
        engines: Sequence[ContactEngine],
        law: MotionLaw | None,
        state: BatchState,
        exchange: ContactExchange,
    ) -> None:
        """Link an engine to each of N vehicles, or none, and one law to all of them, or none."""
        self._engines, self._law = engines, law
        motion = ("positions", "orientations", "velocities")
        self._motion = [getattr(state, name).numpy() for name in motion]
        self._free = [getattr(exchange, f"free_{name}").numpy() for name in motion]
        self._acting, self._currents = state.acting.numpy(), state.currents.numpy()
        self._restarted = state.restarted.numpy()
        self._status, self._is_continued = exchange.status.numpy(), exchange.is_continued.numpy()
        self._questions, self._answers = exchange.questions.numpy(), exchange.answers.numpy()

    def forget_restarted(self) -> None:
        """Let the engines of vehicles whose episodes have just begun forget their contacts."""
        for n, is_restarted in enumerate(self._restarted.tolist()):
            if is_restarted and self._engines:
                self._engines[n].reset()
                self._is_continued[n] = 0

    def answer(self) -> bool:
        """Answer what kernels have asked; return whether they have."""
        is_asked = self._law is not None and self._move()
        for n, status in enumerate(self._status.tolist()):
            if status == IS_ASKED:
                is_asked = True
                solved = self._engines[n].solve(self._questions[n].tolist(), bool(self._is_continued[n]))
                self._status[n] = IS_FREE if solved is None else IS_TOUCHED
                if solved is not None:
                    self._answers[n] = solved
        return is_asked

    def _move(self) -> bool:
        """Tell kernels by the law where vehicles would go; return whether they have asked."""
        assert self._law is not None
        rows = np.flatnonzero(self._status == IS_UNMOVED)
        if len(rows):
            states = np.concatenate([values[rows] for values in self._motion], axis=1)
            acting = self._acting[rows].astype(np.float64)
            moved = self._law(states, acting, self._currents[rows], rows)
            for values, part in zip(self._free, np.split(moved, (3, 7), axis=1), strict=True):
                values[rows] = part
            self._status[rows] = IS_MOVED
        return bool(len(rows))

    def close(self) -> None:
        """Let go of the engines."""
        for engine in self._engines:
            engine.close()
