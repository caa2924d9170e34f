"""Carrying out what an evaluation asks for, episode by episode: in its own process or in one of several."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from aquanav_tools.envs.factory import AnyScenario, read_any_scenario, with_vehicle
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.env_cache import EnvCache, EpisodeSpec, numbered
from aquanav_tools.evaluate.episode_counts import possible_episodes
from aquanav_tools.evaluate.journal import journal_row, trajectory_name, write_trajectory
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import Case, EvaluateOptions
from aquanav_tools.evaluate.own_files import OwnFiles, own_files, seals
from aquanav_tools.evaluate.policies import LoadedPolicy, check_named, code_of
from aquanav_tools.evaluate.protocol import (
    Condition,
    case_condition,
    conditions_of,
    plan_case,
    plan_condition,
    starts_in,
    task_under,
)
from aquanav_tools.evaluate.recording import film_trajectory, record_trajectory
from aquanav_tools.evaluate.rollout import CallTimeout
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.sim.batch.ahead import compiling_kernels
from aquanav_tools.workers.pipe import is_wanted

RECORDING, FILM_SUFFIX = "episode-{index:05d}.rrd", ".webm"
RecordRule = Literal["always", "failure", "never"]
Row = dict[str, Any]
"""What the journal keeps of an episode."""


@dataclass(frozen=True)
class EvaluationSpec:
    """What is evaluated and how; travels to other processes."""

    options: EvaluateOptions
    policy: str
    """Which of the options' policies."""
    output: Path | None
    """Folder of the evaluation; None keeps nothing of the episodes but their metrics."""
    load: Callable[[str], LoadedPolicy]
    """Loads a policy by its name."""
    seal: dict[str, str | None] | None = None
    """What `seal_of` must find in the plan where it is made on another machine."""
    scenarios: tuple[AnyScenario, ...] | None = None
    """Scenarios in memory, in place of the options' folders and vehicle."""


@dataclass(frozen=True, eq=False)
class Plan:
    """What follows from the specification: the same in every process."""

    policy: LoadedPolicy
    scenarios: tuple[AnyScenario, ...]
    conditions: tuple[Condition, ...]
    episodes: tuple[EpisodeSpec, ...]
    """All episodes in their order: by scenario, then by condition."""
    num_possible: int | None
    """Episodes that differ which there are in these scenarios under these conditions; None for no end of them."""
    own_files: OwnFiles
    """What of the user's own the options and the policy's name mean."""


@dataclass(frozen=True)
class Task:
    """One episode to run."""

    index: int
    """Its number in the evaluation."""
    record: RecordRule
    """When to write its recording."""
    reason: str = ""
    """Why it fails without being run: it brought its process down before."""
    case: Case | None = None
    """What to run in the first scenario instead of the plan's episode."""
    policy_sha256: str | None = None
    """Of the policy's file, where it changes from task to task; None for the plan's policy."""


def make_plan(spec: EvaluationSpec) -> Plan:
    """Load the policy and the scenarios and plan all episodes.

    Raises:
        InputError: the policy cannot be used, the vehicle does not fit into a scenario, no start lies in a condition's
            region, or the seal does not fit.
        ScenarioError: a scenario cannot be read.
    """
    options = spec.options
    policy = spec.load(spec.policy)
    check_named(policy)
    with compiling_kernels(options.scenario if options.ray is None else ()):  # nodes of a cluster have others
        scenarios = spec.scenarios or tuple(
            with_vehicle(read_any_scenario(path), options.vehicle) for path in options.scenario
        )
    _check_task(policy, scenarios)
    conditions = conditions_of(options.grid)
    episodes = [
        EpisodeSpec(0, scenario, condition, plan)
        for scenario in scenarios
        for condition in conditions
        for plan in plan_condition(scenario, options, condition)
    ]
    if options.cases:
        episodes = [case_spec(scenario, case) for scenario in scenarios for case in options.cases]
        conditions = tuple({episode.condition.name: episode.condition for episode in episodes}.values())
    possible = _num_possible(policy, scenarios, conditions, options)
    plan = Plan(policy, scenarios, conditions, numbered(episodes), possible, _own_files(spec))
    _check_seal(plan, spec.seal)
    return plan


def _own_files(spec: EvaluationSpec) -> OwnFiles:
    options = spec.options
    return own_files(options, options.observation, options.grid.randomisation, code_of(spec.policy))


def _num_possible(
    policy: LoadedPolicy,
    scenarios: tuple[AnyScenario, ...],
    conditions: tuple[Condition, ...],
    options: EvaluateOptions,
) -> int | None:
    if options.cases:
        return None
    counts = [
        possible_episodes(
            scenario,
            task_under(condition, options),
            len(starts_in(scenario, condition, options)),
            policy.draws,
            options.observation,
        )
        for scenario in scenarios
        for condition in conditions
    ]
    found = [count for count in counts if count is not None]
    return sum(found) if len(found) == len(counts) else None


def _check_task(policy: LoadedPolicy, scenarios: tuple[AnyScenario, ...]) -> None:
    for scenario in scenarios:
        task = adapter_of(scenario).task
        if policy.task not in (None, task):
            raise InputError(
                f"The policy {policy.name} was made for the {policy.task} task, and {scenario.name} is of the {task} "
                "task. Name a scenario, or a policy, of the other."
            )


def seal_of(plan: Plan) -> dict[str, str | None]:
    """Return the hashes of policy, scenarios, vehicles in place of theirs, and the user's own code, by their names."""
    scenarios: dict[str, str | None] = {f"scenario {item.name}": item.content_hash for item in plan.scenarios}
    others = [item.other_vehicle for item in plan.scenarios if item.other_vehicle is not None]
    vehicles = {f"vehicle {other.name}": other.sha256 for other in others}
    return {f"policy {plan.policy.name}": plan.policy.sha256} | scenarios | vehicles | seals(plan.own_files)


def _check_seal(plan: Plan, seal: dict[str, str | None] | None) -> None:
    if seal is None or (found := seal_of(plan)) == seal:
        return
    different = sorted(name for name in {*found, *seal} if found.get(name) != seal.get(name))
    raise InputError(
        f"The content of {' and '.join(different)} is not that with which the evaluation began. Copy the files again, "
        "leave them as they are until the end, and go on with --resume."
    )


def file_names(index: int) -> set[str]:
    """Return all that an episode may leave in the folder of its evaluation."""
    recording = Path(RECORDING.format(index=index))
    return {trajectory_name(index), recording.name, recording.with_suffix(FILM_SUFFIX).name}


def case_spec(scenario: AnyScenario, case: Case, index: int = 0) -> EpisodeSpec:
    """Return the episode of a case in a scenario."""
    return EpisodeSpec(index, scenario, case_condition(case), plan_case(scenario, case))


class EpisodeWriter:
    """Leaves the trajectories and recordings of episodes in the evaluation's folder."""

    def __init__(self, output: Path | None, *, is_filming: bool) -> None:
        self._output, self._is_filming = output, is_filming

    def keep(self, episode: EpisodeSpec, record: RecordRule, trajectory: Trajectory, metrics: EpisodeMetrics) -> Row:
        """Return the journal's row of an episode, when all that belongs to it is on disk."""
        if self._output is None:
            return journal_row(metrics, None)
        name = None
        if record == "always" or (record == "failure" and not metrics.is_collision_free_success):
            name = RECORDING.format(index=episode.index)
            path = self._output / name
            record_trajectory(episode.scenario, trajectory, path)
            if self._is_filming:
                film_trajectory(episode.scenario, trajectory, path.with_suffix(FILM_SUFFIX), "chase")
        write_trajectory(self._output, episode.index, trajectory)
        return journal_row(metrics, name)


class EpisodeWorker:
    """Runs episodes of a plan, one at a time: in the first process, or as a worker's object."""

    def __init__(self, spec: EvaluationSpec, plan: Plan, began: Any = None) -> None:
        """Take over a plan of the specification; `began` is the clock of `CallTimeout`."""
        self._spec, self._plan = spec, plan
        timeout = CallTimeout(spec.options.action_time_limit, began)
        self._env_cache = EnvCache(plan.policy, spec.options, timeout, spec.options.backend)
        self._writer = EpisodeWriter(spec.output, is_filming=spec.options.film)
        self._policy_sha256: str | None = None

    def run(self, task: Task) -> Row:
        """Return the journal's row of an episode; nothing is written once nobody wants it any more."""
        if task.policy_sha256 != self._policy_sha256:
            # Not held against the hash of the plan's policy: the file may have changed while the plan read it, but it
            # stays as it is while a task waits for its result.
            self._env_cache.policy = self._spec.load(self._spec.policy)
            self._policy_sha256 = task.policy_sha256
        episode = (
            self._plan.episodes[task.index]
            if task.case is None
            else case_spec(self._plan.scenarios[0], task.case, task.index)
        )
        trajectory, metrics = self._env_cache.run(episode, task.reason)
        return self._writer.keep(episode, task.record, trajectory, metrics) if is_wanted() else {}

    def close(self) -> None:
        """Free the environment."""
        self._env_cache.close()


def make_worker(spec: EvaluationSpec, began: Any) -> EpisodeWorker:
    """Return what runs episodes in a process of its own."""
    return EpisodeWorker(spec, make_plan(spec), began)
