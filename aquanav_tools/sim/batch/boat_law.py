"""Boats that a law of motion of the user's own moves: what it is told, and where its answers go."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.boat_state import BoatState, FreeMotion
from aquanav_tools.sim.batch.engine import MotionLaw
from aquanav_tools.sim.batch.motion import vec6


class BoatLaw:
    """Asks a law in each physics step, on the processor. It is told nothing of waves and wind."""

    def __init__(self, law: MotionLaw, boats: BoatState, device: Any) -> None:
        """Link a law to all boats of a batch."""
        num = boats.positions.shape[0]
        self.free = FreeMotion()
        """Where boats would go were there no rocks, for the kernels."""
        self.free.positions = wp.zeros(num, dtype=wp.vec3d, device=device)
        self.free.orientations = wp.zeros(num, dtype=wp.vec4d, device=device)
        self.free.velocities = wp.zeros(num, dtype=vec6, device=device)
        self._law = law
        names = ("positions", "orientations", "velocities")
        self._motion = [getattr(boats, name).numpy() for name in names]
        self._free = [getattr(self.free, name).numpy() for name in names]
        self._acting, self._currents, self._held = (
            getattr(boats, name).numpy() for name in ("acting", "currents", "held")
        )

    def ask(self) -> None:
        """Fill `free` for the boats that move."""
        rows = np.flatnonzero(self._held == 0)
        if not len(rows):
            return
        states = np.concatenate([values[rows] for values in self._motion], axis=1)
        moved = self._law(states, self._acting[rows].astype(np.float64), self._currents[rows], rows)
        for values, part in zip(self._free, np.split(moved, (3, 7), axis=1), strict=True):
            values[rows] = part
