"""What the user's own rewards, sensors, rules and disturbances see: arrays with a row per vehicle, read-only."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.errors import did_you_mean

ARRAYS = {
    "positions": "(N, 3) of the vehicles' centres, world frame, m",
    "orientations": "(N, 4) quaternions (w, x, y, z), world from body",
    "velocities": "(N, 6) over ground, body frame: x ahead, y left, z up, m/s; then rates of turn about them, rad/s",
    "currents": "(N, 3) velocity of the water where the decision began, world frame, m/s",
    "clearances": "(N,) from the hull to the nearest wall, m",
    "rays": "(N, R) distances without errors, m",
    "touched": "(N,) physics steps of the decision in contact with a wall",
    "collisions": "(N,) contacts begun in the episode so far",
    "gained": "(N,) way gained towards the goal in the decision, m",
    "remaining": "(N,) way to the goal, m",
    "decisions": "(N,) made in the episode so far; 0 where it has just begun",
    "commands": "(N, 3) of the decision: ballast, steer and thrust, each in [-1, 1]; up, left and ahead are positive",
    "last_commands": "(N, 3) of the decision before; zero at first",
    "observations": "(N, O) of the preset that comes with aquanav",
    "seeds": "(N,) of the episodes",
    "outcomes": "(N,) texts: running, success, collision, timeout or ended",
}
"""Arrays of a `BatchView`, and what is in them."""
MAX_NORMALS = 32
"""Numbers that one definition can draw for a vehicle in a decision."""


class BatchView:
    """N vehicles. Arrays are attributes, `batch.positions`, or `batch.view_of("positions")`; see ARRAYS.

    Beside them: `num` (N), `ray_lengths` ((R,) m) and `decision_seconds`.
    """

    num: int
    ray_lengths: npt.NDArray[np.float64]
    decision_seconds: float

    def __init__(
        self,
        read: Callable[[str], npt.NDArray[Any]],
        num: int,
        ray_lengths: npt.NDArray[np.float64],
        decision_seconds: float,
        rows: Sequence[int] | None = None,
    ) -> None:
        """Show arrays.

        Args:
            read: Returns an array of ARRAYS by its name, with all rows; outcomes as their numbers in OUTCOMES.
            num: Rows.
            ray_lengths: (R,) m.
            decision_seconds: Duration of a decision, s.
            rows: Those to show; None shows all.
        """
        self._read, self._rows = read, rows
        self.num = num if rows is None else len(rows)
        self.ray_lengths, self.decision_seconds = ray_lengths, decision_seconds
        self.stream = 0
        """Tells what one definition draws from what others draw."""

    def __getattr__(self, name: str) -> npt.NDArray[Any]:
        if name.startswith("_"):
            raise AttributeError(name)
        return self.view_of(name)

    def view_of(self, name: str) -> npt.NDArray[Any]:
        """Return an array by its name, which later steps may change.

        Raises:
            AttributeError: there is none of the name; the nearest is named.
        """
        if name not in ARRAYS:
            raise AttributeError(f"a batch has no array '{name}'.{did_you_mean(name, ARRAYS)}")
        array = self._read(name)
        if name == "outcomes":
            array = np.array(OUTCOMES)[array]
        elif name == "seeds":
            array = array.astype(np.uint32)
        array = array.view() if self._rows is None else array[list(self._rows)]
        array.flags.writeable = False
        return array

    def normals(self, count: int) -> npt.NDArray[np.float64]:
        """Return (N, count) standard normal numbers that depend on the episode's seed, the decision and who asks alone.

        So an episode is the same in any batch. Asking twice in one decision gives the same numbers.
        """
        if not 1 <= count <= MAX_NORMALS:
            raise ValueError(f"normals({count}): a definition draws 1 to {MAX_NORMALS} numbers per decision")
        from aquanav_tools.sim.batch.random import draw_many

        seeds, decisions = self.seeds, self.decisions
        words = np.array([draw_many(seeds, self.stream + n, decisions) for n in range(2 * count)])
        uniform = ((words + 0.5) / 2.0**32).reshape(2, count, self.num)
        return (np.sqrt(-2.0 * np.log(uniform[0])) * np.cos(2.0 * np.pi * uniform[1])).T  # Box and Muller

    def only(self, rows: Sequence[int]) -> BatchView:
        """Return the view of some of the vehicles."""
        chosen = rows if self._rows is None else [self._rows[row] for row in rows]
        view = BatchView(self._read, self.num, self.ray_lengths, self.decision_seconds, chosen)
        view.stream = self.stream
        return view


def stream_of(name: str) -> int:
    """Return the purpose from which a definition of some name counts what it draws, by the name alone.

    The highest of its 32 bits is set: all that the vehicles themselves draw lies below (`sim.batch.random`). The lowest
    six are not: there is room for 32 numbers per decision.
    """
    return (zlib.crc32(name.encode()) | 1 << 31) & ~63
