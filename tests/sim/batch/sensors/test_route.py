"""The place ahead on a cave's own route, beside one found with NumPy in the guide and the distance field."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.sensors.route import Route
from aquanav_tools.sim.scales import DISTANCE_SCALE, unsoft
from aquanav_tools.types import Array, rotation_matrix
from tests.evaluate.winding import winding_scenario
from tests.sim.batch.sensors.rooms import room_batch

NUM, NEAR, FAR = 40, 0.8, 4.2


def is_in_sight(scenario: Scenario, position: Array, place: Array) -> bool:
    length = np.linalg.norm(place - position)
    shares = np.linspace(0.2 / length, 1.0, 400)[:, None]
    return bool(scenario.field.clearance(position + shares * (place - position)).min() > 0.2)


def shown_from(scenario: Scenario, position: Array, gate: int) -> Array:
    """Return the farthest panel's centre in sight that is near enough along the route, or the first not too near."""
    ahead = scenario.guide.centres[gate + 1 :]
    along = np.linalg.norm(np.diff(np.vstack([position, ahead]), axis=0), axis=1).cumsum()
    beyond = [n for n in range(len(ahead)) if along[n] >= NEAR]
    if not beyond:
        return np.array(scenario.settings.goal.position)
    best = beyond[0]
    for n in beyond[1:]:
        if along[n] > FAR or not is_in_sight(scenario, position, ahead[n]):
            break
        best = n
    return np.asarray(ahead[best])


@pytest.fixture(scope="module")
def env() -> CaveVectorEnv:
    return CaveVectorEnv(NUM, winding_scenario(), observation={"route": Route(error=0.0, lost=0.0)}, starts="anywhere")


def test_it_shows_the_farthest_place_of_the_route_in_sight(env: CaveVectorEnv) -> None:
    scenario = winding_scenario()
    read, state = env.reset(seed=3)[0]["route"], env.batch.world.arrays
    positions, turns, gates = (getattr(state, name).numpy() for name in ("positions", "orientations", "gates"))
    far = 0
    for values, position, turn, gate in zip(read, positions, turns, gates, strict=True):
        offset, rotation = shown_from(scenario, position, int(gate)) - position, rotation_matrix(turn)
        azimuth = np.arctan2(offset[1], offset[0]) - np.arctan2(rotation[1, 0], rotation[0, 0])
        elevation = np.arctan2(offset[2], np.hypot(offset[0], offset[1]))
        assert np.exp(1j * np.pi * values[1]) == pytest.approx(np.exp(1j * azimuth), abs=1e-4)
        assert 0.5 * np.pi * values[2] == pytest.approx(elevation, abs=1e-4)
        far += bool(np.linalg.norm(offset) > 2.0)
    assert NUM // 4 < far  # of the places, most are not the very next panel


def test_its_length_is_what_is_left_of_the_guide_and_the_unknown_share_says_nothing(env: CaveVectorEnv) -> None:
    read, state = env.reset(seed=4)[0]["route"], env.batch.world.arrays
    lengths = [unsoft(float(value), DISTANCE_SCALE) for value in read[:, 0]]
    np.testing.assert_allclose(lengths, state.remaining.numpy(), rtol=1e-4)
    drawn = np.concatenate([env.reset(seed=1000 * n)[0]["route"][:, -1] for n in range(25)])
    assert drawn.mean() == pytest.approx(0.5, abs=5.0 / np.sqrt(12 * len(drawn)))
    assert 0.0 <= drawn.min() < 0.01 and 0.99 < drawn.max() <= 1.0


def test_places_are_off_by_as_much_as_is_said_and_stay_so_for_ten_decisions() -> None:
    """The goal of an empty room, 4 m ahead, seen by level vehicles: its angles are off by about error / distance."""
    num, error, distance = 20_000, 0.2, 4.0
    positions = np.tile([-distance, 0.0, 0.0], (num, 1))
    batch = room_batch(positions=positions, seeds=np.arange(num))
    route = Route(error, lost=0.0)
    first = route.measure(batch).copy()
    angles = first[:, 1:3] * [np.pi, 0.5 * np.pi]
    np.testing.assert_allclose(angles.mean(axis=0), 0.0, atol=5 * error / distance / np.sqrt(num))
    np.testing.assert_allclose(
        angles.std(axis=0), error / distance, rtol=5 / np.sqrt(2 * num) + (error / distance) ** 2
    )
    batch.state.decisions.fill_(9)
    assert np.array_equal(route.measure(batch)[:, 1:3], first[:, 1:3])
    batch.state.decisions.fill_(10)
    assert abs(np.corrcoef(route.measure(batch)[:, 1], first[:, 1])[0, 1]) < 5 / np.sqrt(num)


def test_in_a_fifth_of_all_stretches_the_way_is_lost_and_leads_straight_to_the_goal() -> None:
    num, scenario = 2000, winding_scenario()
    seen = {"sure": Route(error=0.0, lost=0.0), "misled": Route(error=0.0), "lost": Route(error=0.0, lost=1.0)}
    env = CaveVectorEnv(num, scenario, observation=seen, starts="anywhere")  # type: ignore[arg-type]
    read, state = env.reset(seed=5)[0], env.batch.world.arrays
    offsets = np.array(scenario.settings.goal.position) - state.positions.numpy()
    elevations = np.arctan2(offsets[:, 2], np.hypot(offsets[:, 0], offsets[:, 1]))
    np.testing.assert_allclose(0.5 * np.pi * read["lost"][:, 2], elevations, atol=1e-4)
    is_lost = (read["misled"][:, 1:3] == read["lost"][:, 1:3]).all(axis=1)
    assert np.array_equal(read["misled"][~is_lost][:, 1:3], read["sure"][~is_lost][:, 1:3])
    is_apart = (read["sure"][:, 1:3] != read["lost"][:, 1:3]).any(axis=1)
    share = is_lost[is_apart].mean()
    assert share == pytest.approx(0.2, abs=5 * 0.4 / np.sqrt(is_apart.sum()))
