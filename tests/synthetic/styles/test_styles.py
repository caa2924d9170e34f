"""Drawn caves: closed, of the size asked for, the same for the same seed and another for another."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import trimesh

from aquanav_tools.errors import InputError
from aquanav_tools.synthetic.made_up import made_up_cavity
from aquanav_tools.synthetic.styles.catalogue import MAX_CELLS, STYLES, VEHICLE_WIDTH, DrawnCave, draw_cave
from aquanav_tools.synthetic.styles.drawing import STEP, kinks, turned
from aquanav_tools.synthetic.styles.names import FIRST_STYLES, MAX_SEED, MIXED, STYLE_NAMES, number_of, style_of
from aquanav_tools.synthetic.styles.plan import NO_FLOOR, Passage, Plan, Relief
from aquanav_tools.synthetic.styles.surface import water_surface
from aquanav_tools.types import Mesh

SMOOTH = Relief(swell=0.0, grain=0.0, floor=0.0)


def straight(half_width: float, half_height: float, extent: float = 6.0, floor: float | None = None) -> Plan:
    axis = np.zeros((100, 3))
    axis[:, 0] = np.arange(100) * 0.1 - 2.0
    size = np.ones(100)
    depth = None if floor is None else floor * size
    passage = Passage(axis, 0.0 * size, half_width * size, half_height * size, half_height * size, floor=depth)
    return Plan((passage,), extent, 2.0 * min(half_width, half_height), SMOOTH)


def surface(drawn: DrawnCave) -> Mesh:
    return water_surface(drawn.plan, drawn.voxel, drawn.noise_seed)


def test_a_smooth_tube_has_the_volume_of_its_ellipse() -> None:
    mesh = water_surface(straight(1.0, 0.7), 0.1, 0)
    # Marching cubes cut a circle's corners: (voxel / radius)^2 / 8, and stations ripple by about a percent.
    assert mesh.volume == pytest.approx(np.pi * 1.0 * 0.7 * 6.0, rel=0.03)


def test_a_floor_takes_away_the_segment_below_it() -> None:
    depth, radius = 0.5, 1.0
    segment = radius**2 * np.arccos(depth / radius) - depth * np.sqrt(radius**2 - depth**2)
    whole = water_surface(straight(radius, radius), 0.1, 0).volume
    with_floor = water_surface(straight(radius, radius, floor=depth), 0.1, 0).volume
    assert whole - with_floor == pytest.approx(6.0 * segment, rel=0.12)  # the fillet takes some more
    assert NO_FLOOR < -1e6


def test_blocks_of_the_grid_meet_without_a_seam() -> None:
    mesh = water_surface(straight(1.0, 1.0, 9.0), 0.09, 0)  # 100 cells: more than four blocks
    assert mesh.to_trimesh().is_watertight
    assert mesh.to_trimesh().euler_number == 2


@pytest.mark.parametrize("style", STYLE_NAMES)
def test_every_style_is_one_proven_body_of_water_with_two_portals(style: str) -> None:
    drawn = draw_cave(style, 3)
    mesh = surface(drawn)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_volume and solid.body_count == 1
    cavity = made_up_cavity(mesh, 0.1 * drawn.voxel)  # raises where the proof fails
    assert [portal.label for portal in cavity.portals] == [1, 2]
    assert cavity.portals[1].centre[0] - cavity.portals[0].centre[0] == pytest.approx(drawn.plan.extent, abs=1e-3)


@pytest.mark.parametrize("style", STYLE_NAMES)
def test_plans_keep_within_the_lengths_and_openings_of_their_style(style: str) -> None:
    kind = STYLES[style]
    for seed in range(12):
        drawn = draw_cave(style, seed)
        plan = drawn.plan
        way = plan.passages[0].axis
        way = way[(way[:, 0] >= 0.0) & (way[:, 0] <= plan.extent)]
        length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
        assert kind.lengths[0] - 0.5 <= length <= kind.lengths[1] + 0.5
        assert kind.openings[0] <= plan.opening / VEHICLE_WIDTH <= kind.openings[1]
        assert plan.wall_area / drawn.voxel**2 <= 1.15 * MAX_CELLS or length <= kind.lengths[0] + 0.5


def test_the_same_seed_is_the_same_cave_to_the_byte_and_another_another() -> None:
    one, same, other = (surface(draw_cave("phreatic-tube", seed)) for seed in (1, 1, 2))
    assert one.vertices.tobytes() == same.vertices.tobytes()
    assert one.faces.tobytes() == same.faces.tobytes()
    assert one.vertices.shape != other.vertices.shape
    again = draw_cave("phreatic-tube", 1, attempt=1)
    assert again.plan.opening > draw_cave("phreatic-tube", 1).plan.opening
    assert not np.array_equal(again.plan.passages[0].axis, draw_cave("phreatic-tube", 1).plan.passages[0].axis)


def test_mixed_takes_every_style_as_often() -> None:
    counts = Counter(style_of(MIXED, seed) for seed in range(5000))
    assert set(counts) == set(STYLE_NAMES) == set(STYLES)
    share = 1.0 / len(STYLES)
    spread = np.sqrt(5000 * share * (1.0 - share))
    assert all(abs(count - 5000 * share) < 4.0 * spread for count in counts.values())


def test_a_style_that_came_later_left_the_mixed_seeds_of_others_as_they_were() -> None:
    styles = [style_of(MIXED, seed) for seed in range(1000)]
    kept = [FIRST_STYLES[number_of(MIXED, seed) % 9] for seed in range(1000)]
    later = set(STYLE_NAMES[len(FIRST_STYLES) :])
    assert all(now == before or now in later for now, before in zip(styles, kept, strict=True))


def test_corners_lie_a_leg_apart_and_legs_are_straight_between_them() -> None:
    rng = np.random.default_rng(0)
    corners = kinks(60.0, (1.0, 4.0), rng)
    assert np.diff(corners).min() >= 1.0 and np.diff(corners).max() <= 4.0
    assert corners[0] >= 1.0 and corners[-1] < 59.0
    stations = np.arange(0.0, 60.0, 0.1)
    angles = turned(stations, corners, 0.8, 0.4, rng)
    nearest = np.abs(stations[:, None] - corners).min(axis=1)
    straight = (nearest[:-1] > 0.25) & (nearest[1:] > 0.25)
    assert np.abs(np.diff(angles))[straight].max() == 0.0
    assert 0.4 < np.abs(angles).max() <= 0.8


def test_a_crawlway_is_no_wider_than_a_few_vehicles_and_sharper_than_a_tube() -> None:
    sharpest = {}
    for style in ("crawlway", "phreatic-tube"):
        plans = [draw_cave(style, seed).plan for seed in range(6)]
        ahead = [np.diff(plan.passages[0].axis, axis=0) / STEP for plan in plans]
        turns = [np.arccos(np.clip((one[5:] * one[:-5]).sum(axis=1), -1.0, 1.0)) for one in ahead]
        sharpest[style] = float(np.degrees(np.median([turn.max() for turn in turns])))
        if style == "crawlway":
            widths = [2.0 * plan.passages[0].half_width.max() / VEHICLE_WIDTH for plan in plans]
            assert max(widths) < 3.0 * 1.8 * np.exp(0.4)  # the widest opening, roomiest, flattest
    assert sharpest["crawlway"] > 40.0 > sharpest["phreatic-tube"]  # over half a metre of way


def test_an_unknown_style_is_told_the_nearest_name() -> None:
    with pytest.raises(InputError, match=r"There is no style 'mine-drifts'\. Did you mean 'mine-drift'\?"):
        draw_cave("mine-drifts", 0)
    with pytest.raises(InputError, match=f"seed = -1 is outside 0 to {MAX_SEED}"):
        draw_cave("maze", -1)
