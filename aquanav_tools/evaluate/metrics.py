"""What an episode is worth.

success: the goal was reached, whatever was touched on the way. Collision-free success: reached without touching the
wall once; the headline, as in the original benchmark, where one collision is a failure. infeasible: time ran out where
the way takes longer at the vehicle's top speed, so that no policy could arrive. collisions: separate contacts.
clearance: from the hull to the nearest wall. SPL: success weighted by path length. energy: work done against drag.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from aquanav_tools.evaluate.energy import to_world, water_relative
from aquanav_tools.report.trajectory import FAILED, Trajectory
from aquanav_tools.types import Array

INFEASIBLE = "infeasible"
ENDED = "ended"
"""By a rule of the user's own."""
OUTCOMES = ("success", "collision", "timeout", FAILED, INFEASIBLE, ENDED)
REGIONS = ("first third", "middle third", "last third")
"""Of the route, by the length of the shortest path that is left at the start."""


@dataclass(frozen=True)
class EpisodeReference:
    """What an episode is held against."""

    scenario: str
    condition: str
    """Name of the conditions it ran under."""
    width: float
    """Of the vehicle, m."""
    route_length: float | None
    """Of the guide, m; None where each episode has a path of its own."""
    top_speed: float
    """That the vehicle keeps ahead in still water, m/s."""
    power: Callable[[Array, Mapping[str, float]], Array] | None
    """Power that drag takes from the vehicle, W, at (N, 6) velocities through the water, with the dynamics that were
    drawn; None where it is not known."""
    num_controls: int = 3
    """How many of ballast, steer and thrust it has: a boat the last two."""
    ideal: Callable[[float], float] | None = None
    """Time that a path of some length (m) to the goal takes at best, s; None where that is not known."""


@dataclass(frozen=True, slots=True)
class EpisodeMetrics:
    """One episode in numbers: metres, seconds, joules."""

    index: int
    """Number in the evaluation, from 0."""
    scenario: str
    condition: str
    region: str
    """Where on the route it began: one of REGIONS."""
    seed: int
    start: int
    """Index in the scenario's list of starts; -1 for one drawn anywhere."""
    outcome: str
    """One of OUTCOMES."""
    reason: str
    """Why the policy failed; empty unless it did."""
    collisions: int
    min_clearance: float
    clearance_p5: float
    """5th percentile over time."""
    mean_clearance: float
    time_close: float
    """With less clearance than the vehicle is wide."""
    time: float
    time_ratio: float | None
    """Time over that of the shortest path at the vehicle's top speed in still water; None without success."""
    path_length: float
    geodesic: float
    """Length of the shortest path through the water from the start to the goal."""
    progress: float
    """Along the guide at the end."""
    spl: float
    reward: float
    cost: float
    control_effort: float
    """Mean over decisions of the square of ballast, steer and thrust, each in [-1, 1], over their number: 0 idle to 1
    full. A boat has no ballast."""
    control_change: float
    """Mean over decisions of the change of ballast, steer and thrust from the last decision, in size, over their
    number."""
    energy: float | None
    """Work done against the water's drag; None for boats, whose drag is summed up over a hull among waves."""
    jerk: float
    """Root mean square of the rate of change of acceleration over ground, m/s^3: smaller is smoother."""
    interventions: int | None
    """Decisions in which a safety shield took another action than the policy's; None without a shield."""
    digest: str
    """SHA-256 of its states, actions and rewards: equal only where an episode repeats to the bit."""
    dynamics: dict[str, float] = field(default_factory=dict, hash=False)
    """What it drew of its vehicle's dynamics, by name: `sim.randomisation` has the names and units. Nothing without a
    randomisation."""

    @property
    def is_success(self) -> bool:
        """Whether it reached the goal."""
        return self.outcome == "success"

    @property
    def is_collision_free_success(self) -> bool:
        """Whether it reached the goal and never touched the wall."""
        return self.is_success and self.collisions == 0


def spl(is_success: bool, geodesic: float, path_length: float) -> float:
    """Return success weighted by path length, in [0, 1]: 0 for a failure, 1 for the shortest path.

    Source: Anderson et al., On evaluation of embodied navigation agents, arXiv 1807.06757 (2018).
    """
    return geodesic / max(geodesic, path_length, 1e-9) if is_success else 0.0


def region_of(geodesic: float, route_length: float) -> str:
    """Return which third of a route a start lies in, from the path that is left to the goal."""
    done = 1.0 - geodesic / route_length
    return REGIONS[int(np.clip(done * len(REGIONS), 0, len(REGIONS) - 1))]


def measure(trajectory: Trajectory, geodesic: float, reference: EpisodeReference, index: int = 0) -> EpisodeMetrics:
    """Return the metrics of one episode whose start is `geodesic` metres from the goal."""
    is_success = trajectory.outcome == "success"
    time, steps = float(trajectory.times[-1]), np.diff(trajectory.times)
    commands = trajectory.commands[:, -reference.num_controls :]
    return EpisodeMetrics(
        index=index,
        scenario=reference.scenario,
        condition=reference.condition,
        region=region_of(geodesic, reference.route_length or geodesic),
        seed=trajectory.seed,
        start=trajectory.start_index,
        outcome=_outcome(trajectory, geodesic, reference),
        reason=trajectory.reason,
        collisions=trajectory.num_collisions,
        min_clearance=float(trajectory.clearances.min()),
        clearance_p5=float(np.percentile(trajectory.clearances, 5.0)),
        mean_clearance=float(trajectory.clearances.mean()),
        time_close=float(steps[trajectory.clearances[1:] < reference.width].sum()),
        time=time,
        time_ratio=time * reference.top_speed / max(geodesic, 1e-9) if is_success else None,
        path_length=trajectory.path_length,
        geodesic=geodesic,
        progress=float(trajectory.progress[-1]),
        spl=spl(is_success, geodesic, trajectory.path_length),
        reward=float(trajectory.rewards.sum()),
        cost=float(trajectory.costs.sum()),
        control_effort=_mean(commands**2),
        control_change=_mean(np.abs(np.diff(commands, axis=0))),
        energy=_energy(trajectory, reference),
        jerk=_jerk(trajectory),
        interventions=trajectory.interventions,
        digest=digest_of(trajectory),
        dynamics=dict(trajectory.dynamics),
    )


def _outcome(trajectory: Trajectory, geodesic: float, reference: EpisodeReference) -> str:
    """Return how an episode ended: a timeout is the limit's fault where nothing could have arrived within it."""
    if trajectory.outcome != "timeout" or reference.ideal is None:
        return trajectory.outcome
    return INFEASIBLE if reference.ideal(geodesic) > float(trajectory.times[-1]) else trajectory.outcome


def digest_of(trajectory: Trajectory) -> str:
    """Return the SHA-256 of a trajectory's numbers."""
    total = hashlib.sha256()
    for values in (
        trajectory.positions,
        trajectory.orientations,
        trajectory.velocities,
        trajectory.actions,
        trajectory.rewards,
    ):
        total.update(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    return total.hexdigest()


def _energy(trajectory: Trajectory, reference: EpisodeReference) -> float | None:
    """Return the work done against drag, J: its power from state to state by the trapezoidal rule."""
    if reference.power is None:
        return None
    through_water = water_relative(trajectory.velocities, trajectory.currents, trajectory.orientations)
    power = reference.power(through_water, trajectory.dynamics)
    return float((0.5 * (power[1:] + power[:-1]) * np.diff(trajectory.times)).sum())


def _jerk(trajectory: Trajectory) -> float:
    """Return the root mean square of the second difference of the velocity in the world, m/s^3."""
    if trajectory.num_decisions < 2:
        return 0.0
    velocities = to_world(trajectory.velocities[:, :3], trajectory.orientations)
    jerk = np.diff(velocities, n=2, axis=0) / (trajectory.times[1] - trajectory.times[0]) ** 2
    return float(np.sqrt((jerk**2).sum(axis=1).mean()))


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else 0.0
