from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.route.narrows import find_narrows, largest_vehicle
from tests.cave.closed_caves import POLYGON, lathe

LENGTH = 10.0
THROAT = 0.3


def line(y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """From 0.5 m behind one lid to 0.5 m before the other."""
    x = np.linspace(0.5, LENGTH - 0.5, 91)
    return np.stack([x, np.full_like(x, y), np.full_like(x, z)], axis=1)


def hourglass(x: np.ndarray) -> np.ndarray:
    return THROAT + 0.05 * (x - 4.2) ** 2


def necks(x: np.ndarray) -> np.ndarray:
    """Radius 1 with necks of 0.4 m at x = 3 and 0.2 m at x = 7, each 1 m long."""
    near, far = (0.5 + 0.5 * np.cos(2 * np.pi * np.clip(x - middle, -0.5, 0.5)) for middle in (3.0, 7.0))
    return 1.0 - 0.6 * near - 0.8 * far


@pytest.mark.parametrize("y", [0.0, 0.15])
def test_the_throat_of_an_hourglass_is_its_one_narrow_place_wherever_the_line_passes_it(y: float) -> None:
    (throat,) = find_narrows(line(y), lathe(LENGTH, hourglass), 0.457)
    # 4 mm between the last stations, and the ring nearest to the throat is 12.5 mm from it at most: second order.
    assert throat.width == pytest.approx(2 * THROAT * POLYGON, abs=1e-3)
    assert throat.arc_length == pytest.approx(4.2 - 0.5, abs=0.03)
    assert throat.position == pytest.approx([4.2, 0.0, 0.0], abs=0.03)


def test_each_constriction_of_a_tube_is_listed_with_its_verdict() -> None:
    near, far = find_narrows(line(), lathe(LENGTH, necks), 0.457)
    assert near.width == pytest.approx(0.8 * POLYGON, abs=2e-3)
    assert far.width == pytest.approx(0.4 * POLYGON, abs=2e-3)
    assert near.is_passable
    assert not far.is_passable
    assert str(near) == "0.80 m at 2.5 m: passable for the vehicle of 0.457 m"
    assert str(far) == "0.40 m at 6.5 m: narrower than the vehicle's 0.457 m"
    assert largest_vehicle((near, far)) == far.width


def test_a_neck_off_the_line_has_its_own_width_and_not_that_of_the_line() -> None:
    cave = lathe(LENGTH, necks, lambda x: 0.1 * (np.abs(x - 7.0) < 0.3))
    narrowest = min(find_narrows(line(), cave, 0.457), key=lambda narrow: narrow.width)
    assert narrowest.width == pytest.approx(0.4 * POLYGON, abs=2e-3)
    assert narrowest.position[1] == pytest.approx(0.1, abs=0.01)


def test_a_plain_tube_has_its_narrowest_place_and_no_other_and_lids_are_no_walls() -> None:
    (narrowest,) = find_narrows(line(), lathe(LENGTH, np.ones_like), 0.457)
    assert narrowest.width == pytest.approx(2 * POLYGON, abs=1e-3)


def test_a_tube_that_is_too_tight_throughout_is_one_narrow_place() -> None:
    (narrowest,) = find_narrows(line(), lathe(LENGTH, lambda x: np.full_like(x, 0.2)), 0.457)
    assert not narrowest.is_passable
