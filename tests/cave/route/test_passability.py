"""Widths, clearances and the largest vehicle in tubes whose squeezes are known in closed form."""

from __future__ import annotations

import json

import numpy as np
import pytest

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.route.passability import NARROW_SHARE, SAME_WIDTH, Passability, measure_passability
from tests.cave.closed_caves import POLYGON, field_of, joined, lathe, swept, walk

LENGTH = 10.0
THROAT = 0.3


def line(y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """From 0.5 m behind one lid to 0.5 m before the other."""
    x = np.linspace(0.5, LENGTH - 0.5, 91)
    return np.stack([x, np.full_like(x, y), np.full_like(x, z)], axis=1)


def measured(cave: Cavity, points: np.ndarray, vehicle_width: float = 0.457, spacing: float = 0.15) -> Passability:
    """What is checked of every cave: the numbers agree with each other."""
    found = measure_passability(cave, field_of(cave, spacing), points, vehicle_width)
    assert found.largest_vehicle >= found.narrowest.width >= 2.0 * found.clearance.least - 0.01
    assert 2.0 * found.clearance.least <= found.clearance.width + 1e-9
    # The one was searched with 10 moves, the other with 24: a hundredth.
    assert found.clearance.width >= 0.99 * found.narrowest.width
    assert all(found.narrowest.width <= narrow.width < NARROW_SHARE * vehicle_width for narrow in found.narrows)
    assert found.narrowest in found.marked
    assert json.loads(json.dumps(found.facts(), allow_nan=False))["largest_vehicle"] == found.largest_vehicle
    return found


def hourglass(x: np.ndarray) -> np.ndarray:
    return THROAT + 0.05 * (x - 4.2) ** 2


def necks(x: np.ndarray) -> np.ndarray:
    """Radius 1 with necks of 0.4 m at x = 3 and 0.2 m at x = 7, each 1 m long."""
    near, far = (0.5 + 0.5 * np.cos(2 * np.pi * np.clip(x - middle, -0.5, 0.5)) for middle in (3.0, 7.0))
    return 1.0 - 0.6 * near - 0.8 * far


@pytest.mark.parametrize("y", [0.0, 0.15])
def test_the_throat_of_an_hourglass_is_its_one_narrow_place_wherever_the_line_passes_it(y: float) -> None:
    found = measured(lathe(LENGTH, hourglass), line(y))
    (throat,) = found.narrows
    assert throat is found.narrowest
    # 4 mm between the last stations, and the ring nearest to the throat is 12.5 mm from it at most: second order.
    assert throat.width == pytest.approx(2 * THROAT * POLYGON, abs=1e-3)
    assert throat.arc_length == pytest.approx(4.2 - 0.5, abs=0.03)
    assert throat.position == pytest.approx([4.2, 0.0, 0.0], abs=0.03)
    # The same place, however it is asked for, and the line's clearance there is less by what it runs beside the axis.
    assert found.largest_vehicle == throat.width
    assert found.clearance.least == pytest.approx(THROAT * POLYGON - y, abs=2e-3)
    assert found.clearance.arc_length == pytest.approx(4.2 - 0.5, abs=0.1)
    assert found.clearance.width == pytest.approx(throat.width, rel=0.01)


def test_each_constriction_of_a_tube_is_listed_with_its_verdict() -> None:
    found = measured(lathe(LENGTH, necks), line())
    near, far = found.narrows
    assert near.width == pytest.approx(0.8 * POLYGON, abs=2e-3)
    assert far.width == pytest.approx(0.4 * POLYGON, abs=2e-3)
    assert near.is_passable
    assert not far.is_passable
    assert str(near) == "0.80 m at 2.5 m: passable for the vehicle of 0.457 m"
    assert str(far) == "0.40 m at 6.5 m: narrower than the vehicle's 0.457 m"
    assert found.largest_vehicle == far.width


def test_a_neck_is_no_narrow_place_for_a_vehicle_of_less_than_half_its_width() -> None:
    found = measured(lathe(LENGTH, necks), line(), vehicle_width=0.35)
    (far,) = found.narrows  # the other neck, of 0.8 m, leaves more than half a vehicle's width on either side
    assert far.width == pytest.approx(0.4 * POLYGON, abs=2e-3)
    assert measured(lathe(LENGTH, necks), line(), vehicle_width=0.15).narrows == ()


def test_a_neck_off_the_line_has_its_own_width_and_not_that_of_the_line() -> None:
    found = measured(lathe(LENGTH, necks, lambda x: 0.1 * (np.abs(x - 7.0) < 0.3)), line())
    assert found.narrowest.width == pytest.approx(0.4 * POLYGON, abs=2e-3)
    assert found.narrowest.position[1] == pytest.approx(0.1, abs=0.01)
    assert "where the passage is 0.40 m wide" in str(found)


def test_a_plain_tube_has_a_narrowest_place_but_no_narrow_one_and_lids_are_no_walls() -> None:
    found = measured(lathe(LENGTH, np.ones_like), line())
    assert found.narrows == ()
    assert found.narrowest.width == found.largest_vehicle == pytest.approx(2 * POLYGON, abs=1e-3)
    assert found.clearance.least == pytest.approx(POLYGON, abs=1e-3)  # the line begins 0.5 m from a lid
    assert str(found) == (
        f"Largest vehicle that gets through: 2.00 m wide (at {found.narrowest.arc_length:.1f} m of the route); this "
        f"one has 0.46 m. The route comes within 1.00 m of a wall, at {found.clearance.arc_length:.1f} m."
    )


def test_a_tube_that_is_too_tight_throughout_is_one_narrow_place() -> None:
    (narrowest,) = measured(lathe(LENGTH, lambda x: np.full_like(x, 0.2)), line()).narrows
    assert not narrowest.is_passable


def test_a_wider_way_around_a_squeeze_is_the_largest_vehicles_and_the_numbers_say_so() -> None:
    around = swept(walk((1.0, 0.0, 0.0), (1.0, 4.0, 0.0), (9.0, 4.0, 0.0), (9.0, 0.0, 0.0)), 0.5)
    inner = line()[5:-5]  # from 1 m behind one end, which is wall here, to 1 m before the other
    found = measured(joined(lathe(LENGTH, necks), around), inner)
    assert found.narrowest.width == pytest.approx(0.4 * POLYGON, abs=2e-3)
    assert found.has_wider_way
    # The loop's tube has a radius of 0.5 m and 48 flat sides; the search moves to within a hundredth of a spacing.
    assert found.largest_vehicle == pytest.approx(1.0, rel=SAME_WIDTH)
    assert "a wider way than the route, whose narrowest place, at 6.0 m of the route, leaves 0.40 m" in str(found)
