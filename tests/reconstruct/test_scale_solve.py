"""Scale and up from noisy observations of synthetic cameras, whose transform is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.reconstruct.georeference.clues import Anchors, Clue, Lengths, Ups
from aquanav_tools.reconstruct.georeference.place import Georeference, cameras_up, place
from aquanav_tools.reconstruct.georeference.weigh import weigh
from aquanav_tools.types import Array

SCALE = 3.7
EVERY_AXIS = np.ones(3)
HEIGHT_ONLY = np.array([np.inf, np.inf, 1.0])


@dataclass(frozen=True, eq=False)
class Walk:
    """Cameras along a passage of 15 m that climbs 3 m, in the world and in a model of it."""

    world: Array
    """(N, 3) m."""
    sfm: Array
    """(N, 3)"""
    rotations: Array
    """(N, 3, 3) cam_from_sfm."""
    world_from_sfm: Array
    """(3, 3) rotation."""

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{n}.jpg" for n in range(len(self.world)))

    def anchors(self, world: Array, spread: Array = EVERY_AXIS, source: str = "camera positions") -> Anchors:
        return Anchors(source, self.names, self.sfm, world, spread)

    def place(self, *clues: Clue) -> Georeference:
        return place(self.sfm, self.rotations, clues)

    def errors(self, found: Georeference) -> tuple[float, float]:
        """Return how far the scale (relative) and the up axis (degrees) are off."""
        up = found.world_from_sfm.rotation[2] @ self.world_from_sfm[2]
        off = abs(np.log(found.world_from_sfm.scale / SCALE))
        return float(off), float(np.rad2deg(np.arccos(min(up, 1.0))))


def turn(rng: np.random.Generator) -> Array:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def walk(rng: np.random.Generator, count: int = 20) -> Walk:
    along = np.linspace(0.0, 1.0, count)[:, None]
    world = along * [15.0, 4.0, 3.0] + np.cumsum(rng.normal(0.0, 0.1, (count, 3)), axis=0)
    world += rng.normal(0.0, 0.3, (count, 3))
    world_from_sfm = turn(rng)
    cameras = np.array([look(*angles) for angles in rng.uniform([-3.0, -0.4], [3.0, 0.4], (count, 2))])
    sfm = (world - rng.normal(size=3)) @ world_from_sfm / SCALE
    return Walk(world, sfm, cameras @ world_from_sfm, world_from_sfm)


def test_exact_positions_give_back_the_transform_they_were_made_with(rng: np.random.Generator) -> None:
    cave = walk(rng, 6)
    found = cave.place(cave.anchors(cave.world))
    assert found.world_from_sfm.scale == pytest.approx(SCALE)
    np.testing.assert_allclose(found.world_from_sfm.apply(cave.sfm), cave.world, atol=1e-6)
    assert found.scale_error is not None and found.scale_error < 1e-6


@pytest.mark.parametrize(("spread", "noise"), [(EVERY_AXIS, 0.05), (HEIGHT_ONLY, 0.05)], ids=["positions", "depths"])
def test_the_stated_intervals_hold_the_truth_in_95_of_100_draws(spread: Array, noise: float) -> None:
    draws, scale_held, up_held = 80, 0, 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        cave = walk(rng, 20)
        found = cave.place(cave.anchors(cave.world + rng.normal(0.0, noise, cave.world.shape), spread))
        scale_error, up_error = cave.errors(found)
        assert found.scale_error is not None
        scale_held += scale_error <= np.log1p(found.scale_error)
        up_held += up_error <= found.up_error_deg
    # Of 80 draws at 95 %, 71 or fewer have a chance of 1 in 100; up takes the longer axis of its error all round.
    assert 72 <= scale_held
    assert 72 <= up_held


def test_intervals_are_not_wider_than_the_errors_call_for() -> None:
    ratios = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        cave = walk(rng, 20)
        found = cave.place(cave.anchors(cave.world + rng.normal(0.0, 0.05, cave.world.shape)))
        assert found.scale_error is not None
        ratios.append(cave.errors(found)[0] / found.scale_error)
    # A normal error's root mean square is 0.51 of its 95 % interval.
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 0.8


def test_mistakes_are_left_out_and_named(rng: np.random.Generator) -> None:
    cave = walk(rng)
    measured = cave.world + rng.normal(0.0, 0.03, cave.world.shape)
    measured[[3, 11]] += [[9.0, 0.0, 0.0], [0.0, 0.0, 2.0]]
    found = cave.place(cave.anchors(measured))
    assert cave.errors(found)[0] < 0.01
    assert found.sources[0]["left_out"] == ["3.jpg", "11.jpg"]
    assert [caution.code for caution in found.cautions] == ["doubtful-scale-items"]
    assert "2 of 20 camera positions contradict" in found.cautions[0].message


@pytest.mark.parametrize(("off", "is_told"), [(0.015, False), (0.2, True)])
def test_positions_that_are_off_by_little_are_left_out_without_a_warning(
    off: float, is_told: bool, rng: np.random.Generator
) -> None:
    cave = walk(rng)  # 15 m long
    measured = cave.world + rng.normal(0.0, 0.001, cave.world.shape)
    measured[7, 1] += off
    found = cave.place(cave.anchors(measured))
    assert found.sources[0]["left_out"] == ["7.jpg"]
    assert ["1 of 20 camera positions contradict" in one.message for one in found.cautions] == [True] * is_told


def test_in_a_long_cave_positions_a_photos_step_off_are_told_of(rng: np.random.Generator) -> None:
    cave = walk(rng, 40)
    long = Walk(20.0 * cave.world, cave.sfm, cave.rotations, cave.world_from_sfm)  # 300 m, 1 % of which is 3 m
    measured = long.world + rng.normal(0.0, 0.02, long.world.shape)
    measured[9, 0] += 1.0
    found = long.place(long.anchors(measured))
    assert [caution.code for caution in found.cautions] == ["doubtful-scale-items"]


def test_positions_given_to_the_wrong_photos_are_not_used(rng: np.random.Generator) -> None:
    cave = walk(rng)
    found = cave.place(cave.anchors(rng.permutation(cave.world) * [1.0, 1.0, 0.1]))
    if found.scale_error is None:
        assert "Names or times may be assigned wrongly" in found.cautions[0].message
    else:  # half of them may fit by chance; then the interval says so
        assert cave.errors(found)[0] < 2.0 * found.scale_error


def test_positions_on_a_line_give_the_scale_and_leave_the_tilt_about_it_to_the_cameras(
    rng: np.random.Generator,
) -> None:
    cave = walk(rng)
    line = np.linspace(0.0, 1.0, 20)[:, None] * [10.0, 3.0, 0.5] + rng.normal(0.0, 0.002, (20, 3))
    straight = Walk(line, line @ cave.world_from_sfm / SCALE, cave.rotations, cave.world_from_sfm)
    found = straight.place(straight.anchors(line + rng.normal(0.0, 0.05, line.shape)))
    scale_error, up_error = straight.errors(found)
    assert scale_error < 0.02
    assert 3.0 < found.up_error_deg < 60.0
    assert up_error < found.up_error_deg


def test_two_sources_together_are_surer_than_each_alone(rng: np.random.Generator) -> None:
    cave = walk(rng)
    depths = cave.anchors(cave.world + rng.normal(0.0, 0.02, cave.world.shape), HEIGHT_ONLY, "depths")
    bars = Lengths("measured distances", ("A to B",), np.array([2.0 / SCALE]), np.array([2.02]), np.array([0.01]))
    alone = [cave.place(clue).scale_error for clue in (depths, bars)]
    both = cave.place(depths, bars)
    assert both.scale_error is not None
    assert all(one is not None and both.scale_error < one for one in alone)
    assert {source["source"] for source in both.sources} == {"depths", "measured distances"}
    assert not both.cautions


def test_the_weighted_mean_of_two_lengths_is_that_of_their_logarithms(rng: np.random.Generator) -> None:
    cave = walk(rng)
    errors = np.array([0.01, 0.03])
    # They differ by one joint standard deviation, so that neither is doubted.
    ratios = SCALE * np.exp([0.0, float(np.hypot(*errors))])
    clues = [Lengths(f"bar {e}", ("A",), np.ones(1), ratios[n : n + 1], np.array([e])) for n, e in enumerate(errors)]
    found = cave.place(*clues)
    weights = errors**-2 / (errors**-2).sum()
    assert np.log(found.world_from_sfm.scale) == pytest.approx(weights @ np.log(ratios))
    assert found.scale_error == pytest.approx(np.expm1(1.959964 * (errors**-2).sum() ** -0.5))


def test_a_source_that_contradicts_a_better_one_is_reported_with_numbers(rng: np.random.Generator) -> None:
    cave = walk(rng)
    good = cave.anchors(cave.world + rng.normal(0.0, 0.02, cave.world.shape))
    bad = Lengths("printed markers", ("marker 3",), np.array([0.1]), np.array([0.1 * SCALE * 1.5]), np.array([0.02]))
    found = cave.place(bad, good)
    assert cave.errors(found)[0] < 0.01
    assert [one["used"] for one in found.sources] == [True, False]
    assert found.cautions[0].code == "scale-sources-disagree"
    assert "times as large as the camera positions" in found.cautions[0].message


def test_positions_give_heading_and_origin_where_something_else_gives_the_scale_better(
    rng: np.random.Generator,
) -> None:
    cave = walk(rng)
    rough = cave.anchors(cave.world + rng.normal(0.0, 0.2, cave.world.shape))
    bar = Lengths("measured distances", ("A to B",), np.array([1.0]), np.array([SCALE]), np.array([1e-4]))
    found = cave.place(rough, bar)
    assert found.sources[0]["source"] == "measured distances"
    assert cave.errors(found)[0] < 3e-4
    assert np.abs(found.world_from_sfm.apply(cave.sfm) - cave.world).max() < 0.5


def test_norths_that_differ_do_not_disturb_scale_and_up(rng: np.random.Generator) -> None:
    cave = walk(rng)
    grid = cave.anchors(cave.world + rng.normal(0.0, 0.02, cave.world.shape))
    east_is_north = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    magnetic = cave.world @ east_is_north.T + [500.0, 0.0, -30.0] + rng.normal(0.0, 0.1, cave.world.shape)
    found = cave.place(grid, cave.anchors(magnetic, source="survey stations"))
    assert not found.cautions
    assert np.abs(found.world_from_sfm.apply(cave.sfm) - cave.world).max() < 0.1


def test_depths_that_count_upwards_are_not_used(rng: np.random.Generator) -> None:
    cave = walk(rng)
    down = cave.anchors(cave.world * [1.0, 1.0, -1.0], HEIGHT_ONLY, "depths")
    found = cave.place(down)
    assert found.scale_error is None
    assert [caution.code for caution in found.cautions] == ["unused-scale-source"]
    assert "wrong direction" in found.cautions[0].message


def test_level_cameras_get_their_mean_up_direction_along_z_and_no_scale(rng: np.random.Generator) -> None:
    cave = walk(rng)
    found = cave.place()
    assert found.world_from_sfm.scale == 1.0
    assert found.scale_error is None
    assert cave.errors(found)[1] < found.up_error_deg < 45.0
    np.testing.assert_allclose(found.world_from_sfm.apply(cave.sfm).mean(axis=0), 0.0, atol=1e-9)
    assert not found.cautions  # the build, which knows of a passage height too, tells whether there is a scale


def test_gravity_gives_up_within_its_error(rng: np.random.Generator) -> None:
    cave = walk(rng)
    felt = cave.world_from_sfm[2] + rng.normal(0.0, 0.03, (20, 3))
    felt /= np.linalg.norm(felt, axis=1, keepdims=True)
    found = cave.place(Ups("phone accelerometers", cave.names, felt, 0.03))
    assert cave.errors(found)[1] < found.up_error_deg < 2.0


def test_far_coordinates_are_brought_to_the_origin_by_whole_metres(rng: np.random.Generator) -> None:
    cave = walk(rng)
    utm = cave.world + [431_000.0, 5_480_000.0, 800.0]
    found = cave.place(cave.anchors(utm))
    assert found.offset is not None
    np.testing.assert_allclose(found.world_from_sfm.apply(cave.sfm) + found.offset, utm, atol=1e-4)
    assert np.abs(found.world_from_sfm.apply(cave.sfm).mean(axis=0)).max() <= 0.5


def test_errors_that_run_in_the_same_direction_widen_the_interval(rng: np.random.Generator) -> None:
    cave = walk(rng, 60)
    steps = rng.normal(0.0, 0.05, cave.world.shape)
    drift = np.zeros_like(steps)
    for index in range(1, 60):
        drift[index] = 0.9 * drift[index - 1] + steps[index]
    prior = cameras_up(cave.rotations)
    drifting = weigh(cave.anchors(cave.world + drift), prior)
    shuffled = weigh(cave.anchors(cave.world + rng.permutation(drift)), prior)
    assert drifting.sigma > 1.5 * shuffled.sigma


def test_three_heights_are_too_few_to_tell_their_errors(rng: np.random.Generator) -> None:
    cave = walk(rng, 3)
    with pytest.raises(InputError, match=r"The depths know only 3 places in the model.*too few"):
        weigh(cave.anchors(cave.world, HEIGHT_ONLY, "depths"), cameras_up(cave.rotations))


@pytest.mark.parametrize("kind", ["anchors", "heights", "lengths", "ups"])
def test_derivatives_are_those_of_the_residuals(kind: str, rng: np.random.Generator) -> None:
    from scipy.spatial.transform import Rotation

    points = rng.normal(size=(5, 3))
    labels = ("a", "b", "c", "d", "e")
    clue: Clue = {
        "anchors": Anchors("p", labels, points, rng.normal(size=(5, 3)), np.array([1.0, 1.0, 2.0])),
        "heights": Anchors("p", labels, points, rng.normal(size=(5, 3)), HEIGHT_ONLY),
        "lengths": Lengths("l", labels, rng.uniform(1, 2, 5), rng.uniform(1, 2, 5), rng.uniform(0.1, 1, 5)),
        "ups": Ups("u", labels, points / np.linalg.norm(points, axis=1, keepdims=True), 0.1),
    }[kind]
    rotation, weights, step = turn(rng), rng.uniform(0.5, 1.0, 5), 1e-6

    def moved(by: Array) -> Array:
        return clue.residuals(2.0 * np.exp(by[0]), Rotation.from_rotvec(by[1:]).as_matrix() @ rotation, weights)

    numeric = np.stack([(moved(step * e) - moved(-step * e)) / (2 * step) for e in np.eye(4)], axis=2)
    np.testing.assert_allclose(clue.derivatives(2.0, rotation, weights), numeric, atol=1e-6)
