from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.photograph.rock import AMBIENT, MUD, _relief_slope, beam, shade
from aquanav_tools.synthetic.noise import fractal


def bare_light(distance: float, angle: float = 0.0) -> float:
    """Green light from a bare wall at a distance on the lamp's axis, turned away from it by an angle."""
    points = np.array([[distance, 0.0, 0.0]])
    normals = np.array([[-np.cos(angle), np.sin(angle), 0.0]])
    return float(shade(points, normals, np.zeros(3), np.array([1.0, 0.0, 0.0]), 1e-3, 0.0, 0)[0, 1])


@pytest.mark.parametrize("distance", [0.5, 2.0, 7.0])
def test_light_falls_off_with_the_square_of_the_distance(distance: float) -> None:
    light = bare_light(distance) * distance**2
    # 0.90 to 0.92 of the grey is green, depending on the stains of iron
    assert light == pytest.approx(0.91 * MUD * (1.0 + AMBIENT), rel=0.012)


def test_light_falls_off_with_the_cosine_of_the_angle() -> None:
    assert bare_light(2.0, np.pi / 3) == pytest.approx(bare_light(2.0) * (0.5 + AMBIENT) / (1.0 + AMBIENT), rel=1e-4)
    assert bare_light(2.0, np.pi) == pytest.approx(bare_light(2.0) * AMBIENT / (1.0 + AMBIENT), rel=1e-4)


def test_the_beam_is_brightest_on_its_axis() -> None:
    assert beam(1.0) == 1.0
    assert np.all(np.diff(beam(np.linspace(0.0, 1.0, 20))) > 0)


def test_open_water_sends_no_light() -> None:
    nowhere = np.full((1, 3), np.nan)
    assert np.all(shade(nowhere, nowhere, np.zeros(3), np.array([1.0, 0.0, 0.0]), 1e-3, 1.0, 0) == 0.0)


def test_mud_takes_the_contrast_of_the_rock() -> None:
    rng = np.random.default_rng(0)
    points = np.stack([np.full(4000, 2.0), *rng.uniform(-0.3, 0.3, (2, 4000))], axis=1)
    normals = np.tile([-1.0, 0.0, 0.0], (4000, 1))
    bare, muddy, rich = (
        shade(points, normals, np.zeros(3), np.array([1.0, 0.0, 0.0]), 1e-3, texture, 0)[:, 1]
        for texture in (0.0, 0.2, 1.0)
    )
    assert 0.15 < (muddy / bare).std() / (rich / bare).std() < 0.25


def test_the_reliefs_slope_is_the_gradient_of_its_height(rng: np.random.Generator) -> None:
    step = 1e-6
    for x, y, z in rng.uniform(-3.0, 3.0, (20, 3)):

        def height(dx: float, dy: float, dz: float, x: float = x, y: float = y, z: float = z) -> float:
            return float(fractal(x + dx, y + dy, z + dz, 14.0, 3, 0.6, 80.0, 5))

        expected = [(height(*(step * axis)) - height(*(-step * axis))) / (2 * step) for axis in np.eye(3)]
        np.testing.assert_allclose(_relief_slope(x, y, z, 80.0, 5), expected, rtol=1e-4, atol=1e-4)
