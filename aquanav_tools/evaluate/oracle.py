"""A policy that knows the map, its own pose and the water: the ceiling that scenarios and policies are held against.

It follows the roomiest way to the goal (the geodesic whose cost rises near walls) by pure pursuit, aiming the nose up
the current so that the way over ground is right. Before each decision it runs the next second ahead by the vehicle's
own equations; where pursuit would come too near to a wall, it takes the command, of all 27, after which pursuit keeps
enough room and gets farthest (a rollout of a base policy: Bertsekas, Dynamic Programming and Optimal Control, chapter
6). It uses the task's own multidiscrete actions, so what it does, a policy can do.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.water.geodesic import WaterGraph
from aquanav_tools.envs.action import IDLE, Command
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.observation import layout
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.lookahead import CHOICES, Lookahead, choices_of
from aquanav_tools.sim.hull import hull_clearance
from aquanav_tools.sim.hydrodynamics import rotation_rows
from aquanav_tools.types import Array

NUM_NODES = (60_000, 300_000)
"""Samples of the water that the way is sought on: some seconds of work, and finer than the vehicle is long. In a long
cave so few may miss the middle of a narrow place; then as many as the build seeks its route on."""
SMOOTHING = 5
"""Samples of the way that are averaged: it turns by 45 degrees on the lattice."""
REACH = 0.7
"""Distance along the way to the point that is aimed at, m: about one and a half lengths of the vehicle."""
SLOWEST, FASTEST, SPEED_PER_METRE = 0.3, 0.8, 0.8
"""Speed over ground, m/s: so much per metre of clearance of the hull, between the two."""
STEER_LEAD, STEER_DEADBAND = 0.25, float(np.radians(4.0))
"""The rate of turn is taken to go on for so long, s; errors of heading up to the second are left."""
OVERSPEED = 0.15
"""It reverses when faster than it wants by this much, m/s."""
CLIMB_PER_METRE, FASTEST_CLIMB = 1.2, 0.4
"""Vertical speed per metre off the way, 1/s, and its limit, m/s."""
TRIM_PER_SPEED, TRIM_DEADBAND = 4.0, 0.05
HORIZON = 12
"""Decisions run ahead: longer than it takes to stop."""
MARGIN = 0.15
"""Clearance of the hull that the look-ahead asks for, m."""
STRIDE, PATIENCE, MAX_HALVINGS = 0.5, 50, 3
"""Where it makes less way than the first, m, in so many decisions, it asks for half the clearance, and so on: a place
that is narrower would hold it up for ever."""


@dataclass(frozen=True, eq=False)
class Way:
    """The way from a start to the goal."""

    points: Array
    """(N, 3) m."""
    arc: Array
    """(N,) m from the start."""


class OraclePolicy:
    """Acts on the true state of the environment that it is bound to."""

    def __init__(self) -> None:
        self._env: CaveEnv | None = None
        self._graphs: dict[int, WaterGraph] = {}
        self._trim = layout("full")["trim"]

    def bind(self, env: CaveEnv) -> None:
        """Learn the map, the vehicle and the water of an environment, and find the way from where the vehicle is."""
        known, radius = self._env, env.vehicle.capsule.radius
        if known is None or known.scenario is not env.scenario or radius != known.vehicle.capsule.radius:
            self._graphs = {}
        self._env, self._model = env, Lookahead(env)
        self._way = self._find_way(env.state[:3], np.array(env.scenario.settings.goal.position, dtype=np.float64))
        self._steer(env.state, 0.0, env.water_velocity)  # compiles now, not while a first action is timed

    def _find_way(self, start: Array, goal: Array) -> Way:
        assert self._env is not None
        for number in NUM_NODES:
            if number not in self._graphs:
                self._graphs[number] = WaterGraph(self._env.scenario.field, self._env.vehicle.capsule.radius, number)
            found = self._graphs[number].roomy_path(start, goal)
            if found is not None:
                points = np.vstack([start, _smooth(found), goal])
                steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
                return Way(points, np.concatenate([[0.0], np.cumsum(steps)]))
        raise InputError(
            f"No way as wide as the vehicle leads from {start.round(2).tolist()} to the goal at "
            f"{goal.round(2).tolist()}. The scenario is wrong: build it again, or choose a smaller vehicle."
        )

    def reset(self, seed: int) -> None:
        """Begin an episode; nothing is drawn at random."""
        if self._env is None:
            raise InputError("The oracle knows a map: call its bind(env) before its reset.")
        self._pending = deque([IDLE] * self._env.task.action_delay)
        self._made, self._waited = 0.0, 0

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return [ballast, steer, thrust]; of the observation it only needs its own trim."""
        assert self._env is not None
        state, trim, current = self._env.state, float(observation[self._trim][0]), self._env.water_velocity
        for command in self._pending:  # what was chosen before and has yet to come through
            state, trim = self._model.after(state, trim, command, current)
        chosen = self._choose(state, trim, current)
        if self._env.task.action_delay:
            self._pending.append(chosen)
            self._pending.popleft()
        return choices_of(chosen)

    def _choose(self, state: Array, trim: float, current: Array) -> Command:
        *steered, _, made = self._steer(state, trim, current)
        pursuit, margin = Command(*steered), self._margin(made)
        room, _ = self._foresee(state, trim, current, pursuit)
        if room >= margin:
            return pursuit
        foreseen = {command: self._foresee(state, trim, current, command) for command in CHOICES}
        return max(CHOICES, key=lambda command: (min(foreseen[command][0], margin), foreseen[command][1]))

    def _margin(self, made: float) -> float:
        """Return the clearance to ask for, m, when so much way is made, m."""
        self._waited += 1
        if made > self._made + STRIDE:
            self._made, self._waited = made, 0
        return MARGIN * 0.5 ** min(self._waited // PATIENCE, MAX_HALVINGS)

    def _foresee(self, state: Array, trim: float, current: Array, command: Command) -> tuple[float, float]:
        """Return the least clearance, m, and the way made, m, of a command and the pursuit after it."""
        room, made = np.inf, 0.0
        chosen: Sequence[float] = command
        for _ in range(HORIZON):
            state, trim = self._model.after(state, trim, chosen, current)
            *chosen, clearance, made = self._steer(state, trim, current)
            room = min(room, clearance)
        return room, made

    def _steer(self, state: Array, trim: float, current: Array) -> tuple[float, ...]:
        """Return the pursuit's ballast, steer and thrust, the hull's clearance, m, and the way made, m."""
        assert self._env is not None
        capsule, field = self._env.vehicle.capsule, self._env.scenario.field
        clearance = hull_clearance(state, 0.5 * capsule.axis_length, capsule.radius, *field.grid)
        return _pursue(state, trim, current, self._way.points, self._way.arc, clearance)


@numba.njit(cache=True)
def _pursue(state, trim, current, points, arc, clearance):  # type: ignore[no-untyped-def]
    """Return the command that steers along the way, the clearance, and the way made."""
    at, nearest = 0, np.inf
    for n in range(len(points)):
        apart = (points[n, 0] - state[0]) ** 2 + (points[n, 1] - state[1]) ** 2 + (points[n, 2] - state[2]) ** 2
        if apart < nearest:
            at, nearest = n, apart
    last = len(arc) - 1
    aim = min(np.searchsorted(arc, arc[at] + REACH), last)
    wanted = points[aim] - state[:3]
    speed = min(max(SPEED_PER_METRE * clearance, SLOWEST), FASTEST)
    wanted *= speed / max(np.sqrt((wanted**2).sum()), 1e-9)
    above = points[min(np.searchsorted(arc, arc[at] + 0.5 * REACH), last), 2] - state[2]
    wanted[2] = min(max(CLIMB_PER_METRE * above, -FASTEST_CLIMB), FASTEST_CLIMB)
    ballast, steer, thrust = _command_for(state, trim, wanted - current, current)
    return ballast, steer, thrust, clearance, arc[at]


@numba.njit(cache=True)
def _command_for(state, trim, wanted, current):  # type: ignore[no-untyped-def]
    """Return ballast, steer and thrust towards a (3,) velocity through the water, world frame, m/s."""
    rotation = rotation_rows(state)
    nose = np.arctan2(rotation[1][0], rotation[0][0])
    error = np.arctan2(wanted[1], wanted[0]) - nose
    error -= 2.0 * np.pi * np.round(error / (2.0 * np.pi))
    through = np.empty(3)
    for axis in range(3):
        row = rotation[axis]
        through[axis] = row[0] * state[7] + row[1] * state[8] + row[2] * state[9] - current[axis]
    surge = through[0] * np.cos(nose) + through[1] * np.sin(nose)
    ahead = np.hypot(wanted[0], wanted[1]) * max(np.cos(error), 0.0)
    thrust = 1.0 if surge < ahead else (-1.0 if surge > ahead + OVERSPEED else 0.0)
    wanted_trim = min(max(TRIM_PER_SPEED * (wanted[2] - through[2]), -1.0), 1.0)
    return (
        _step(wanted_trim - trim, TRIM_DEADBAND),
        _step(error - STEER_LEAD * state[12], STEER_DEADBAND),
        thrust,
    )


@numba.njit(cache=True)
def _step(error, deadband):  # type: ignore[no-untyped-def]
    return 0.0 if abs(error) <= deadband else float(np.sign(error))


def _smooth(points: Array) -> Array:
    """Return (N, 3) points averaged over SMOOTHING of them, the ends over fewer."""
    half = SMOOTHING // 2
    return np.array([points[max(n - half, 0) : n + half + 1].mean(axis=0) for n in range(len(points))])
