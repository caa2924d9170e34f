"""Whether the passage goes by behind an opening, or ends there."""

from __future__ import annotations

from typing import Any

import manifold3d
import numpy as np
import pytest

from aquanav_tools.cave.cavity import from_manifold
from aquanav_tools.cave.closing.front import Front, front_behind
from aquanav_tools.cave.closing.openings import find_openings
from aquanav_tools.cave.closing.solid import ClosedSurface
from aquanav_tools.types import Array, BoolArray

MIN_PORTAL = 0.8
EDGE = 0.25
HEIGHT = 3.0


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Any:
    return manifold3d.Manifold.cube(tuple(np.subtract(high, low))).translate(low)


def scanned_but(solid: Any, *unseen: tuple[Array, Array]) -> ClosedSurface:
    """The surface of a solid in small triangles, without those in boxes."""
    mesh = from_manifold(solid.refine_to_length(EDGE))
    middles = mesh.triangles.mean(axis=1)
    is_seen = [((middles < low) | (middles > high)).any(axis=1) for low, high in unseen]
    return ClosedSurface(mesh, np.all(is_seen, axis=0), "winding")


def ends_of(closed: ClosedSurface) -> Array:
    """Where the ends are, from the left to the right."""
    middles = np.array([opening.centre for opening in find_openings(closed, MIN_PORTAL) if opening.is_portal])
    return middles[np.argsort(middles[:, 0])]


def canyon() -> Any:
    """0.8 m wide and HEIGHT high: along x, around a corner at x = 6, and along y."""
    return box((0.0, 0.0, 0.0), (6.0, 0.8, HEIGHT)) + box((5.2, 0.0, 0.0), (6.0, 7.0, HEIGHT))


def test_a_roof_that_is_missing_around_a_corner_is_no_end() -> None:
    left = np.array([-0.01, 0.0, 0.0]), np.array([0.01, 0.8, HEIGHT])
    right = np.array([5.2, 6.99, 0.0]), np.array([6.0, 7.01, HEIGHT])
    along_x = np.array([3.5, 0.0, HEIGHT - 0.01]), np.array([6.0, 0.8, HEIGHT + 0.01])
    along_y = np.array([5.2, 0.0, HEIGHT - 0.01]), np.array([6.0, 2.5, HEIGHT + 0.01])
    whole, damaged = scanned_but(canyon(), left, right), scanned_but(canyon(), left, right, along_x, along_y)
    assert (~damaged.is_scan).sum() > (~whole.is_scan).sum() + 20
    expected = [[0.0, 0.4, HEIGHT / 2], [5.6, 7.0, HEIGHT / 2]]
    for closed in (whole, damaged):
        assert ends_of(closed) == pytest.approx(np.array(expected), abs=0.05)


@pytest.mark.parametrize("length", [1.0, 2.0, 4.0])
def test_a_side_passage_that_leads_out_is_an_end_though_the_main_one_goes_by(length: float) -> None:
    # The main passage lies along y, shut at both ends; the stub, as wide and high, leads out along x.
    stub = box((1.9, -1.0, 0.0), (2.0 + length, 1.0, 2.0))
    mouth = np.array([1.99 + length, -1.0, 0.0]), np.array([2.01 + length, 1.0, 2.0])
    closed = scanned_but(box((0.0, -8.0, 0.0), (2.0, 8.0, 2.0)) + stub, mouth)
    assert ends_of(closed) == pytest.approx(np.array([[2.0 + length, 0.0, 1.0]]), abs=0.01)


def in_box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Any:
    def are_in_water(places: Array) -> BoolArray:
        return np.asarray(((places > low) & (places < high)).all(axis=1))

    return are_in_water


def rectangle(a: Array, b: Array, corner: Array) -> Array:
    """Two triangles."""
    a, b, c = corner + a, corner + b, corner + a + b
    return np.array([[corner, a, c], [corner, c, b]])


def test_water_goes_on_in_one_part_behind_an_end_and_in_two_beside_a_strip() -> None:
    water = in_box((-10.0, -1.0, 0.0), (10.0, 1.0, 2.0))
    end = rectangle(np.array([0.0, 2.0, 0.0]), np.array([0.0, 0.0, 2.0]), np.array([10.0, -1.0, 0.0]))
    front = front_behind(end, np.array([10.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), 4.0, 2.0, water)
    assert front.ahead == pytest.approx([1.0], abs=1e-3)
    assert not front.passes
    strip = rectangle(np.array([4.0, 0.0, 0.0]), np.array([0.0, 2.0, 0.0]), np.array([-2.0, -1.0, 2.0]))
    front = front_behind(strip, np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 1.0]), 8.0, 3.0, water)
    # Beyond the strip the front is a quarter of a cylinder of 3 m about its edge, down to the floor 2 m below: over the
    # angle t below the roof its middle lies 2 + 3 sin(t) / t along and 3 (1 - cos(t)) / t down, up to sin(t) = 2 / 3.
    t = np.arcsin(2.0 / 3.0)
    along, down = 2.0 + 3.0 * np.sin(t) / t, 3.0 * (1.0 - np.cos(t)) / t
    assert front.ahead == pytest.approx([down / np.hypot(along, down)] * 2, abs=0.02)
    assert front.passes


@pytest.mark.parametrize("ahead, passes", [((), False), ((0.2,), False), ((0.2, 0.3), True), ((0.2, 0.3, 0.9), False)])
def test_passage_goes_by_where_water_flows_off_sideways_to_both_sides(ahead: tuple[float, ...], passes: bool) -> None:
    assert Front(ahead).passes == passes
