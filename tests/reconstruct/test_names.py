"""Order and safe spelling of photo names."""

from __future__ import annotations

from datetime import datetime

import pytest

from aquanav_tools.reconstruct.intake.names import file_name, name_of, natural_key, order


def in_order(*names: str) -> list[str]:
    return order(dict.fromkeys(names))


def test_natural_order_takes_digits_as_numbers() -> None:
    assert sorted(["x11", "x2", "x1b", "x1"], key=natural_key) == ["x1", "x1b", "x2", "x11"]


def test_a_counter_that_rolled_over_goes_on_where_it_did_without_times() -> None:
    assert in_order("A0001.jpg", "A9998.jpg", "A0003.jpg", "A9999.jpg") == [
        "A9998.jpg",
        "A9999.jpg",
        "A0001.jpg",
        "A0003.jpg",
    ]


def test_a_counter_that_merely_has_gaps_keeps_its_order() -> None:
    assert in_order("A0001.jpg", "A0002.jpg", "A9997.jpg") == ["A0001.jpg", "A0002.jpg", "A9997.jpg"]


def test_photos_of_two_cameras_are_not_mixed_by_their_clocks() -> None:
    times = {"a1": 10, "a2": 12, "b1": 11, "b2": 13}
    taken = {name: datetime(2026, 5, 1, hour) for name, hour in times.items()}
    assert order(taken) == ["a1", "a2", "b1", "b2"]


def test_one_photo_without_a_time_leaves_its_run_in_natural_order() -> None:
    taken = {"a1": datetime(2026, 5, 2), "a2": None, "a3": datetime(2026, 5, 1)}
    assert order(taken) == ["a1", "a2", "a3"]


@pytest.mark.parametrize("name", ["plain.jpg", "with space.jpg", "100%.png", "a%20b.jpg", "#1\t.tif", "Höhle 1.jpg"])
@pytest.mark.parametrize("copied_as", ["", "jpg"])
def test_safe_names_hold_no_space_and_lead_back(name: str, copied_as: str) -> None:
    file = file_name(name, copied_as)
    assert len(file.split()) == 1
    assert "#" not in file
    assert name_of(file) == name


def test_plain_names_stay_as_they_are() -> None:
    assert file_name("IMG_0001.JPG") == "IMG_0001.JPG"
