"""A policy that knows the map, its own pose and the water: the ceiling that scenarios and policies are held against.

It follows the roomiest way to the goal (the geodesic whose cost rises near walls, moved to the middle of narrow places)
by pure pursuit, aiming the nose up the current so that the way over ground is right. Before each decision it runs the
next 1.8 s ahead by the vehicle's own equations, at several paces, and takes the fastest that keeps enough room. Where
none does, it takes the command, of all 27, after which pursuit keeps enough room and gets farthest (a rollout of a base
policy: Bertsekas, Dynamic Programming and Optimal Control, chapter 6). It uses the task's own multidiscrete actions, so
what it does, a policy can do.

Beside the map and its pose it knows what no policy is told: the body that this episode drew (mass, damping, thrust,
weak thrusters), how late its commands take effect and which are under way, the true trim, and the water wherever it
will come to, with its gusts and eddies as they are now. Of chance that is still to come it knows nothing; nor does it
know a law of motion of the user's own.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.water.roomy_ways import CENTRINGS, STRETCH, towards_middle
from aquanav_tools.envs.action import choices_of
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.lookahead import CHOICES, predictor_of
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.geometry.volume.geodesic import WaterGraph
from aquanav_tools.sim.batch.pursuit import (
    HORIZON,
    MARGIN,
    MAX_HALVINGS,
    PACES,
    PATIENCE,
    SHARE,
    STRIDE,
    Pursuit,
)  # fmt: skip
from aquanav_tools.sim.command import IDLE, Command
from aquanav_tools.types import Array

NUM_NODES = (60_000, 300_000)
"""Samples of the water that the way is sought on: some seconds of work, and finer than the vehicle is long. In a long
cave so few may miss the middle of a narrow place; then as many as the build seeks its route on."""
SMOOTHING = 5
"""Samples of the way that are averaged: it turns by 45 degrees on the lattice."""


@dataclass(frozen=True, eq=False)
class PlannedPath:
    """The way from a start to the goal."""

    points: Array
    """(N, 3) m."""
    arc: Array
    """(N,) m from the start."""
    room: Array
    """(N,) clearance of a hull whose axis is a point there, m."""


class OraclePolicy:
    """Acts on the true state of the environment that it is bound to."""

    def __init__(self) -> None:
        self._env: CaveEnv | None = None
        self._graphs: dict[int, WaterGraph] = {}

    def bind(self, env: CaveEnv) -> None:
        """Learn the map, the vehicle and the water of an environment, and find the way from where the vehicle is."""
        known, radius = self._env, env.vehicle.capsule.radius
        if known is None or known.scenario is not env.scenario or radius != known.vehicle.capsule.radius:
            self._graphs = {}
        self._env, self._predictor = env, predictor_of(env, has_map=True, knows_draws=True)
        self._path = path = self._find_path(
            env.state[:3], np.array(env.scenario.settings.goal.position, dtype=np.float64)
        )
        self._pursuit = Pursuit(self._predictor, path.points, path.arc, HORIZON, env.water_now)
        # Both compile now, not while a first action is timed.
        self._predictor.predict(env.state[None], np.zeros(1), np.zeros((1, env.action_delay, 3)), np.zeros(3))
        self._predictor.trim_at(env.ballast_level)
        self._pursuit.foresee(env.state, 0.0, env.water_velocity)

    def _find_path(self, start: Array, goal: Array) -> PlannedPath:
        assert self._env is not None
        for number in NUM_NODES:
            if number not in self._graphs:
                self._graphs[number] = WaterGraph(self._env.scenario.field, self._env.vehicle.capsule.radius, number)
            found = self._graphs[number].roomy_path(start, goal)
            if found is not None:
                return self._planned(np.vstack([start, _smooth(found), goal]))
        raise InputError(
            f"No way as wide as the vehicle leads from {start.round(2).tolist()} to the goal at "
            f"{goal.round(2).tolist()}. The scenario is wrong: build it again, or choose a smaller vehicle."
        )

    def _planned(self, points: Array) -> PlannedPath:
        """Return a way, moved to the middle of its narrow places."""
        assert self._env is not None
        field, radius = self._env.scenario.field, self._env.vehicle.capsule.radius
        points = _centred(points, field, radius + MARGIN)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return PlannedPath(points, np.concatenate([[0.0], np.cumsum(steps)]), field.clearance(points) - radius)

    def reset(self, seed: int) -> None:
        """Begin an episode; nothing is drawn at random."""
        if self._env is None:
            raise InputError("The oracle knows a map: call its bind(env) before its reset.")
        self._pending = deque([IDLE] * self._env.action_delay)
        self._made, self._waited = 0.0, 0

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return [ballast, steer, thrust]; it needs nothing of the observation, which errs and may be late."""
        assert self._env is not None
        state, current = self._env.state, self._env.water_velocity
        trim = self._predictor.trim_at(self._env.ballast_level)
        if self._pending:  # what was chosen before and has yet to come through
            pending = np.array(self._pending)[None]
            ahead = self._predictor.predict(state[None], np.array([trim]), pending, current)
            state, trim = ahead.states[0, -1], float(ahead.trims[0, -1])
        chosen = self._choose(state, trim, current)
        self._pending.append(chosen)
        self._pending.popleft()
        return choices_of(chosen)

    def _choose(self, state: Array, trim: float, current: Array) -> Command:
        margin = 0.0
        for n, pace in enumerate(PACES):  # one by one, as mostly the first will do
            pursued = self._pursuit.foresee(state, trim, current, paces=(pace,))
            if n == 0:
                margin = self._margin(float(pursued.reached[0]))
            if pursued.clearances[0] >= margin:
                return Command(*pursued.commands[0].tolist())
        foreseen = self._pursuit.foresee(state, trim, current, np.array(CHOICES))
        room = np.minimum(foreseen.clearances, margin)
        return CHOICES[max(range(len(CHOICES)), key=lambda n: (room[n], foreseen.made[n]))]

    def _margin(self, made: float) -> float:
        """Return the clearance to ask for, m, when so much way is made, m."""
        self._waited += 1
        if made > self._made + STRIDE:
            self._made, self._waited = made, 0
        ahead = self._path.room[np.abs(self._path.arc - made) <= STRETCH].min(initial=np.inf)
        return min(MARGIN, SHARE * max(ahead, 0.0)) * 0.5 ** min(self._waited // PATIENCE, MAX_HALVINGS)


def _smooth(points: Array) -> Array:
    """Return (N, 3) points averaged over SMOOTHING of them, the ends over fewer."""
    half = SMOOTHING // 2
    return np.array([points[max(n - half, 0) : n + half + 1].mean(axis=0) for n in range(len(points))])


def _centred(points: Array, field: DistanceField, enough: float) -> Array:
    """Return (N, 3) points, those inside moved across the way to where the clearance is greater, or enough (m)."""
    moved = points.copy()
    for _ in range(CENTRINGS):
        along = moved[2:] - moved[:-2]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        moved[1:-1] = towards_middle(moved[1:-1], along, field, enough)
    return moved
