"""What an episode leaves behind, in arrays, for metrics, plots, pictures and recordings."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.types import Array, BoolArray, IntArray

FAILED = "failed"
"""Outcome of an episode in which the policy gave no action: it raised an error, hung, or gave what is no action."""


@dataclass(frozen=True, eq=False)
class TrajectorySummary:
    """Where an episode led: a row per state (the reset and every decision), so D decisions have D + 1 rows."""

    seed: int
    """Seed the environment was reset with."""
    start_index: int
    """Which of the scenario's starts."""
    outcome: str
    """How it ended: success, collision, timeout, or FAILED."""
    times: Array
    """(D + 1,) seconds since the reset."""
    positions: Array
    """(D + 1, 3) world, m."""
    clearances: Array
    """(D + 1,) from the hull to the nearest wall, m."""
    collided: BoolArray
    """(D + 1,) whether the hull touched the wall since the state before."""
    progress: Array
    """(D + 1,) metres along the guide."""
    num_collisions: int
    """Separate contacts with the wall, as the environment counts them."""

    @property
    def contact_states(self) -> IntArray:
        """(C,) indices of the states in which the hull touches the wall and did not one state before."""
        return np.flatnonzero(self.collided & ~np.concatenate([[False], self.collided[:-1]]))


@dataclass(frozen=True, eq=False)
class Trajectory(TrajectorySummary):
    """All about one episode; a row per decision for actions and rewards.

    Decision k leads from state k to state k + 1.
    """

    orientations: Array
    """(D + 1, 4) quaternions (w, x, y, z), body to world."""
    velocities: Array
    """(D + 1, 6) over ground, body frame, m/s and rad/s."""
    currents: Array
    """(D + 1, 3) velocity of the water where the vehicle was, world, m/s."""
    rays: Array
    """(D + 1, R) range measured along each ray, m."""
    costs: Array
    """(D + 1,) safety cost of the decision before; 0 at the reset."""
    actions: Array
    """(D, A) as given to the environment."""
    commands: Array
    """(D, 3) ballast, steer and thrust that the actions ask for, each in [-1, 1]."""
    rewards: Array
    """(D,) reward of each decision."""
    reward_terms: dict[str, Array]
    """(D,) per term of the reward."""
    reason: str = ""
    """Why the policy failed; empty unless it did."""
    interventions: int | None = None
    """Decisions in which a safety shield took another action than the policy's; None without a shield."""
    dynamics: dict[str, float] = field(default_factory=dict)
    """What the episode drew of its vehicle's dynamics, by name (`sim.randomisation`); nothing without a
    randomisation."""

    @property
    def num_decisions(self) -> int:
        """Decisions taken."""
        return len(self.rewards)

    @property
    def path_length(self) -> float:
        """Length of the way travelled, m."""
        return length_of(self.positions)
