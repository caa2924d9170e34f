"""Running one episode and keeping what happened, whatever the policy does."""

from __future__ import annotations

import dataclasses
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from aquanav_tools.envs.action import ACTIONS, ActionModel
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.evaluate.policies import Boarding, Policy
from aquanav_tools.evaluate.protocol import EpisodePlan
from aquanav_tools.report.track import FAILED, Track

TERM_PREFIX = "reward/"
ACTION_TIME_LIMIT = 30.0
"""Wall time in which a policy must give an action, s: hundreds of times what any network here takes."""


class _HangError(Exception):
    """A policy took too long."""


def run_episode(env: CaveEnv, policy: Policy, plan: EpisodePlan, time_limit: float = ACTION_TIME_LIMIT) -> Track:
    """Return the track of one episode, from the planned start to its end.

    A policy that raises an error, gives no action of its form, or takes more than `time_limit` seconds for one ends
    its episode with the outcome FAILED and the reason. Time is watched on the main thread of Unix systems only, and a
    policy that hangs in compiled code is noticed when that returns.
    """
    observation, info = env.reset(seed=plan.seed, options=_start(plan))
    if isinstance(policy, Boarding):
        policy.board(env)
    form = next(model for model in map(ActionModel, ACTIONS) if model.space == env.action_space)
    infos, actions, commands, rewards = [info], [], [], []
    is_over, reason = False, _failure(lambda: policy.reset(plan.seed), time_limit)[1]
    while not is_over and not reason:
        chosen, reason = _failure(lambda seen=observation: _choose(policy, form, seen), time_limit)
        if reason:
            break
        action, command = chosen
        observation, reward, terminated, truncated, info = env.step(action)
        is_over = terminated or truncated
        infos.append(info)
        actions.append(action)
        commands.append(command)
        rewards.append(reward)
    limits = env.scenario.settings.limits
    track = _collect(plan, infos, (actions, commands, rewards), limits.dt * limits.substeps, reason)
    return dataclasses.replace(track, interventions=getattr(policy, "interventions", None))


def _choose(policy: Policy, form: ActionModel, observation: Any) -> tuple[Any, tuple[float, ...]]:
    """Return the policy's action and the command that it means; raises where it is no action."""
    action = policy.act(observation)
    if not np.isfinite(np.asarray(action, dtype=np.float64)).all():
        raise ValueError(f"it gave {action!r}, which is not finite")
    return action, tuple(form.command(action))


def _failure(call: Any, time_limit: float) -> tuple[Any, str]:
    """Return what a call returns and "", or None and why it failed."""
    try:
        with _alarm(time_limit):
            return call(), ""
    except _HangError:
        return None, f"gave no action within {time_limit:g} s"
    except Exception as error:  # a policy is foreign code: whatever it raises costs this episode only
        return None, f"{type(error).__name__}: {error}".strip()[:500]


@contextmanager
def _alarm(time_limit: float) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def ring(*_: object) -> None:
        raise _HangError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, time_limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _start(plan: EpisodePlan) -> dict[str, Any]:
    return {} if plan.start_index is None else {"start": plan.start_index}


def _collect(
    plan: EpisodePlan,
    infos: list[dict[str, Any]],
    done: tuple[list[Any], list[Any], list[float]],
    dt: float,
    reason: str,
) -> Track:
    actions, commands, rewards = done
    terms = [name for name in infos[0] if name.startswith(TERM_PREFIX)]

    def column(name: str) -> Any:
        return np.array([info[name] for info in infos])

    return Track(
        seed=plan.seed,
        start_index=infos[0]["start_index"],
        outcome=FAILED if reason else infos[-1]["outcome"],
        times=dt * np.arange(len(infos), dtype=np.float64),
        positions=column("position"),
        orientations=column("orientation"),
        velocities=column("velocity"),
        currents=column("current"),
        rays=column("rays"),
        clearances=column("clearance"),
        collided=column("collision"),
        progress=column("progress"),
        costs=column("cost"),
        actions=np.array(actions, dtype=np.float64).reshape(len(actions), -1 if actions else 0),
        commands=np.array(commands, dtype=np.float64).reshape(-1, 3),
        rewards=np.array(rewards, dtype=np.float64),
        reward_terms={name.removeprefix(TERM_PREFIX): column(name)[1:] for name in terms},
        num_collisions=infos[-1]["num_collisions"],
        reason=reason,
    )
