"""A survey held against a scan. Truth: a survey simulated in a tube, with known errors put in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aquanav_tools.errors import InputError
from aquanav_tools.survey.drift import Sim3, check_drift
from aquanav_tools.survey.model import Leg, LegFlag, Station, StationFlag, Survey
from aquanav_tools.synthetic.caves import SyntheticCave, sweep
from aquanav_tools.types import Array

RADIUS = 1.5


@pytest.fixture(scope="module")
def cave() -> SyntheticCave:
    along = np.linspace(0.0, 60.0, 241)
    return sweep(np.stack([along, 6.0 * np.sin(along / 8.0), 2.0 * np.sin(along / 11.0)], axis=1), RADIUS, 48)


@pytest.fixture(scope="module")
def survey(cave: SyntheticCave) -> Survey:
    """A station every 3 m, twelve splays each, without any error."""
    places = cave.centreline[8:-8:12]
    stations = [Station(str(i), place, StationFlag.UNDERGROUND) for i, place in enumerate(places)]
    stations[0] = replace(stations[0], flags=StationFlag.ENTRANCE)
    legs = [Leg(i, i + 1) for i in range(len(places) - 1)]
    directions = np.random.default_rng(1).normal(size=(len(places), 12, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    starts = np.repeat(places, 12, axis=0)
    rays = cave.truth.to_trimesh().ray
    ends, which, _ = rays.intersects_location(starts, directions.reshape(-1, 3), multiple_hits=False)
    for end, ray in zip(ends, which.tolist(), strict=True):
        stations.append(Station("", end, StationFlag.ANONYMOUS | StationFlag.WALL))
        legs.append(Leg(ray // 12, len(stations) - 1, LegFlag.SPLAY))
    return Survey("simulated", tuple(stations), tuple(legs))


def moved(survey: Survey, change: Callable[[Array], Array]) -> Survey:
    return replace(survey, stations=tuple(replace(s, position=change(s.position)) for s in survey.stations))


def test_a_survey_without_errors_fits(survey: Survey, cave: SyntheticCave) -> None:
    report = check_drift(survey, cave.truth)
    assert report.num_stations == 19
    assert report.stations_outside == ()
    assert report.blocked_legs == ()
    assert report.p95_residual < 1e-6
    assert report.fit.scale == pytest.approx(1.0, abs=1e-9)
    assert abs(report.drift_per_100_m) < 1e-6


def test_scale_turn_tilt_and_shift_are_recovered(survey: Survey, cave: SyntheticCave, rng: np.random.Generator) -> None:
    rotation = Rotation.from_euler("zx", [2.0, 1.0], degrees=True).as_matrix()
    truth = Sim3(1.03, rotation, np.array([0.3, -0.2, 0.1]))
    noise = 0.01  # m, a good laser
    wrong = moved(survey, lambda x: (x - truth.translation) @ rotation / truth.scale + noise * rng.normal(size=3))
    report = check_drift(wrong, cave.truth)
    # 228 splays of 1 cm over 60 m: scale and angles to a few 1e-4; no slack is taken for the unlucky seed but 3 sigma.
    assert report.scan_scale == pytest.approx(1.0 / 1.03, abs=1e-3)
    assert np.degrees(report.yaw) == pytest.approx(2.0, abs=0.1)
    assert np.degrees(report.tilt) == pytest.approx(1.0, abs=0.3)
    assert report.up == pytest.approx(rotation[:, 2], abs=5e-3)
    assert report.median_residual > 0.2
    assert report.median_after_fit < 2.0 * noise


def test_drift_is_reported_per_100_m(survey: Survey, cave: SyntheticCave) -> None:
    report = check_drift(moved(survey, lambda x: x + [0.0, 0.0, 0.01 * x[0]]), cave.truth)
    # 1 m per 100 m of x, upwards; the way winds and is 23 % longer than x, so 0.81 m per 100 m of it.
    assert report.drift_per_100_m == pytest.approx(0.81, abs=0.1)


def test_a_survey_beside_the_passage_is_outside_and_blocked(survey: Survey, cave: SyntheticCave) -> None:
    # Northwards by 1.7 m is sideways by 1.36 m where the passage runs north-east, less than its radius.
    report = check_drift(moved(survey, lambda x: x + [0.0, 1.7, 0.0]), cave.truth)
    assert 3 < len(report.stations_outside) < report.num_stations
    assert report.blocked_legs
    assert all(name for pair in report.blocked_legs for name in pair)
    assert report.median_residual > 0.5


def test_an_open_scan_wound_the_other_way_is_compared_as_well(survey: Survey, cave: SyntheticCave) -> None:
    flipped = replace(cave.mesh, faces=cave.mesh.faces[:, ::-1])
    assert check_drift(survey, flipped).stations_outside == ()


def test_a_survey_without_splays_is_refused(survey: Survey, cave: SyntheticCave) -> None:
    with pytest.raises(InputError, match="has 0 splays"):
        check_drift(replace(survey, legs=survey.centreline), cave.truth)
