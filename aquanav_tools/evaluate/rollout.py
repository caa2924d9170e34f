"""Running one episode and keeping what happened."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.evaluate.policies import Policy
from aquanav_tools.evaluate.protocol import EpisodePlan
from aquanav_tools.report.track import Track

TERM_PREFIX = "reward/"


def run_episode(env: CaveEnv, policy: Policy, plan: EpisodePlan) -> Track:
    """Return the track of one episode, from the planned start to its end."""
    policy.reset(plan.seed)
    observation, info = env.reset(seed=plan.seed, options=_start(plan))
    infos, actions, rewards = [info], [], []
    is_over = False
    while not is_over:
        action = policy.act(observation)
        observation, reward, terminated, truncated, info = env.step(action)
        is_over = terminated or truncated
        infos.append(info)
        actions.append(action)
        rewards.append(reward)
    limits = env.scenario.settings.limits
    return _collect(plan, infos, actions, rewards, limits.dt * limits.substeps)


def _start(plan: EpisodePlan) -> dict[str, Any]:
    return {} if plan.start_index is None else {"start": plan.start_index}


def _collect(
    plan: EpisodePlan, infos: list[dict[str, Any]], actions: list[Any], rewards: list[float], dt: float
) -> Track:
    terms = [name for name in infos[0] if name.startswith(TERM_PREFIX)]

    def column(name: str) -> Any:
        return np.array([info[name] for info in infos])

    return Track(
        seed=plan.seed,
        start_index=infos[0]["start_index"],
        outcome=infos[-1]["outcome"],
        times=dt * np.arange(len(infos), dtype=np.float64),
        positions=column("position"),
        orientations=column("orientation"),
        rays=column("rays"),
        clearances=column("clearance"),
        collided=column("collision"),
        progress=column("progress"),
        costs=column("cost"),
        actions=np.array(actions, dtype=np.float64).reshape(len(actions), -1),
        rewards=np.array(rewards, dtype=np.float64),
        reward_terms={name.removeprefix(TERM_PREFIX): column(name)[1:] for name in terms},
        num_collisions=infos[-1]["num_collisions"],
    )
