"""A policy that knows the bay and its boat's true state: the ceiling that bays and policies are held against.

It takes the shortest way with as much room to rocks as there is, up to a few metres more than the boat needs, and
follows it by pure pursuit (Coulter, Implementation of the pure pursuit path tracking algorithm, 1992): the bow is
brought into the direction of a point some metres ahead on the way, corrected for the drift of the water.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.errors import InputError
from aquanav_tools.sea.shortest import shortest_path
from aquanav_tools.types import Array, rotation_matrix

ROOMS = (3.0, 2.0, 1.0, 0.5, 0.25)
"""Room to each side of the boat that is sought, m, the roomiest first."""
REACH = 1.5
"""Distance along the way to the point that is aimed at, in lengths of the boat."""
STEP = 0.25
"""Between the points of the way, m."""
STEER_LEAD, STEER_DEADBAND = 0.8, float(np.radians(3.0))
"""The rate of turn is taken to go on for so long, s; errors of heading up to the second are left."""
MAX_ERROR = float(np.radians(40.0))
"""It does not push on while the bow is farther off than this."""
LEFT, STRAIGHT, RIGHT = 0, 1, 2
STOP, AHEAD = 1, 2


class BoatOracle:
    """Acts on the true state of the environment that it is bound to."""

    def __init__(self) -> None:
        self._env: SurfaceEnv | None = None
        self._points: Array = np.zeros((0, 2))
        self._passed = 0

    def bind(self, env: SurfaceEnv) -> None:
        """Learn the bay and find the way from where the boat is."""
        self._env, self._passed = env, 0
        outlines, place = env.sea_map.outlines, env.state[:2].copy()
        half = 0.5 * env.footprint.width
        found = (shortest_path(outlines, place, env.sea_map.goal, half + room) for room in ROOMS)
        path = next((path.points for path in found if path is not None), env.route.points)
        self._points = _spaced(np.vstack([path, env.sea_map.goal.centre]))

    def reset(self, seed: int) -> None:
        """Begin an episode; nothing is drawn at random."""
        if self._env is None:
            raise InputError("The oracle knows a map: call its bind(env) before its reset.")

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return [steer, thrust], whatever is observed."""
        assert self._env is not None
        state = self._env.state
        rotation = rotation_matrix(state[3:7])
        wanted = self._aim(state[:2]) - state[:2]
        course = np.arctan2(wanted[1], wanted[0])
        speed = max(float(np.hypot(*(rotation @ state[7:10])[:2])), 0.5)
        drift = self._env.water_velocity
        across = float(np.cos(course) * drift[1] - np.sin(course) * drift[0])
        heading = course - np.arcsin(np.clip(across / speed, -0.7, 0.7))
        error = float(np.angle(np.exp(1j * (heading - np.arctan2(rotation[1, 0], rotation[0, 0])))))
        steer = STRAIGHT
        if abs(error - STEER_LEAD * state[12]) > STEER_DEADBAND:
            steer = LEFT if error > STEER_LEAD * state[12] else RIGHT
        return np.array([steer, AHEAD if abs(error) < MAX_ERROR else STOP])

    def _aim(self, place: Array) -> Array:
        """Return the point of the way to make for, from the nearest one that was not passed before."""
        assert self._env is not None
        ahead = self._points[self._passed :]
        self._passed += int(np.argmin(np.hypot(*(ahead - place).T)))
        reach = round(REACH * self._env.footprint.length / STEP)
        aim: Array = self._points[min(self._passed + reach, len(self._points) - 1)]
        return aim


def _spaced(points: Array) -> Array:
    """Return points STEP apart along a (K, 2) line."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.append(np.arange(0.0, arc[-1], STEP), arc[-1])
    return np.column_stack([np.interp(at, arc, points[:, axis]) for axis in range(2)])
