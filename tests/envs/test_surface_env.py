"""The surface task: Gymnasium's contract, determinism, what beams see, contacts, and the reward of a straight run."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from shapely.geometry import LineString, MultiLineString, Point, Polygon, box
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

import aquanav_tools.envs
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.envs.surface_observation import surface_layout
from aquanav_tools.errors import InputError
from aquanav_tools.sea.generate import MapSettings, generate_map
from aquanav_tools.sea.sea_map import Berth, Goal, Rock, SeaMap, ShortestPath
from aquanav_tools.sim.batch.boat_contact import clearances_of
from aquanav_tools.sim.batch.boat_rays import cast_discs
from aquanav_tools.sim.boat import DENSITY
from aquanav_tools.types import Array
from tests.envs.steps import random_steps

AHEAD, IDLE = [1, 2], [1, 1]
EDGE = np.array([-60.0, -30.0, 60.0, 30.0])
DISTURBED = {
    "sensor_noise": 0.05,
    "sensor_dropout": 0.1,
    "action_delay": 1,
    "observation_delay": 2,
    "current": 0.3,
    "current_range": (0.5, 1.5),
    "reward": "safe",
}
BOATS = pytest.mark.parametrize("vehicle", ["otter", "boat"])


def bay_with(*rocks: Rock, goal: tuple[float, float] = (50.0, 0.0), heading: float = 0.0) -> SeaMap:
    """Return a bay whose boat begins at (-40, 0)."""
    start, end = np.array([-40.0, 0.0]), np.array(goal)
    way = ShortestPath(np.array([start, end]), float(np.linalg.norm(end - start)) - 5.0, 1.0)
    return SeaMap("test", EDGE, 6.0, rocks, Goal(end[None], 5.0), (Berth(start, heading),), (way,))


def block(x: float, top: float, half: float = 6.0) -> Rock:
    """Return a rock across the way whose near side is at x, m."""
    return Rock(np.array([[x, -half], [x + 8.0, -half], [x + 8.0, half], [x, half]]), top)


def run(env: SurfaceEnv, action: Any, count: int) -> list[dict[str, Any]]:
    """Return the info of a reset and of each decision of a held action, to the episode's end at most."""
    infos = [env.reset(seed=3)[1]]
    for _ in range(count):
        _, _, terminated, truncated, info = env.step(action)
        infos.append(info)
        if terminated or truncated:
            break
    return infos


@pytest.mark.parametrize("observation", ["paper", "full", "original"])
@pytest.mark.parametrize("options", [{}, DISTURBED], ids=["plain", "disturbed"])
def test_the_checkers_of_gymnasium_and_sb3_accept_it(observation: str, options: dict[str, Any]) -> None:
    env = SurfaceEnv(observation=observation, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
        check_env_for_sb3(env)


def test_it_is_registered() -> None:
    assert aquanav_tools.envs.__doc__
    env = gymnasium.make("aquanav/Surface-v0", sea="still", observation="paper")
    assert env.reset(seed=0)[0].shape == (9,)


@pytest.mark.parametrize("sea", ["still", "rough"])
@pytest.mark.parametrize("options", [{}, DISTURBED], ids=["plain", "disturbed"])
def test_a_seed_repeats_bit_for_bit(sea: str, options: dict[str, Any]) -> None:
    first, second = (SurfaceEnv(sea=sea, max_decisions=40, **options) for _ in range(2))
    list(random_steps(second, 10, 9))
    for one, other in zip(random_steps(first, 60, 4), random_steps(second, 60, 4), strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:4] == other[1:4]
        for name, value in one[4].items():
            np.testing.assert_array_equal(value, other[4][name])


@pytest.mark.parametrize("action", ["multidiscrete", "discrete", "continuous"])
@BOATS
def test_observations_are_in_the_space_and_everything_is_finite(vehicle: str, action: str) -> None:
    env = SurfaceEnv(sea="breeze", vehicle=vehicle, action=action, max_decisions=60)
    for obs, reward, _, _, info in random_steps(env, 150, 0):
        assert env.observation_space.contains(obs)
        assert np.isfinite(reward)
        assert np.isfinite(info["position"]).all()
        assert np.isfinite(info["velocity"]).all()


def test_no_element_of_the_observation_is_constant() -> None:
    env = SurfaceEnv(sea="breeze", max_decisions=30)
    seen = np.array([step[0] for step in random_steps(env, 240, 1)])
    assert (np.ptp(seen, axis=0) > 0.0).all()


PRICES = {"dense": (10.0, -0.01, -0.01, 0.0), "safe": (10.0, -0.01, -0.01, -0.1)}
"""Of progress, m, and of each of 5 physics steps: time, contact, and share of beams lost."""


@pytest.mark.parametrize("reward", PRICES)
def test_reward_is_what_the_table_pays_for_what_info_tells(reward: str) -> None:
    progress, time, contact, proximity = PRICES[reward]
    env = SurfaceEnv(bay_with(block(-25.0, 3.0)), sea="still", reward=reward)
    _, info = env.reset(seed=0)
    remaining = info["remaining"]
    for _, total, _, _, info in (env.step([1, 2]) for _ in range(30)):
        num_contacts = round(info["reward/contact"] / contact) if contact else 0
        assert not contact or ((num_contacts > 0) == info["collision"] and num_contacts <= 5)
        lost = float((1.0 - info["rays"] / 30.0).sum())
        paid = progress * (remaining - info["remaining"]) + 5 * (time + proximity * lost) + contact * num_contacts
        assert info["outcome"] == "running"
        assert total == pytest.approx(paid, abs=1e-5)  # rays are in float32
        remaining = info["remaining"]
    env.close()


def test_the_sensors_term_is_a_tenth_per_step_and_share_of_beam_lost() -> None:
    info = run(SurfaceEnv(bay_with(block(-25.0, 3.0)), sea="still", reward="safe"), IDLE, 1)[-1]
    lost = float((1.0 - info["rays"] / 30.0).sum())
    assert lost > 0.4  # the one ahead meets the rock after 14 m
    assert info["reward/proximity"] == pytest.approx(-0.1 * 5 * lost, rel=1e-5)


@pytest.mark.parametrize("radius", [0.0, 1.0])
def test_beams_end_where_shapely_meets_the_grown_outlines(radius: float, rng: np.random.Generator) -> None:
    num_hits = 0
    for seed in range(8):
        sea = generate_map(seed)
        # shapely's round corners are polygons; 512 sides a quarter are within 1e-5 m of a circle of 1 m
        walls = [Polygon(rock.outline).buffer(radius, quad_segs=512).exterior for rock in sea.rocks]
        walls.append(box(*(sea.edge + radius * np.array([1.0, 1.0, -1.0, -1.0]))).exterior)
        solid = MultiLineString([LineString(wall.coords) for wall in walls])
        for _ in range(40):
            place, angle = rng.uniform(sea.edge[:2], sea.edge[2:]), rng.uniform(-np.pi, np.pi)
            if sea.clearance_at(place) < radius:
                continue
            way = np.array([np.cos(angle), np.sin(angle)])
            met = LineString([place, place + 30.0 * way]).intersection(solid)
            expected = 30.0 if met.is_empty else Point(place).distance(met)
            found = cast_discs(sea, place[None], way[None], 30.0, radius)[0]
            assert found == pytest.approx(expected, abs=2e-3)
            num_hits += expected < 30.0
    assert num_hits > 50


def test_clearance_of_a_hull_is_shapelys_distance(rng: np.random.Generator) -> None:
    outline = np.array([[-1.0, -0.5], [1.0, -0.5], [1.4, 0.0], [1.0, 0.5], [-1.0, 0.5]])
    for seed in range(6):
        sea = generate_map(seed)
        solid = [Polygon(rock.outline) for rock in sea.rocks]
        shore = box(*sea.edge).exterior
        for _ in range(30):
            hull = outline @ _turn(rng.uniform(-np.pi, np.pi)) + rng.uniform(sea.edge[:2] + 2.0, sea.edge[2:] - 2.0)
            shape = Polygon(hull)
            expected = min(shape.distance(other) for other in [*solid, shore])
            found = clearances_of(sea, hull[None], 0.0)[0]
            assert found == pytest.approx(expected, abs=1e-9) if expected > 0.0 else found <= 0.0


def _turn(angle: float) -> Array:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


@BOATS
@pytest.mark.parametrize("sea", ["still", "rough"])
def test_a_boat_driven_at_a_rock_is_stopped_by_it(vehicle: str, sea: str) -> None:
    half = 20.0  # wide enough to be met off course: nothing steers against wind and waves
    env = SurfaceEnv(bay_with(block(-25.0, 3.0, half)), vehicle=vehicle, sea=sea)
    infos = run(env, AHEAD, 100)
    assert any(info["collision"] for info in infos)
    assert infos[-1]["num_collisions"] >= 1
    assert max(info["position"][0] for info in infos if abs(info["position"][1]) < half - 1.0) < -25.0
    assert min(info["clearance"] for info in infos) > -1e-9


@BOATS
def test_a_rock_gives_a_drifting_boat_no_speed(vehicle: str) -> None:
    bow = {"otter": -39.0, "boat": -35.3}[vehicle]
    env = SurfaceEnv(bay_with(block(bow + 0.5, 3.0), heading=0.3), vehicle=vehicle, sea="still")
    env.reset(seed=0)
    env._batch.world.as_numpy("velocities")[0, 0] = 3.0
    infos = [env.step(IDLE)[4] for _ in range(60)]
    speeds = [float(np.linalg.norm(info["velocity"][:3])) for info in infos]
    assert infos[-1]["num_collisions"] >= 1
    assert max(speeds) < 3.0


def test_a_collision_ends_the_episode_where_it_should() -> None:
    env = SurfaceEnv(bay_with(block(-35.0, 3.0)), sea="still", on_collision="end", reward="dense")
    infos = run(env, AHEAD, 100)
    assert infos[-1]["outcome"] == "collision"
    assert infos[-1]["reward/collision"] == -1000.0


@pytest.mark.parametrize(("above", "touches"), [(0.01, True), (-0.05, False)])
def test_a_reef_is_touched_where_it_reaches_the_keel(above: float, touches: bool) -> None:
    """Afloat at rest the Otter's keels are at its draught; under way it trims by a few centimetres at most."""
    draught = SurfaceEnv().vehicle.draught(DENSITY)
    env = SurfaceEnv(bay_with(block(-38.6, above - draught)), sea="still")
    infos = run(env, [1, 1], 0)
    env._batch.world.as_numpy("velocities")[0, 0] = 1.0
    infos += [env.step(IDLE)[4] for _ in range(120)]
    assert infos[0]["rays"][0] == pytest.approx(0.4, abs=1e-5)  # beams of 1 m radius see it either way
    assert any(info["collision"] for info in infos) == touches


def test_a_beam_without_echo_reads_its_length_and_says_that_it_met_nothing() -> None:
    seen = []
    for dropout in (0.0, 0.4):
        env = SurfaceEnv(bay_with(block(-30.0, 3.0, 25.0)), sea="still", observation="original", sensor_dropout=dropout)
        env.reset(seed=1)
        seen.append(np.array([env.step(IDLE)[0][:28].reshape(7, 4) for _ in range(60)]))
    echoes, lossy = seen
    is_lost = (echoes[..., 0] == 1.0) & (lossy[..., 2] == 1.0)
    num_echoes = int(echoes[..., 0].sum())
    assert is_lost.sum() / num_echoes == pytest.approx(0.4, abs=4.0 * np.sqrt(0.24 / num_echoes))
    assert (lossy[is_lost] == [0.0, 0.0, 1.0, 1.0]).all()
    np.testing.assert_array_equal(lossy[~is_lost], echoes[~is_lost])


def test_a_collision_counts_once_while_it_lasts_and_again_after_a_free_decision() -> None:
    env = SurfaceEnv(bay_with(block(-38.0, 3.0, 25.0)), sea="still")
    infos = run(env, AHEAD, 30)
    for _ in range(12):
        infos.append(env.step([1, 0])[4])
    infos += [env.step(AHEAD)[4] for _ in range(30)]
    touches = [info["collision"] for info in infos]
    begun = sum(now and not before for before, now in zip([False, *touches[:-1]], touches, strict=True))
    assert begun >= 2 and sum(touches) > begun
    assert infos[-1]["num_collisions"] == begun


def test_a_straight_run_in_open_water_pays_for_the_way_and_succeeds() -> None:
    env = SurfaceEnv(bay_with(), sea="still", reward="dense")
    infos = run(env, AHEAD, 1000)
    last = infos[-1]
    assert last["outcome"] == "success"
    assert last["remaining"] <= 5.0
    assert sum(info["reward/progress"] for info in infos) == pytest.approx(10.0 * (90.0 - last["remaining"]))
    assert last["reward/goal"] == 500.0
    assert last["progress"] == pytest.approx(90.0 - last["remaining"])
    seconds = 0.1 * (len(infos) - 1)
    assert 85.0 / 3.4 < seconds < 85.0 / 2.4  # the Otter makes 6 knots, 3.1 m/s


def test_time_runs_out() -> None:
    infos = run(SurfaceEnv(bay_with(), sea="still", max_decisions=5, reward="sparse"), IDLE, 10)
    assert len(infos) == 6
    assert infos[-1]["outcome"] == "timeout"
    assert infos[-1]["reward/timeout"] == -1.0


def test_an_idle_boat_drifts_with_the_current() -> None:
    """Drag pulls the boat to the water's velocity: within a few per cent after 30 s, as gusts are slower than it."""
    env = SurfaceEnv(bay_with(), sea="still", current=(0.3, -0.1, 0.0))
    last = run(env, IDLE, 300)[-1]
    moved = last["position"][:2] - [-40.0, 0.0]
    assert np.linalg.norm(moved / 30.0 - [0.3, -0.1]) < 0.1
    assert np.linalg.norm(last["current"]) == pytest.approx(0.316, rel=0.5)


def test_each_episode_has_another_bay_unless_it_is_fixed() -> None:
    env, fixed = SurfaceEnv(sea="still"), SurfaceEnv(7, sea="still")
    starts = [env.reset(seed=seed)[1]["position"] for seed in (1, 2, 1)]
    assert not np.allclose(starts[0], starts[1])
    np.testing.assert_array_equal(starts[0], starts[2])
    np.testing.assert_array_equal(fixed.reset(seed=1)[1]["position"], fixed.reset(seed=2)[1]["position"])
    assert fixed.reset()[1]["path_length"] == fixed.sea_map.paths[0].length


def test_a_start_drawn_anywhere_is_free_and_has_a_way() -> None:
    env = SurfaceEnv(7, sea="still", starts="anywhere")
    infos = [env.reset(seed=seed)[1] for seed in range(5)]
    assert all(info["clearance"] > -0.6 and info["start_index"] == -1 for info in infos)  # bow and stern may be nearer
    assert all(info["path_length"] >= info["remaining"] - 5.0 - 1e-9 for info in infos)


def test_the_originals_bay_has_its_starts_and_its_goal_is_seen_untagged(data_dir: Path) -> None:
    scene = data_dir / "saferlauv" / "surface" / "train.json"
    env = SurfaceEnv(scene, vehicle="boat", observation="original", sea="still")
    observation, info = env.reset(options={"start": 0})
    assert observation.shape == (36,)
    np.testing.assert_allclose(info["position"], [-84.7, -13.1, 0.0])
    # the goal's centre is at (83.1, -11.4): 1.7 m to the left after 167.8 m
    angles = observation[surface_layout("original")["angles"]]
    assert angles[0] == pytest.approx(-np.degrees(np.arctan2(1.7, 167.8)), abs=1e-4)
    env._batch.world.as_numpy("positions")[0, :2] = 70.0, -11.4
    sensed = env.step(IDLE)[0][:4]
    assert sensed[:3].tolist() == [0.0, 0.0, 0.0]
    assert sensed[3] < 0.5


@pytest.mark.parametrize(
    ("options", "advice"),
    [
        ({"sea": "ruff"}, "rough"),
        ({"observation": "papre"}, "paper"),
        ({"progress": "geodesic"}, "panels"),
        ({"current": (0.1, 0.0, 0.2)}, "third number is 0"),
        ({"current": "stil"}, "still"),
        ({"vehicle": "oter"}, "otter"),
        ({"max_decisions": 0}, "at least 1"),
        ({"reward": "dens"}, "dense"),
        ({"bay": MapSettings(density=0.3, clearance=20.0)}, "lower density"),
    ],
)
def test_a_senseless_option_is_refused_with_advice(options: dict[str, Any], advice: str) -> None:
    with pytest.raises(InputError, match=advice):
        SurfaceEnv(**options).reset(seed=0)


def test_pictures_show_sea_sky_rock_and_boat() -> None:
    env = SurfaceEnv(bay_with(block(-15.0, 2.0)), sea="calm", render_mode="rgb_array", render_size=(160, 120))
    env.reset(seed=1)
    picture = env.render()
    assert picture is not None
    assert (picture.shape, picture.dtype) == ((120, 160, 3), np.uint8)
    red, _, blue = picture.astype(float).reshape(-1, 3).T
    assert (blue[:1600] > red[:1600]).all()  # the sky above
    assert (blue[-1600:] > red[-1600:]).mean() > 0.9  # the water in front of the camera
    is_orange = (red > 150.0) & (blue < 0.5 * red)
    assert 0.002 < is_orange.mean() < 0.2
    bare = SurfaceEnv(bay_with(), sea="calm", render_mode="rgb_array", render_size=(160, 120))
    bare.reset(seed=1)
    without = bare.render()
    assert without is not None
    changed = (picture.astype(int) != without).any(axis=2)
    rows, columns = np.nonzero(changed)
    assert 0.02 < changed.mean() < 0.6 and 40 < columns.mean() < 120 and rows.min() < 60  # straight ahead
    np.testing.assert_array_equal(picture, env.render())


def test_a_picture_follows_the_boat_and_the_waves() -> None:
    env = SurfaceEnv(7, sea="rough", render_mode="rgb_array", render_size=(96, 72))
    env.reset(seed=1)
    first = env.render()
    env.step(IDLE)
    assert (first != env.render()).any()


def test_too_small_pictures_are_refused() -> None:
    with pytest.raises(InputError, match="at least 64 px"):
        SurfaceEnv(render_mode="rgb_array", render_size=(32, 32))
