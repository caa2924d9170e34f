"""A cave made larger or smaller, held against a tube of another radius and length in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.cavity import to_manifold
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.scenario.scaling import scaled
from aquanav_tools.sim.sensors import original_pattern
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_clearance, tube_scenario
from tests.sim.batch.waters import Episodes
from tests.sim.test_water import flowing


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.7])
def test_a_scaled_tube_is_the_tube_of_that_size(factor: float, rng: np.random.Generator) -> None:
    small, tube = scaled(tube_scenario(), factor), tube_scenario()
    points = rng.uniform([0.2, -1.3, -1.3], [TUBE_LENGTH - 0.2, 1.3, 1.3], (200, 3))
    # Interpolation errs by 3/8 spacing^2 / R in the tube, and in proportion in the other one.
    np.testing.assert_allclose(
        small.field.clearance(factor * points), factor * tube_clearance(points), atol=0.06 * factor
    )
    volume = small.cavity.volume
    assert volume == pytest.approx(factor**3 * np.pi * TUBE_RADIUS**2 * TUBE_LENGTH, rel=0.01)
    assert to_manifold(small.cavity.mesh).volume() == pytest.approx(volume)
    assert small.guide.length == pytest.approx(factor * tube.guide.length)
    assert small.guide.radii == pytest.approx(factor * TUBE_RADIUS)
    assert small.cavity.portals[1].area == pytest.approx(factor**2 * np.pi * TUBE_RADIUS**2, rel=0.01)
    assert small.settings.goal.position == pytest.approx(small.guide.centres[-1])
    assert small.starts[3].geodesic_to_goal == pytest.approx(factor * tube.starts[3].geodesic_to_goal)


def test_rays_meet_the_wall_of_the_scaled_tube() -> None:
    env = CaveEnv(scaled(tube_scenario(), 0.5), current="still", contacts="own", observation="paper")
    observation, _ = env.reset(seed=0, options={"start": 0})
    x, y, z = env.state[:3]
    assert (x, y, z) == pytest.approx((0.75, -0.25, 0.0))
    pattern = original_pattern()
    across = pattern.directions[:, 1:]  # it looks along the tube
    steepness, along, room = (across**2).sum(axis=1), across[:, 0] * y, (0.5 * TUBE_RADIUS) ** 2 - y**2
    distances = (np.sqrt(along**2 + steepness * room) - along) / steepness
    expected = np.minimum(distances / pattern.lengths, 1.0)
    assert (expected < 1.0).sum() > 20
    np.testing.assert_allclose(observation[:28], expected, atol=0.01)
    env.close()


def test_water_keeps_its_speed_at_the_place_that_moved() -> None:
    before, after = Episodes(flowing(), "half", range(500)), Episodes(scaled(flowing(), 0.5), "half", range(500))
    middle = np.array([[10.0, 0.3, 0.2]])
    mean = [
        episodes.velocities(factor * middle)[:, 0].mean(axis=0) for episodes, factor in ((before, 1.0), (after, 0.5))
    ]
    np.testing.assert_allclose(mean[1], mean[0], atol=0.02)
