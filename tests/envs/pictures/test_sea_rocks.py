from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.envs.pictures.sea_rocks import EXACT, drawn_rock
from aquanav_tools.sea.outlines import outline_area
from aquanav_tools.sea.sea_map import Rock, rock_solid
from aquanav_tools.types import Array

ANGLES = np.linspace(0.0, 2.0 * np.pi, 9, endpoint=False)
OUTLINE = np.column_stack([20.0 + 5.0 * np.cos(ANGLES), -8.0 + 3.0 * np.sin(ANGLES)])


def inside(points: Array, outline: Array) -> Array:
    """Signed distances to the edges of a convex outline, the least of each point; positive inside."""
    edges = np.roll(outline, -1, axis=0) - outline
    offsets = points[:, None] - outline
    cross = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]
    return (cross / np.linalg.norm(edges, axis=1)).min(axis=1)


def test_a_rock_is_its_outline_at_the_water_and_never_outside_it() -> None:
    mesh = drawn_rock(Rock(OUTLINE, 6.0), 10.0)
    distances = inside(mesh.vertices[:, :2], OUTLINE)
    assert distances.min() > -1e-9
    is_rim = mesh.vertices[:-2, 2] <= EXACT  # behind them the middles of top and bottom
    assert np.abs(distances[:-2][is_rim]).max() < 1e-9
    below = mesh.to_trimesh().slice_plane([0, 0, EXACT], [0, 0, -1], cap=True).volume
    assert below == pytest.approx((10.0 + EXACT) * outline_area(OUTLINE), rel=1e-6)


def test_a_rock_above_the_water_is_no_box() -> None:
    rock = Rock(OUTLINE, 6.0)
    mesh = drawn_rock(rock, 10.0)
    prove_watertight(mesh)
    above, whole = (one.to_trimesh().slice_plane([0, 0, EXACT], [0, 0, 1], cap=True).volume
                    for one in (mesh, rock_solid(rock, 10.0)))  # fmt: skip
    assert 0.35 < above / whole < 0.9
    assert mesh.vertices[:, 2].max() == pytest.approx(6.0)


@pytest.mark.parametrize("top", [-1.0, 0.4])
def test_reefs_and_low_rocks_are_as_they_touch(top: float) -> None:
    rock = Rock(OUTLINE, top)
    np.testing.assert_array_equal(drawn_rock(rock, 10.0).vertices, rock_solid(rock, 10.0).vertices)
