"""Damage of passes through a cave, against what geometry says of a tube and a bend."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.synthetic.caves import bend, tube
from aquanav_tools.synthetic.damage import DamagedScan, intact
from aquanav_tools.synthetic.passes import drift_passes, miss_strip, repeat_room, scan_from_stations
from aquanav_tools.types import Array, PointCloud

RADIUS, LENGTH = 1.2, 10.0


def straight() -> DamagedScan:
    return intact(tube(radius=RADIUS, length=LENGTH, sections=96, rings=81))


def points_of(scan: DamagedScan) -> Array:
    assert isinstance(scan.surface, PointCloud)
    return scan.surface.points


def test_a_strip_of_roof_is_missing_over_the_middle() -> None:
    whole, left = straight().mesh, miss_strip(straight(), 3.0, (0.0, 0.0, 1.0)).mesh
    # Within acos(0.6) of straight up: that share of the girth, over 3 of the 10 m.
    share = 3.0 / LENGTH * np.arccos(0.6) / np.pi
    assert left.areas.sum() == pytest.approx((1.0 - share) * whole.areas.sum(), rel=0.01)
    gone = whole.triangles.mean(axis=1)[~np.isin(whole.faces, left.faces).all(axis=1)]
    assert (gone[:, 2] > 0.6 * 0.95 * RADIUS).all()
    assert np.abs(gone[:, 0] - 0.5 * LENGTH).max() < 1.5


def test_scanners_see_the_wall_within_reach_and_more_of_it_nearby() -> None:
    points = points_of(scan_from_stations(straight(), spacing=20.0, number=20_000, reach=3.0, seed=1))
    assert np.linalg.norm(points[:, 1:], axis=1) == pytest.approx(RADIUS, rel=0.002)  # a prism of 96 sides
    off = points[:, 0] - 0.5 * LENGTH
    assert np.hypot(off, RADIUS).max() == pytest.approx(3.0, abs=0.02)
    # Of all directions, sin(a) lie within an angle a of the plane across the tube, and meet the wall within R tan(a).
    assert (np.abs(off) < RADIUS).mean() * len(points) == pytest.approx(20_000 * np.sin(np.pi / 4), rel=0.01)


def test_a_corner_hides_what_lies_behind_it() -> None:
    """From the axis of a bend, 4 m around, its inner wall, 3 m around, is seen up to the tangent, acos(3 / 4) away."""
    scan = intact(bend(radius=1.0, bend_radius=4.0, sections=96, rings=161))
    first, station, last = scan.truth.paths[0][[0, len(scan.truth.paths[0]) // 2, -1]]
    (x, y), *_ = np.linalg.lstsq(2.0 * np.array([station - first, last - first])[:, :2],
                                 [station @ station - first @ first, last @ last - first @ first])  # fmt: skip
    middle = np.array([x, y, 0.0])
    points = points_of(scan_from_stations(scan, spacing=100.0, number=200_000, reach=50.0, seed=2)) - middle
    inner = points[np.hypot(points[:, 0], points[:, 1]) < 3.01]
    angle = np.arctan2(inner[:, 1], inner[:, 0]) - np.arctan2(*(station - middle)[[1, 0]])
    seen = np.abs(np.angle(np.exp(1j * angle))).max()
    assert seen == pytest.approx(np.arccos(3.0 / 4.0), abs=0.03)


def test_passes_fit_where_they_begin_and_drift_apart_by_as_much_as_asked() -> None:
    scan = straight()
    drifted = drift_passes(scan, number=2, drift=0.3, share=1.0, seed=3)
    first, second = np.split(drifted.mesh.vertices, 2)
    place = scan.mesh.vertices[:, 0] / LENGTH
    for moved in (first, second):
        shift = np.linalg.norm(moved - scan.mesh.vertices, axis=1)
        assert shift == pytest.approx(0.3 * place**1.5, abs=1e-9)
    assert np.linalg.norm(first - second, axis=1).max() > 0.1
    assert len(drifted.mesh.faces) == 2 * len(scan.mesh.faces)
    partly = drift_passes(scan, number=4, drift=0.0, share=0.5, seed=4)
    assert len(partly.mesh.faces) == pytest.approx(2 * len(scan.mesh.faces), rel=0.1)


def test_a_room_is_there_twice_moved_sideways_and_turned() -> None:
    scan = straight()
    twice = repeat_room(scan, share=0.3, offset=0.2, angle=0.1, seed=5)
    added = twice.mesh.faces[len(scan.mesh.faces) :]
    assert len(added) == pytest.approx(0.3 * len(scan.mesh.faces), rel=0.1)
    number = len(scan.mesh.vertices)
    before, after = twice.mesh.vertices[added - number], twice.mesh.vertices[added]
    assert np.linalg.norm(after.mean(axis=(0, 1)) - before.mean(axis=(0, 1))) == pytest.approx(0.2, abs=0.01)
    edges = [corners[:, 1, :2] - corners[:, 0, :2] for corners in (before, after)]
    long = np.linalg.norm(edges[0], axis=1) > 0.05
    angles = [np.arctan2(edge[long, 1], edge[long, 0]) for edge in edges]
    assert np.angle(np.exp(1j * (angles[1] - angles[0]))) == pytest.approx(0.1, abs=1e-6)
    assert after[..., 2] == pytest.approx(before[..., 2])
