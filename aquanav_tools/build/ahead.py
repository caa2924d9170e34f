"""Compile what a build from photos will need while an earlier stage leaves a core idle.

numba compiles each kernel when it is first called, in one thread, and keeps it on disk: a first build waits for that
almost two minutes in all. A process of the lowest priority goes through the later stages with a made-up pipe of a few
metres meanwhile; once everything is compiled that takes seconds. Results do not depend on it.
"""

from __future__ import annotations

import contextlib
import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from aquanav_tools.build.cave_stages import build_scenario
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.cave.closing.free_space import FreeSpace
from aquanav_tools.cave.scan.sight import make_sight
from aquanav_tools.machine import lower_priority
from aquanav_tools.reconstruct.dense import cpu
from aquanav_tools.reconstruct.dense.levels import Task, find_planes
from aquanav_tools.reconstruct.dense.pictures import Picture
from aquanav_tools.reconstruct.depth import DepthOptions
from aquanav_tools.types import PointCloud, silent

_MIN_PHOTOS = 40
"""Fewer take less time to place than a process to start."""
_RADIUS, _LENGTH, _SPACING = 1.0, 6.0, 0.05
"""Of the pipe and of its points, m."""
_STATIONS = 12
_log = logging.getLogger(__name__)


@contextlib.contextmanager
def compiling_ahead(num_photos: int) -> Iterator[None]:
    """Run `python -m aquanav_tools.build.ahead` meanwhile, where the set of photos is large enough to gain by it."""
    if num_photos < _MIN_PHOTOS:
        yield
        return
    command = [sys.executable, "-m", "aquanav_tools.build.ahead"]
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        if child.poll():
            _log.warning("Compiling ahead failed with %d; the build compiled for itself.", child.returncode)
        child.kill()
        child.wait()


def compile_later_stages() -> None:
    """Call the kernels of all stages from depth on, with arrays like those of a build."""
    _search_depth()
    lowest, highest = np.array([0.0, 0.0, 0.0]), np.array([_LENGTH, 0.0, 0.0])
    centres = np.linspace(lowest, highest, _STATIONS + 2)[1:-1]
    free_space = FreeSpace(centres, np.stack([centres[:-1], centres[1:]], axis=1), make_sight(*_views(centres)))
    build_scenario(
        _pipe(np.random.default_rng(0)), BuildOptions(Path("pipe"), Path("pipe")), Journal(silent), free_space
    )


def _search_depth() -> None:
    """Search for depth between photos of noise."""
    rng = np.random.default_rng(0)
    width, height = DepthOptions().width, 24
    matrix = np.array([[100.0, 0.0, width / 2], [0.0, 100.0, height / 2], [0.0, 0.0, 1.0]])
    grey = rng.integers(3, 255, (height, width), dtype=np.uint8)
    photos = [Picture(grey, np.ones_like(grey), matrix, np.eye(3), np.array([0.1 * k, 0.0, 0.0])) for k in range(3)]
    points = np.column_stack([rng.uniform(-0.3, 0.3, (8, 2)), np.full(8, 2.0)])
    find_planes(Task(photos[0], photos[1:], 1.0, 4.0, 0), points, DepthOptions().levels, cpu.solve)


def _pipe(rng: np.random.Generator) -> PointCloud:
    """Return points on the wall of a level pipe along +x, as photos give them."""
    count = round(2.0 * np.pi * _RADIUS * _LENGTH / _SPACING**2)
    angle, along = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.0, _LENGTH, count)
    across, up = np.cos(angle), np.sin(angle)
    points = np.column_stack([along, _RADIUS * across, _RADIUS * up])
    normals = np.column_stack([np.zeros(count), -across, -up])
    colours = np.full((count, 3), 128, np.uint8)
    return PointCloud(points, normals, colours, np.full(count, 8), np.full(count, 0.001))


def _views(centres: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return poses, pinholes and depth maps of cameras that look at the pipe's wall to the left (see `make_sight`)."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # x right, -z down, y ahead
    poses = np.stack([np.column_stack([turn, -turn @ centre]) for centre in centres])
    below = (np.arange(30) + 0.5 - 15.0) / 15.0  # per metre ahead, of every row
    depth = np.repeat(_RADIUS / np.sqrt(1.0 + below**2), 40).reshape(30, 40).astype(np.float32)
    return poses, np.tile([15.0, 15.0, 20.0, 15.0], (len(centres), 1)), [depth] * len(centres)


if __name__ == "__main__":
    lower_priority(19)
    compile_later_stages()
