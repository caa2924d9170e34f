from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

from aquanav_tools.photograph.options import JERLOV, Water
from aquanav_tools.photograph.water import BACK_SHARE, blur_ahead, transmission, veil, veil_image

COLOURLESS = Water("without loss", (0.0, 0.0, 0.0), 0.5)


@pytest.mark.parametrize("name", JERLOV)
def test_light_fades_per_channel_by_beer_and_lambert(name: str) -> None:
    water = JERLOV[name]
    left = transmission(np.array([0.0, 1.0, 5.0]), water)
    np.testing.assert_allclose(left[0], 1.0)
    np.testing.assert_allclose(left[1], np.exp(-np.array(water.diffuse)), rtol=1e-6)
    np.testing.assert_allclose(left[2], left[1] ** 5, rtol=1e-5)  # float32


def test_types_are_ordered_from_clear_to_turbid() -> None:
    waters = list(JERLOV.values())
    assert [w.scattering for w in waters] == sorted(w.scattering for w in waters)
    assert [w.diffuse[1] for w in waters] == sorted(w.diffuse[1] for w in waters)


def test_without_loss_the_veil_is_an_arc_tangent() -> None:
    distance = np.array([0.0, 0.1, 1.0, 10.0])
    expected = np.pi * COLOURLESS.scattering * BACK_SHARE * np.arctan(distance / 0.2) / 0.2
    np.testing.assert_allclose(veil(distance, COLOURLESS, 0.2)[:, 0], expected, rtol=1e-12)


def test_the_veil_is_the_sum_of_what_each_metre_sends_back() -> None:
    water, separation = JERLOV["5C"], 0.17
    for channel, loss in enumerate(water.diffuse):
        total, _ = integrate.quad(lambda s, k=loss: np.exp(-2.0 * k * s) / (s * s + separation**2), 0.0, 3.0)
        expected = np.pi * water.scattering * BACK_SHARE * total
        assert veil(np.array([3.0]), water, separation)[0, channel] == pytest.approx(expected, rel=1e-6)


def test_the_veil_grows_with_distance_and_saturates_at_the_light_of_open_water() -> None:
    distance = np.array([0.5, 1.0, 2.0, 4.0, 8.0, 1e3, np.inf])
    light = veil(distance, JERLOV["3C"], 0.17)
    assert np.all(np.diff(light[:-1], axis=0) > 0)
    np.testing.assert_allclose(light[-2], light[-1], rtol=1e-3)
    open_water = veil_image(np.array([np.nan, 8.0]), JERLOV["3C"], 0.17)
    np.testing.assert_allclose(open_water, light[[-1, 4]], rtol=2e-3)  # interpolated


def test_scattering_ahead_keeps_the_light_and_takes_the_contrast() -> None:
    rng = np.random.default_rng(0)
    light = np.tile(rng.uniform(0.0, 1.0, (60, 80, 1)).astype(np.float32), 3)
    blurred = blur_ahead(light, np.full((60, 80), 2.0), COLOURLESS, 300.0)
    assert blurred.mean() == pytest.approx(light.mean(), rel=0.01)
    # exp(-0.5 * 2) of the contrast is left; the grain is finer than the blur
    assert blurred.std() / light.std() == pytest.approx(np.exp(-1.0), rel=0.05)


def test_water_that_gives_light_is_refused() -> None:
    with pytest.raises(ValueError, match="negative"):
        Water("x", (0.1, -0.1, 0.1), 0.0)
