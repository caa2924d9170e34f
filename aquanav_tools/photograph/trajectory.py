"""Where a diver's camera goes in a synthetic cave, when, and how fast it moves while the shutter is open."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aquanav_tools.photograph.options import CaptureOptions, PathName
from aquanav_tools.types import Array

Legs = tuple[tuple[tuple[float, float, float], ...], ...]
"""Dives made of turning points: share of the way along the passage, yaw and pitch from its direction, degrees."""
SWIMS: dict[PathName, Legs] = {
    "forward": (((0, 0, 0), (1, 0, 0)),),
    "sweep": (tuple((k / 8, 55.0 * (-1) ** k, 20.0 * math.sin(2.0 * k)) for k in range(9)),),
    # Out along the left wall, round by the left, back along the other wall, round again to the first view.
    "loop": (((0, 55, 0), (1, 55, 0), (1, 235, 0), (0, 235, 0), (0, 415, 0)),),
    "passes": (((0, 45, 0), (1, 45, 0)), ((0, -45, 0), (1, -45, 0)), ((0, 0, 35), (1, 0, 35))),
}
SURFACE_TIME = 120.0
"""Between two passes, s."""
STATION_TIME = 8.0
"""Between two photos at a station, s."""
HOVER_SPEED = 0.03
"""Standard deviation of a hovering diver's speed along each axis, m/s."""
HOVER_SPIN = np.radians(2.0)
"""And of the camera's turning about each axis, rad/s."""
SHAKE_HZ = (0.13, 0.29, 0.61)
"""Frequencies of a swimming diver's unsteadiness: breath and fin strokes."""
_INSTANT = 1e-3
"""Time over which velocities are taken, s."""

Path = Callable[[float], "tuple[Array, Array]"]
"""Camera centre and `cam_from_world` at a time."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A camera in the world as the shutter is half way open."""

    centre: Array
    """(3,) world, m."""
    cam_from_world: Array
    """(3, 3) rotation; camera x right, y down, z ahead."""
    time: float
    """Since the start of the dive, s."""
    velocity: Array
    """(3,) of the centre, world, m/s."""
    spin: Array
    """(3,) turning of the camera, camera frame, rad/s."""


def plan_capture(centreline: Array, options: CaptureOptions) -> list[Shot]:
    """Return the shots of a dive along a (C, 3) centreline, in the order the photos are taken."""
    if options.path == "stations":
        return _hover(centreline, options)
    legs = SWIMS[options.path]
    shots: list[Shot] = []
    for index, leg in enumerate(legs):
        share = options.photos * (index + 1) // len(legs) - len(shots)
        start = shots[-1].time + SURFACE_TIME if shots else 0.0
        path, duration = _swim(centreline, options, leg, index)
        shots += [_shot(path, time, start) for time in np.linspace(0.0, duration, share)]
    return shots


def look(yaw: float, pitch: float, roll: float = 0.0) -> Array:
    """Return the (3, 3) rotation `cam_from_world` of a camera: yaw about world z, pitch up, then roll, radians."""
    ahead = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    level = np.stack([right, np.cross(ahead, right), ahead])
    rolled = np.array([[np.cos(roll), -np.sin(roll), 0.0], [np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    return rolled @ level


def _hover(centreline: Array, options: CaptureOptions) -> list[Shot]:
    """Return `options.photos` shots, those of a station one after the other, the stations evenly apart."""
    rng, drift = np.random.default_rng(options.seed), np.random.default_rng([options.seed, 1])
    passage = _Passage(centreline, options)
    shots: list[Shot] = []
    for share in np.linspace(0.0, 1.0, math.ceil(options.photos / len(options.shots))):
        here, heading = passage.at(share)
        for yaw_deg, pitch_deg in options.shots:
            centre = here + rng.normal(0.0, options.unsteady_m, 3)
            shake = np.radians(rng.normal(0.0, options.unsteady_deg, 3))
            turn = look(heading + np.radians(yaw_deg) + shake[0], np.radians(pitch_deg) + shake[1], shake[2])
            velocity, spin = drift.normal(0.0, HOVER_SPEED, 3), drift.normal(0.0, HOVER_SPIN, 3)
            shots.append(Shot(centre, turn, STATION_TIME * len(shots), velocity, spin))
    return shots[: options.photos]


def _swim(
    centreline: Array, options: CaptureOptions, leg: tuple[tuple[float, float, float], ...], index: int
) -> tuple[Path, float]:
    """Return a smooth path through the turning points of a leg, and how long it takes, s."""
    passage = _Passage(centreline, options)
    points = np.array(leg, dtype=float)
    steps = np.abs(np.diff(points, axis=0))
    durations = np.maximum(steps[:, 0] * passage.length / options.speed, steps[:, 1] / options.turn_rate_deg)
    times = np.concatenate([[0.0], np.cumsum(durations)])
    rng = np.random.default_rng([options.seed, 2, index])
    phases = rng.uniform(0.0, 2.0 * np.pi, (6, len(SHAKE_HZ)))
    sizes = np.repeat([options.unsteady_m, np.radians(options.unsteady_deg)], 3) * np.sqrt(2.0 / len(SHAKE_HZ))

    def path(time: float) -> tuple[Array, Array]:
        share, yaw_deg, pitch_deg = (float(np.interp(time, times, column)) for column in points.T)
        here, heading = passage.at(share)
        shake = sizes * np.sin(2.0 * np.pi * np.array(SHAKE_HZ) * time + phases).sum(axis=1)
        turn = look(heading + np.radians(yaw_deg) + shake[3], np.radians(pitch_deg) + shake[4], shake[5])
        return here + shake[:3], turn

    return path, float(times[-1])


def _shot(path: Path, time: float, start: float) -> Shot:
    """Return the shot of a path at a time, with its speed by central differences."""
    centre, turn = path(time)
    (before, turn_before), (after, turn_after) = path(time - 0.5 * _INSTANT), path(time + 0.5 * _INSTANT)
    # d(world_from_cam) = world_from_cam [spin]x, so the antisymmetric part of this product holds the spin.
    change = turn_before @ turn_after.T
    spin = 0.5 * np.array([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]])
    return Shot(centre, turn, start + float(time), (after - before) / _INSTANT, spin / _INSTANT)


class _Passage:
    """A centreline between the margins, by the share of the way."""

    def __init__(self, centreline: Array, options: CaptureOptions) -> None:
        steps = np.linalg.norm(np.diff(centreline, axis=0), axis=1)
        self._line, self._arc = centreline, np.concatenate([[0.0], np.cumsum(steps)])
        self._first, self._last = options.start_margin, self._arc[-1] - options.end_margin

    @property
    def length(self) -> float:
        """Metres from margin to margin."""
        return float(self._last - self._first)

    def at(self, share: float) -> tuple[Array, float]:
        """Return the (3,) place and the passage's heading there, radians from world x."""
        station = self._first + share * (self._last - self._first)
        before, here, after = (self._along(station + offset) for offset in (-0.5, 0.0, 0.5))
        return here, float(np.arctan2(after[1] - before[1], after[0] - before[0]))

    def _along(self, distance: float) -> Array:
        return np.array([np.interp(distance, self._arc, column) for column in self._line.T])
