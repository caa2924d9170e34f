"""Flying the episodes of an evaluation: each scenario under each condition in an environment of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from aquanav_tools.envs.places import Place, PlaceEnv, make_env
from aquanav_tools.evaluate.metrics import Course, EpisodeMetrics, measure
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.policies import LoadedPolicy
from aquanav_tools.evaluate.protocol import Condition, EpisodePlan, task_under
from aquanav_tools.evaluate.rollout import Watch, run_episode
from aquanav_tools.evaluate.venue import venue_of
from aquanav_tools.report.track import Track
from aquanav_tools.task import TaskOptions, choices_of

LIGHT = ("sensor_noise", "sensor_dropout", "current_range")
"""Options that an environment reads anew whenever they count, so that it is kept when only these change."""


@dataclass(frozen=True, slots=True)
class Flight:
    """One planned episode with its circumstances."""

    index: int
    """Place in the evaluation, from 0."""
    scenario: Place
    condition: Condition
    plan: EpisodePlan


class Hangar:
    """Keeps what flights share, one environment at a time: flights come sorted by scenario and condition."""

    def __init__(self, policy: LoadedPolicy, options: ProtocolOptions, watch: Watch | None = None) -> None:
        self._policy, self._options, self._watch = policy, options, watch or Watch()
        self._env: PlaceEnv | None = None
        self._place: tuple[Place, TaskOptions] | None = None

    def fly(self, flight: Flight, reason: str = "") -> tuple[Track, EpisodeMetrics]:
        """Return the track of an episode and its metrics; with a reason it fails before the policy is asked."""
        env, course = self._prepare(flight)
        track = run_episode(env, self._policy.policy, flight.plan, self._watch, reason)
        return track, measure(track, env.way, course, flight.index)

    def close(self) -> None:
        """Free the environment."""
        if self._env is not None:
            self._env.close()
        self._env = self._place = None

    def _prepare(self, flight: Flight) -> tuple[PlaceEnv, Course]:
        task = task_of(flight, self._options)
        place = (flight.scenario, replace(task, **{name: getattr(TaskOptions(), name) for name in LIGHT}))
        is_here = self._place is not None and self._place[0] is place[0] and self._place[1] == place[1]
        if self._env is None or not is_here:
            self.close()
            self._env = make_env(
                flight.scenario,
                observation=self._policy.observation,
                action=self._policy.action,
                max_decisions=self._options.max_decisions,
                **choices_of(task),
            )
            self._place = place
        self._env.task = task
        return self._env, course_of(flight, task)


@contextmanager
def open_hangar(policy: LoadedPolicy, options: ProtocolOptions, watch: Watch | None = None) -> Iterator[Hangar]:
    """Yield a hangar that is closed at the end."""
    hangar = Hangar(policy, options, watch)
    try:
        yield hangar
    finally:
        hangar.close()


def numbered(flights: Sequence[Flight]) -> tuple[Flight, ...]:
    """Return the flights with their places in the sequence."""
    return tuple(replace(flight, index=index) for index, flight in enumerate(flights))


def course_of(flight: Flight, task: TaskOptions) -> Course:
    """Return what a flight under some rules is held against."""
    venue = venue_of(flight.scenario)
    return replace(venue.course, condition=flight.condition.name, ideal=venue.ideal_time(task))


def task_of(flight: Flight, options: ProtocolOptions) -> TaskOptions:
    """Return the task's options under a flight's condition."""
    return task_under(flight.condition, options)
