"""Running one episode and keeping what happened, whatever the policy does."""

from __future__ import annotations

import ctypes
import dataclasses
import random
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.factory import TaskEnv
from aquanav_tools.errors import OwnCodeError
from aquanav_tools.evaluate.policy_kinds import Adapting, Policy, PrivilegedPolicy
from aquanav_tools.evaluate.protocol import EpisodePlan
from aquanav_tools.registry import error_text
from aquanav_tools.report.trajectory import FAILED, Trajectory

TERM_PREFIX, DYNAMICS_PREFIX = "reward/", "dynamics/"
"""Of names in an info."""
ACTION_TIME_LIMIT = 30.0
"""Wall time in which a policy must give an action, s: hundreds of times what any network here takes."""
LOOKS = 4
"""Times that the clock is looked at within the time limit; a policy may overrun by one part of it."""


class _HangError(BaseException):
    """A policy took too long. Not an Exception, so that a policy that catches these does not catch it."""


class CallTimeout:
    """Ends calls of a policy that take too long.

    A timer interrupts them on the main thread of Unix systems. It cannot interrupt compiled code; for that, another
    process may read `began`, which can lie in memory that it shares.
    """

    def __init__(self, limit: float = ACTION_TIME_LIMIT, began: Any = None) -> None:
        self.limit = limit
        """Wall time of a call, s."""
        self.began = ctypes.c_double(0.0) if began is None else began
        """Its `value` is the monotonic clock when the call that runs began, s; 0 while none runs."""

    @contextmanager
    def armed(self) -> Iterator[None]:
        """Limit the calls in the body. One timer for all of them: setting one for each takes longer than most calls."""
        if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
            yield
            return
        before = signal.signal(signal.SIGALRM, self._look)
        signal.setitimer(signal.ITIMER_REAL, self.limit / LOOKS, self.limit / LOOKS)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def outcome(self, call: Any) -> tuple[Any, str]:
        """Return what a call of the policy returns and "", or None and why it failed."""
        try:
            try:
                self.began.value = time.monotonic()
                return call(), ""
            finally:
                self.began.value = 0.0
        except _HangError:
            return None, self.reason
        except (Exception, SystemExit) as error:  # foreign code: whatever it raises costs this episode only
            return None, error_text(error)

    @property
    def reason(self) -> str:
        """What is said of a call that takes too long."""
        return f"gave no action within {self.limit:g} s"

    @property
    def overrun(self) -> float:
        """Time by which the call that runs is too long, s; not positive while it is not, or none runs."""
        began = float(self.began.value)
        return time.monotonic() - began - self.limit if began else 0.0

    def _look(self, *_: object) -> None:
        if self.overrun > 0.0:
            raise _HangError


def run_episode(
    env: TaskEnv,
    policy: Policy,
    plan: EpisodePlan,
    timeout: CallTimeout | None = None,
    reason: str = "",
    conditions: dict[str, Any] | None = None,
) -> Trajectory:
    """Return the trajectory of one episode, from the planned start to its end.

    A policy that raises an error, gives no action of its form, or takes too long for one ends its episode with the
    outcome FAILED and the reason. A `reason` that is given ends it like this before the policy is asked.
    `conditions` are options of reset: what this episode has of its own.
    """
    timeout = timeout or CallTimeout()
    try:
        observation, info = env.reset(seed=plan.seed, options={**_start(plan), **(conditions or {})})
    except OwnCodeError as error:
        observation, info, reason = np.zeros(0, dtype=np.float32), env.info, error.reasons[0]
    if isinstance(policy, Adapting):
        policy.adapt(env.action_space)
    if isinstance(policy, PrivilegedPolicy):
        policy.bind(env)
    infos, actions, commands, rewards = [info], [], [], []
    is_over = False
    with timeout.armed():
        reason = reason or timeout.outcome(lambda: begin_episode(policy, plan.seed))[1]
        while not is_over and not reason:
            chosen, reason = timeout.outcome(lambda seen=observation: choose(policy.act, env.action_model, seen))
            if reason:
                break
            action, command = chosen
            try:
                observation, reward, terminated, truncated, info = env.step(action)
            except OwnCodeError as error:
                reason = error.reasons[0]
                break
            is_over = terminated or truncated
            infos.append(info)
            actions.append(action)
            commands.append(command)
            rewards.append(reward)
    trajectory = _collect(plan, infos, (actions, commands, rewards), env.decision_seconds, reason)
    return dataclasses.replace(trajectory, interventions=getattr(policy, "interventions", None))


def begin_episode(policy: Policy, seed: int) -> None:
    """Begin an episode; a policy that draws from the libraries' own generators repeats in any order of episodes."""
    random.seed(seed)
    np.random.seed(seed % (1 << 32))
    if "torch" in sys.modules:
        sys.modules["torch"].manual_seed(seed)
    policy.reset(seed)


def choose(act: Callable[[Any], Any], form: ActionModel, seen: Any) -> tuple[Any, tuple[float, ...]]:
    """Return the action that a policy chooses and the command that it means; raises where it is no action."""
    action = act(seen)
    return action, tuple(form.command(action))


def _start(plan: EpisodePlan) -> dict[str, Any]:
    return {} if plan.start_index is None else {"start": plan.start_index}


def _collect(
    plan: EpisodePlan,
    infos: list[dict[str, Any]],
    done: tuple[list[Any], list[Any], list[float]],
    dt: float,
    reason: str,
) -> Trajectory:
    actions, commands, rewards = done
    terms, drawn = ([name for name in infos[0] if name.startswith(of)] for of in (TERM_PREFIX, DYNAMICS_PREFIX))

    def column(name: str) -> Any:
        return np.array([info[name] for info in infos])

    return Trajectory(
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
        dynamics={name.removeprefix(DYNAMICS_PREFIX): float(infos[0][name]) for name in drawn},
    )
