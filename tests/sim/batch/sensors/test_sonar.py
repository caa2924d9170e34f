from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors.sonar import ImagingSonar
from aquanav_tools.sim.batch.sensors.sonar_sheet import SonarSheet
from aquanav_tools.types import yaw_quaternion
from tests.sim.batch.sensors.rooms import random_poses, room_batch

PLAIN = {
    "num_beams": 9, "num_bins": 200, "min_range": 0.0, "max_range": 20.0, "vertical_aperture_deg": 0.1,
    "horizontal_aperture_deg": 60.0, "absorption_db_per_m": 0.0, "tvg": False, "speckle": False, "noise_db": -np.inf,
    "dynamic_range_db": 0.0,
}  # fmt: skip
"""Pencil beams, intensities as they are; the far wall is 6 m ahead of the room's middle."""


def ping(source: str = "mesh", position: tuple[float, float, float] = (0.0, 0.0, 0.0), **changes: object) -> np.ndarray:
    """Return the (beams, bins) ping of one vehicle."""
    return ImagingSonar({**PLAIN, **changes}).measure(room_batch(source, positions=[position]))[0].copy()


def azimuths(**changes: object) -> np.ndarray:
    """Return the (beams,) azimuths."""
    return SonarSheet(**{**PLAIN, **changes}).azimuths  # type: ignore[arg-type]


@pytest.mark.parametrize("source", ["mesh", "field"])
def test_a_flat_wall_is_in_the_bins_of_its_range(source: str) -> None:
    """At 6 / cos(azimuth); a bin is 0.1 m, and an echo reaches half a bin to both sides."""
    image = ping(source)
    middles = 0.1 * (np.arange(200) + 0.5)
    centroids = image @ middles / image.sum(axis=1)
    assert np.allclose(centroids, 6.0 / np.cos(azimuths()), atol=0.01)
    assert ((image > 0.0).sum(axis=1) <= 3).all()


@pytest.mark.parametrize("source", ["mesh", "field"])
def test_intensity_falls_by_the_cosine_to_the_normal_and_the_square_of_the_range(source: str) -> None:
    """cos(a) / r^2 with r = 6 / cos(a)."""
    energies = ping(source).sum(axis=1)
    assert np.allclose(energies, np.cos(azimuths()) ** 3 / 36.0, rtol=2e-3)  # the field bends rays' ends by millimetres


def test_absorption_takes_its_decibels_on_both_ways() -> None:
    near, far = (ping(position=(x, 0.0, 0.0), absorption_db_per_m=0.5)[4].sum() for x in (3.0, -3.0))
    assert 10.0 * np.log10(near / far) == pytest.approx(20.0 * np.log10(9.0 / 3.0) + 2.0 * 0.5 * (9.0 - 3.0), abs=0.01)


def test_gain_makes_up_for_range_and_absorption() -> None:
    """Of the beam ahead what is left is 1; each bin's gain is that of its middle, to half a bin in 3 m."""
    for x in (3.0, -3.0):
        energy = ping(position=(x, 0.0, 0.0), absorption_db_per_m=0.5, tvg=True)[4].sum()
        assert energy == pytest.approx(1.0, rel=2 * 0.05 / 3.0)


def test_a_wide_beam_adds_up_its_pattern_over_the_elevation() -> None:
    """Integrated: share of the power at elevation e, times cos(e) / r^2 with r = 6 / cos(e)."""
    width = np.radians(20.0)
    elevation = np.linspace(-width, width, 20_001)
    pattern = np.exp(-2.0 * np.log(2.0) * (elevation / (0.5 * width)) ** 2)  # half power one way is a quarter both ways
    expected = np.trapezoid(pattern * np.cos(elevation) ** 3, elevation) / np.trapezoid(pattern, elevation) / 36.0
    assert ping(vertical_aperture_deg=20.0, num_sub_rays=64)[4].sum() == pytest.approx(expected, rel=1e-3)


def test_a_floor_is_spread_over_the_ranges_that_it_covers() -> None:
    """Tilted down by 60 degrees, the floor 3 m below: r = 3 / sin(angle below level), of which each bin has a part.

    Few sub-rays, far apart in range: what lies between two of them must not be dark.
    """
    width, num = np.radians(20.0), 1_000_000
    elevation = np.linspace(-width, width, num)
    pattern = np.exp(-2.0 * np.log(2.0) * (elevation / (0.5 * width)) ** 2)
    sine = np.sin(np.radians(60.0) - elevation)
    energies = pattern / pattern.sum() * sine / (3.0 / sine) ** 2
    expected, _ = np.histogram(3.0 / sine, bins=400, range=(0.0, 20.0), weights=energies)
    image = ping(vertical_aperture_deg=20.0, num_sub_rays=24, tilt_deg=60.0, num_beams=1, num_bins=400)[0]
    inside = np.flatnonzero(expected)[1:-1]
    assert (image[inside] > 0.0).all()
    assert np.abs(image - expected).max() < 0.1 * expected.max()  # a bin is as wide as the near sub-rays' patches
    assert image.sum() == pytest.approx(expected.sum(), rel=1e-3)


def test_beams_go_from_right_to_left() -> None:
    image = ping(position=(0.0, 3.0, 0.0), horizontal_aperture_deg=180.0)  # 1 m to the left wall, 7 to the right
    assert image[0].argmax() == pytest.approx(70, abs=1)
    assert image[-1].argmax() == pytest.approx(10, abs=1)


def test_speckle_is_exponential_with_the_mean_of_what_it_disturbs() -> None:
    num = 2000
    sheet = {**PLAIN, "num_beams": 1, "num_bins": 20}
    arrays = {"positions": np.tile([0.5, 0.0, 0.0], (num, 1)), "seeds": np.arange(num)}  # 5.5 m to the wall: bin 5
    smooth = ImagingSonar(sheet).measure(room_batch(**arrays))[0, 0, 5]
    rough = ImagingSonar({**sheet, "speckle": True}).measure(room_batch(**arrays))[:, 0, 5]
    assert rough.mean() == pytest.approx(smooth, rel=5 / np.sqrt(num))
    assert rough.std() == pytest.approx(smooth, rel=5 * np.sqrt(2.0 / num))


def test_noise_has_its_mean_where_there_is_no_echo() -> None:
    image = ping(num_beams=64, noise_db=-30.0)[:, 150:]
    assert image.mean() == pytest.approx(1e-3, rel=5 / np.sqrt(image.size))


def test_decibels_are_mapped_to_the_unit_interval() -> None:
    plain, shown = ping(), ping(dynamic_range_db=40.0)
    lit = plain > 1e-4 * 1.001
    assert np.allclose(shown[lit], 1.0 + 10.0 * np.log10(plain[lit]) / 40.0, atol=1e-5)
    assert np.array_equal(shown[plain == 0.0], np.zeros((plain == 0.0).sum()))


def test_a_ping_turns_with_the_vehicle() -> None:
    """By one step between beams: all but one beam see what their neighbour saw."""
    step = np.radians(60.0) / 8
    turned = ImagingSonar(PLAIN).measure(room_batch(positions=np.zeros((1, 3)), orientations=[yaw_quaternion(step)]))[0]
    assert np.allclose(turned[:-1], ping()[1:], atol=1e-5)


@pytest.mark.parametrize("num_threads", [1, 2])
def test_a_vehicle_pings_alone_as_it_pings_among_many(num_threads: int, rng: np.random.Generator) -> None:
    positions, turns = random_poses(rng, 33)
    arrays = {"positions": positions, "orientations": turns, "seeds": rng.integers(1 << 32, size=33)}
    sonar = ImagingSonar({"num_beams": 16, "num_bins": 32})
    together = sonar.measure(room_batch("field", num_threads, **arrays)).copy()
    for n in (0, 32):
        alone = sonar.measure(
            room_batch("field", num_threads, **{key: value[n : n + 1] for key, value in arrays.items()})
        )
        assert np.array_equal(alone[0], together[n])


def test_a_ping_is_in_its_space() -> None:
    sonar = ImagingSonar("oculus-m750d")
    image = sonar.measure(room_batch("field", positions=np.zeros((1, 3))))[0]
    assert image.shape == (256, 256)
    assert sonar.spec(None, None).contains(image)  # type: ignore[arg-type]  # it needs neither


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"num_beams": 0}, "num_beams = 0, which must be from 1 to 4096"),
        ({"min_range": 5.0, "max_range": 4.0}, "min_range = 5.0, which must be from 0 to below max_range"),
        ({"beams": 5}, "unknown key 'beams'"),
        ({"vertical_aperture_deg": 0.0}, "vertical_aperture_deg = 0.0"),
    ],
)
def test_a_senseless_sonar_is_refused_with_what_is_wrong(table: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        ImagingSonar(table)
