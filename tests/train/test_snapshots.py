from __future__ import annotations

import numpy as np

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.train.environment_group import EnvironmentGroup
from aquanav_tools.train.settings import TrainSettings

NUM = 2


def test_environments_come_back_to_the_bit_even_amid_contacts(tube: Scenario, rng: np.random.Generator) -> None:
    # Half a metre of current across the tube presses the vehicle against the wall, where PyBullet takes over.
    settings = TrainSettings(sensor_noise=0.05, action_delay=2, current=(0.0, 0.5, 0.1), current_range=(0.5, 1.0))
    group, other = EnvironmentGroup([tube] * NUM, settings), EnvironmentGroup([tube] * NUM, settings)
    group.reset([5, 6])
    other.reset([7, 8])
    actions = rng.integers(3, size=(160, NUM, 3))
    for action in actions[:120]:
        group.step(action)
    assert any(env.unwrapped._arrays["collisions"][0] for env in group._envs), "no contact, so that nothing is tested"
    other.restore(group.snapshots())
    for action in actions[120:]:
        one, two = group.step(action), other.step(action)
        assert np.array_equal(one.observations, two.observations) and np.array_equal(one.rewards, two.rewards)
    group.close()
    other.close()
