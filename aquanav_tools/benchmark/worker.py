"""Diving in the caves of a benchmark, one cave at a time: each is built where it is missing, dived, and let go of."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from aquanav_tools.benchmark.definition import Benchmark
from aquanav_tools.benchmark.options import BenchmarkOptions
from aquanav_tools.build.generated import build_generated
from aquanav_tools.envs.factory import AnyScenario, read_any_scenario
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.env_cache import EnvCache, EpisodeSpec
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, check_batched, check_named, policy_loader
from aquanav_tools.evaluate.protocol import plan_condition
from aquanav_tools.evaluate.results import scenario_row
from aquanav_tools.evaluate.rollout import CallTimeout
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.shipped import drawn_from
from aquanav_tools.sim.batch.sensors import PRIVILEGED
from aquanav_tools.sim.contacts import default_backend


@dataclass(frozen=True)
class CaveTask:
    """One cave to dive in."""

    number: int
    """Its place in the benchmark."""
    fault: str = ""
    """Why it is not to be dived: it brought its process down before."""


@dataclass(frozen=True)
class BenchmarkSpec:
    """What is run; travels to other processes."""

    options: BenchmarkOptions
    benchmark: Benchmark


def rules_of(options: BenchmarkOptions, benchmark: Benchmark) -> ProtocolOptions:
    """Return the rules that hold in all tiers."""
    return ProtocolOptions(episodes=benchmark.episodes, seed=benchmark.seed, observation=options.observation)


def policy_of(options: BenchmarkOptions, benchmark: Benchmark) -> LoadedPolicy:
    """Return the policy, newly loaded.

    Raises:
        InputError: it cannot be used, or not in a batch.
    """
    policy = policy_loader(rules_of(options, benchmark), is_trusted=options.trust)(options.policy)
    check_named(policy)
    if policy.task not in (None, "cave"):
        raise InputError(
            f"The policy {policy.name} was made for the {policy.task} task; the caves of {benchmark.name} are dived "
            "by underwater vehicles. Choose one that was trained in caves."
        )
    if known := [name for name in policy.rules(rules_of(options, benchmark)).sensors if name in PRIVILEGED]:
        raise InputError(
            f"The policy {policy.name} observes {known[0]}, which no vehicle can measure, so that its score would say "
            "nothing. Choose one that observes what a vehicle does; aquanav-eval without --benchmark takes this one."
        )
    if options.backend == "batch":
        check_batched(policy, is_diving=True, otherwise=f"Add --backend {default_backend()}.")
    return policy


class CaveWorker:
    """Dives in one cave after the other with a policy."""

    def __init__(self, spec: BenchmarkSpec, began: Any = None) -> None:
        """Load the policy; `began` is the clock of `CallTimeout`."""
        self._spec = spec
        self._timeout = CallTimeout(spec.options.action_time_limit, began)
        self._policies = [policy_of(spec.options, spec.benchmark)]
        self._rules = self._policies[0].rules(rules_of(spec.options, spec.benchmark))

    def run(self, task: CaveTask) -> dict[str, Any]:
        """Return what the run's journal keeps of a cave.

        Raises:
            AquanavError: it cannot be built or read, or the policy does not fit.
        """
        tier, cave = self._spec.benchmark.caves[task.number]
        if task.fault:
            raise InputError(f"{cave.scenario} cannot be dived: {task.fault}.")
        scenario = self._read(cave.scenario)
        plans = plan_condition(scenario, self._rules, tier.condition)
        first = task.number * self._spec.benchmark.episodes
        specs = [EpisodeSpec(first + n, scenario, tier.condition, plan) for n, plan in enumerate(plans)]
        metrics = self._batched(specs) if self._spec.options.backend == "batch" else self._alone(specs)
        return {
            "number": task.number,
            "scenario": scenario_row(scenario, cave.scenario),
            "mesh": mesh_hash(scenario),
            "metrics": [asdict(one) for one in metrics],
        }

    def _read(self, name: str) -> Scenario:
        drawn = drawn_from(name)
        scenario: AnyScenario = read_any_scenario(name if drawn is None else build_generated(*drawn))
        if not isinstance(scenario, Scenario):
            raise InputError(f"{name} is of the {adapter_of(scenario).task} task. A benchmark consists of caves.")
        return scenario

    def _batched(self, specs: Sequence[EpisodeSpec]) -> list[EpisodeMetrics]:
        from aquanav_tools.evaluate.batch_runner import BatchRunner, num_policies  # Warp takes a second to import

        while len(self._policies) < num_policies(self._policies[0], len(specs)):
            self._policies.append(policy_of(self._spec.options, self._spec.benchmark))
        runner = BatchRunner(self._policies, self._rules, self._timeout)
        try:
            return [metrics for _, metrics in runner.run(specs)]
        finally:
            runner.close()

    def _alone(self, specs: Sequence[EpisodeSpec]) -> list[EpisodeMetrics]:
        env_cache = EnvCache(self._policies[0], self._rules, self._timeout, self._spec.options.backend)
        try:
            return [env_cache.run(spec)[1] for spec in specs]
        finally:
            env_cache.close()


def make_worker(spec: BenchmarkSpec, began: Any) -> CaveWorker:
    """Return what dives in a process of its own."""
    return CaveWorker(spec, began)


def mesh_hash(scenario: Scenario) -> str:
    """Return 16 digits that say which cave it is: of its vertices to the millimetre and its faces.

    Another version of a library that builds a cave may move its vertices by rounding errors alone; these do not count.
    """
    mesh = scenario.cavity.mesh
    places = np.rint(1000.0 * np.asarray(mesh.vertices)).astype("<i4")
    return hashlib.sha256(places.tobytes() + np.asarray(mesh.faces).astype("<i4").tobytes()).hexdigest()[:16]


def failed(task: CaveTask, reason: str) -> CaveTask:
    """Return what is carried out in place of a cave that brought its process down: its failure."""
    return replace(task, fault=reason)
