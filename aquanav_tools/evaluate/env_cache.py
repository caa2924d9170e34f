"""Running the episodes of an evaluation: each scenario under each condition in an environment of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from aquanav_tools.envs.factory import AnyScenario, TaskEnv, make_env
from aquanav_tools.envs.starting import CONDITIONS
from aquanav_tools.evaluate.metrics import EpisodeMetrics, EpisodeReference, measure
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, check_size, observed_by
from aquanav_tools.evaluate.protocol import Condition, EpisodePlan, task_under
from aquanav_tools.evaluate.rollout import CallTimeout, run_episode
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.sim.contacts import Backend, contacts_of, default_backend
from aquanav_tools.task import TaskOptions


@dataclass(frozen=True, slots=True)
class EpisodeSpec:
    """One planned episode with its circumstances."""

    index: int
    """Number in the evaluation, from 0."""
    scenario: AnyScenario
    condition: Condition
    plan: EpisodePlan


class EnvCache:
    """Keeps what episodes share, one environment at a time, as episodes come sorted by scenario and condition."""

    def __init__(
        self,
        policy: LoadedPolicy,
        options: ProtocolOptions,
        timeout: CallTimeout | None = None,
        backend: Backend | None = None,
    ) -> None:
        """Prepare for a policy's episodes; `backend` says who solves contacts, and None takes the default."""
        self.policy = policy
        """May be replaced between episodes by another of the same observation and action."""
        self._options, self._timeout = options, timeout or CallTimeout()
        self._contacts = contacts_of(default_backend() if backend is None else backend)
        self._env: TaskEnv | None = None
        self._key: tuple[AnyScenario, TaskOptions] | None = None

    def run(self, episode: EpisodeSpec, reason: str = "") -> tuple[Trajectory, EpisodeMetrics]:
        """Return the trajectory of an episode and its metrics; with a reason it fails before the policy is asked."""
        task = task_of(episode, self._options)
        env, policy = self._env_of(episode, task), self.policy.policy
        conditions = {name: getattr(task, name) for name in CONDITIONS}
        trajectory = run_episode(env, policy, episode.plan, self._timeout, reason, conditions)
        return trajectory, measure(trajectory, env.path_length, reference_of(episode, task), episode.index)

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()
        self._env = self._key = None

    def _env_of(self, episode: EpisodeSpec, task: TaskOptions) -> TaskEnv:
        """Return the environment of an episode; it is kept when only what episodes may change themselves does."""
        key = (episode.scenario, replace(task, **{name: getattr(TaskOptions(), name) for name in CONDITIONS}))
        is_here = self._key is not None and self._key[0] is key[0] and self._key[1] == key[1]
        if self._env is None or not is_here:
            self.close()
            self._env = make_env(
                episode.scenario,
                max_decisions=self._options.max_decisions,
                contacts=self._contacts,
                **observed_by(self.policy, task),
            )
            self._key = key
            check_size(self.policy, self._env.observation_space)
        return self._env


@contextmanager
def open_env_cache(
    policy: LoadedPolicy, options: ProtocolOptions, backend: Backend | None = None
) -> Iterator[EnvCache]:
    """Yield a cache that is closed at the end."""
    env_cache = EnvCache(policy, options, backend=backend)
    try:
        yield env_cache
    finally:
        env_cache.close()


def numbered(episodes: Sequence[EpisodeSpec]) -> tuple[EpisodeSpec, ...]:
    """Return the episodes with their numbers in the sequence."""
    return tuple(replace(episode, index=index) for index, episode in enumerate(episodes))


def reference_of(episode: EpisodeSpec, task: TaskOptions) -> EpisodeReference:
    """Return what an episode under some rules is held against."""
    adapter = adapter_of(episode.scenario)
    return replace(adapter.reference, condition=episode.condition.name, ideal=adapter.ideal_time(task))


def task_of(episode: EpisodeSpec, options: ProtocolOptions) -> TaskOptions:
    """Return the task's options under an episode's condition."""
    return task_under(episode.condition, options)
