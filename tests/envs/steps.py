"""Acting at random in any of the environments."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium


def random_steps(env: gymnasium.Env[Any, Any], count: int, seed: int) -> Iterator[tuple[Any, ...]]:
    """Act at random for some decisions, over as many episodes as it takes."""
    obs, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    yield obs, 0.0, False, False, info
    for _ in range(count):
        step = env.step(env.action_space.sample())
        yield step
        if step[2] or step[3]:
            obs, info = env.reset()
            yield obs, 0.0, False, False, info
