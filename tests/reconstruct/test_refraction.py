"""Housings, against Snell's law written out anew."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.reconstruct.images import Photo
from aquanav_tools.reconstruct.intake.camera import first_guess
from aquanav_tools.reconstruct.intake.options import IntakeOptions
from aquanav_tools.reconstruct.intake.refraction import describe_housing, dome_shift_px, flat_port


def test_a_flat_port_bends_the_corner_ray_as_snell_says() -> None:
    port = flat_port(800.0, 1200, 900)  # the corner is 750 px off the axis
    assert port.half_view_air_deg == pytest.approx(np.degrees(np.arctan2(750, 800)))
    assert 1.333 * np.sin(np.radians(port.half_view_water_deg)) == pytest.approx(750 / np.hypot(750, 800))
    pinhole = 1.333 * 800.0 * np.tan(np.radians(port.half_view_water_deg))
    assert port.edge_shift_px == pytest.approx(750 - pinhole)


def test_a_flat_port_is_a_pinhole_camera_of_a_longer_focal_length_near_the_axis() -> None:
    narrow = flat_port(20_000.0, 1200, 900)
    assert narrow.edge_shift_px == pytest.approx(0.0, abs=0.3)
    assert narrow.residual_px < 1e-3


def test_two_radial_terms_leave_more_error_the_wider_the_view() -> None:
    errors = [flat_port(focal, 1200, 900).shape_error for focal in (1600.0, 800.0, 500.0)]
    assert errors[0] < errors[1] < errors[2] < 0.01


def test_rays_behind_a_flat_port_start_where_two_lines_cross() -> None:
    port = flat_port(800.0, 1200, 900)
    air, water = np.radians([port.half_view_air_deg, port.half_view_water_deg])
    height_at_port = 30.0 * np.tan(air)  # pupil 30 mm behind the port
    start = height_at_port / np.tan(water)  # where the ray in water, drawn back, meets the axis
    on_axis = 30.0 * 1.333  # limit of the same for small angles
    assert 30.0 * port.viewpoint_shift == pytest.approx(start - on_axis)


def test_a_dome_off_centre_shifts_the_corner_as_a_traced_ray() -> None:
    angle = np.arctan2(750.0, 800.0)
    ray = np.array([np.sin(angle), np.cos(angle)])
    pupil = np.array([0.0, 1.0])  # 1 mm before the centre of a dome of 50 mm
    along = -pupil @ ray + np.sqrt((pupil @ ray) ** 2 + 50.0**2 - 1.0)
    normal = (pupil + along * ray) / 50.0
    cosine = normal @ ray
    bent = ray / 1.333 + (np.sqrt(1 - (1 - cosine**2) / 1.333**2) - cosine / 1.333) * normal
    shift = 800.0 * abs(bent[0] / bent[1] - 750.0 / 800.0)
    assert dome_shift_px(800.0, 1200, 900) == pytest.approx(shift, rel=0.03)


def test_the_sentences_give_numbers_or_nothing() -> None:
    assert describe_housing("none", 800.0, 1200, 900) == ""
    assert "grows by 33%" in describe_housing("flat-port", 800.0, 1200, 900)
    assert "EXIF tells no focal length" in describe_housing("flat-port", None, 1200, 900)
    assert "on a dome of 50 mm" in describe_housing("dome", 800.0, 1200, 900)


def photo(focal_px: float | None) -> Photo:
    return Photo("a.jpg", 1200, 900, focal_px)


def test_mapping_starts_from_the_focal_length_in_water() -> None:
    guess = first_guess(photo(800.0), IntakeOptions(housing="flat-port"), None)
    assert guess.focal_px == pytest.approx(1066.4)
    assert guess.is_known


def test_the_focal_length_a_user_gives_is_taken_as_it_is() -> None:
    guess = first_guess(photo(800.0), IntakeOptions(housing="flat-port"), 1000.0)
    assert guess.focal_px == 1000.0


def test_an_unknown_focal_length_is_a_guess() -> None:
    assert not first_guess(photo(None), IntakeOptions(), None).is_known


def test_a_fisheye_gets_a_model_that_can_bend_as_it_does() -> None:
    assert first_guess(photo(None), IntakeOptions(lens="fisheye"), None).model == "OPENCV_FISHEYE"


@pytest.mark.parametrize("wrong", [{"frame_step": 0.5}, {"lens": "fisheye", "housing": "flat-port"}])
def test_senseless_intake_options_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=str(next(iter(wrong)))):
        IntakeOptions(**wrong)  # type: ignore[arg-type]
