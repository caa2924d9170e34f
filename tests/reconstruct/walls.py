"""Photos of a flat wall in closed form, for the dense search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.reconstruct.dense.engine import Solve, solver
from aquanav_tools.reconstruct.dense.levels import gather
from aquanav_tools.reconstruct.dense.pictures import Picture
from aquanav_tools.reconstruct.dense.state import MAX_CHOSEN, Photo, Planes, Search

FOCAL, WIDTH, HEIGHT, DEPTH = 60.0, 64, 48, 2.0
BASELINE = 0.25


@dataclass(frozen=True)
class Wall:
    """The plane z = DEPTH + slant * x, painted with waves."""

    slant: float = 0.0
    is_striped: bool = False
    """Waves of one direction only, which repeat."""
    is_level: bool = False
    """Stripes along the way from camera to camera, which look alike at any depth."""

    @property
    def period_of_inverse(self) -> float:
        """Inverse depth, 1/m, by which the disparity of upright stripes on a wall at DEPTH changes by a period."""
        period_px = 2.0 * np.pi / 30.0 / DEPTH * FOCAL
        return float(period_px / (BASELINE * FOCAL))

    def paint(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Grey values, 0 to 255, at places of the wall, m."""
        if self.is_striped:
            return 127.0 + 90.0 * np.sin(30.0 * x)
        if self.is_level:
            return 127.0 + 90.0 * np.sin(30.0 * y)
        waves = np.sin(13.0 * x + 5.0 * y) + np.sin(7.0 * y - 11.0 * x + 1.0) + np.sin(17.0 * y + 2.0 * x)
        return 127.0 + 38.0 * waves

    def picture(self, shift_x: float, width: int = WIDTH, height: int = HEIGHT) -> Picture:
        """What a camera sees that was moved along x, m, looking along z."""
        matrix = np.array([[FOCAL, 0.0, width / 2], [0.0, FOCAL, height / 2], [0.0, 0.0, 1.0]])
        ray_x, ray_y = np.meshgrid(
            (np.arange(width) + 0.5 - width / 2) / FOCAL, (np.arange(height) + 0.5 - height / 2) / FOCAL
        )
        z = (DEPTH + self.slant * shift_x) / (1.0 - self.slant * ray_x)
        grey = np.rint(self.paint(ray_x * z + shift_x, ray_y * z)).astype(np.uint8)
        return Picture(grey, np.ones_like(grey), matrix, np.eye(3), np.array([-shift_x, 0.0, 0.0]))


def wall_pictures(wall: Wall) -> list[Picture]:
    """The photo in the middle, and one from either side."""
    return [wall.picture(shift) for shift in (0.0, -BASELINE, BASELINE)]


def small_case(solve: Solve) -> np.ndarray:
    """(4, P) of a tiny photo: cost of given planes; inverse depth and cost after a round; cost where depth is told."""
    pictures = [Wall().picture(shift, 20, 14) for shift in (0.0, -0.1, 0.1)]
    size = pictures[0].grey.shape
    rng = np.random.default_rng(5)
    photo = Photo(pictures[0].grey.astype(np.float32), pictures[0].usable, np.float32(FOCAL), np.float32(FOCAL))
    inverse = (rng.uniform(0.9, 1.1, size) / DEPTH).astype(np.float32)
    planes = Planes(
        inverse,
        np.zeros((*size, 2), np.float32),
        np.zeros(size, np.float32),
        np.zeros((*size, MAX_CHOSEN), np.uint8),
    )
    numbers = [np.float32(number) for number in (0.3, 0.0, 0.25, 1.0)]
    search = Search(2, 2, 2, *numbers, seed=3)
    sources = gather(pictures[0], pictures[1:])
    solve(photo, sources, planes, search, 0)
    rated = planes.cost.copy()
    solve(photo, sources, planes, search, 1)
    told = planes._replace(cost=planes.cost.copy())
    solve(photo, sources, told, search._replace(distinction=np.float32(0.001)), 0)
    return np.stack([rated.ravel(), planes.inverse.ravel(), planes.cost.ravel(), told.cost.ravel()])


def print_small_case(device: str) -> None:
    """Print the case, for another process."""
    print(*small_case(solver(device).solve).ravel().tolist())  # type: ignore[arg-type]
