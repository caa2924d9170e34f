"""Looking for the cases that break a policy, beside as many drawn at random, and saving the worst as a protocol."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator
from typing import Any

from aquanav_tools.envs.factory import cave_of
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.episode_runner import open_runner
from aquanav_tools.evaluate.episode_worker import EvaluationSpec, Plan, Task, make_plan
from aquanav_tools.evaluate.journal import Journal, clear_journal, held_results
from aquanav_tools.evaluate.options import EvaluateOptions, StressOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, policy_loader
from aquanav_tools.evaluate.protocol import write_cases
from aquanav_tools.evaluate.results import versions
from aquanav_tools.evaluate.search import GENERATION, CaseSpace, Search, danger, load_cmaes, random_points
from aquanav_tools.evaluate.stress_report import Stress, Trial, write_stress_report
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import choices_of
from aquanav_tools.types import Array, Progress

WORST, TABLE = "worst.toml", "stress.json"


def stress(options: StressOptions, progress: Progress, load: Callable[[str], LoadedPolicy] | None = None) -> Stress:
    """Search for failures and write worst.toml, stress.json and report.html.

    Args:
        options: What to search and how long.
        progress: Told how many episodes are done.
        load: Loads the policy by its name; a function of a module, as other processes call it too. Without one that is
            `load_policy`, told what is observed.

    Raises:
        InputError: the policy cannot be used, another process writes to the folder, or the episodes in it
            are of another search.
        ScenarioError: the scenario cannot be read.
        ResourceError: the optimiser is not installed, or processes do not start.
    """
    load_cmaes()
    run_options = _run_options(options)
    load = load or policy_loader(run_options, is_trusted=options.trust)
    run_options = load(options.policy).rules(run_options)
    spec = EvaluationSpec(run_options, options.policy, options.output, load)
    plan = make_plan(spec)
    with held_results(options.output):
        return _search(spec, plan, options, progress)


def _search(spec: EvaluationSpec, plan: Plan, options: StressOptions, progress: Progress) -> Stress:
    """Run the search and write what it found into the folder, which this process holds."""
    scenario = cave_of(plan.scenarios[0], "aquanav-eval stress")
    journal = _open_journal(options, plan)
    campaign = _Campaign(options, scenario, journal)
    progress(len(journal), 2 * options.budget)
    with open_runner(spec, plan, 2 * options.budget - len(journal)) as runner:
        for row in runner(campaign.tasks()):
            journal.add(row)
            progress(len(journal), 2 * options.budget)
    drawn, searched = campaign.trials(range(options.budget)), campaign.trials(range(options.budget, 2 * options.budget))
    worst = _worst((*drawn, *searched), options.worst)
    cases = [trial.case for trial in worst]
    write_cases(cases, options, options.max_decisions, options.observation, options.output / WORST)
    found = Stress(plan.policy.name, scenario, plan.own_files, drawn, searched, worst, options.output / "report.html")
    (options.output / TABLE).write_text(json.dumps(_table(found, options), indent=2) + "\n", encoding="utf-8")
    write_stress_report(found, options)
    return found


class _Campaign:
    """Which case each episode is: the first half is drawn at random, the second half searched."""

    def __init__(self, options: StressOptions, scenario: Scenario, journal: Journal) -> None:
        starts = scenario.starts
        order = sorted(range(len(starts)), key=lambda index: -starts[index].geodesic_to_goal)
        self._options, self._scenario, self._journal = options, scenario, journal
        self._space = CaseSpace(options, tuple(order))
        points = random_points(options.seed, options.budget)
        self._cases = {index: self._space.case(point) for index, point in enumerate(points)}

    def tasks(self) -> Iterator[Task | None]:
        """Yield the episodes to run, searched ones first; drawn ones while a generation is still in the water."""
        drawn = iter([index for index in range(self._options.budget) if index not in self._journal])
        for first, points in self._generations():
            indices = range(first, first + len(points))
            for index in indices:
                if index not in self._journal:
                    yield self._task(index)
            while not all(index in self._journal for index in indices):
                index = next(drawn, -1)
                yield None if index < 0 else self._task(index)
        for index in drawn:
            yield self._task(index)

    def trials(self, indices: range) -> tuple[Trial, ...]:
        """Return what came out, in the order of the episodes."""
        return tuple(self._trial(index) for index in indices)

    def _trial(self, index: int) -> Trial:
        case, metrics = self._cases[index], self._journal.episode(index)
        path_length = self._scenario.starts[case.start].geodesic_to_goal
        return Trial(case, metrics, danger(metrics, self._scenario.guide.length), path_length)

    def _generations(self) -> Iterator[tuple[int, list[Array]]]:
        """Yield the first index and the points of each generation; the caller runs them before it asks for more."""
        search, end = Search(self._options.seed), 2 * self._options.budget
        for first in range(self._options.budget, end, GENERATION):
            points = search.ask()
            kept = points[: end - first]
            self._cases |= {first + number: self._space.case(point) for number, point in enumerate(kept)}
            yield first, kept
            if len(kept) == len(points):
                trials = self.trials(range(first, first + len(points)))
                search.tell(points, [trial.danger for trial in trials])

    def _task(self, index: int) -> Task:
        return Task(index, "never", case=self._cases[index])


def _run_options(options: StressOptions) -> EvaluateOptions:
    return EvaluateOptions(
        policies=(options.policy,),
        scenario=(options.scenario,),
        output=options.output,
        episodes=1,
        max_decisions=options.max_decisions,
        observation=options.observation,
        vehicle=options.vehicle,
        workers=options.workers,
        action_time_limit=options.action_time_limit,
        **choices_of(options),
    )


def _open_journal(options: StressOptions, plan: Plan) -> Journal:
    scenario, policy = plan.scenarios[0], plan.policy
    searched = dataclasses.asdict(options)
    for name in ("scenario", "output", "resume", "workers", "worst", "policy", "trust"):
        del searched[name]
    identity = {
        "search": searched,
        "policy": {"name": policy.name, "sha256": policy.sha256},
        "scenario": scenario.content_hash,
        "vehicle_sha256": None if scenario.other_vehicle is None else scenario.other_vehicle.sha256,
        "own_files": plan.own_files,
        "versions": {**versions(), "cmaes": load_cmaes().__version__},
    }
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        if not options.resume:
            clear_journal(options.output)
        return Journal(options.output, identity, options.resume)
    except OSError as cause:
        raise InputError(
            f"Cannot write to the output folder {options.output}: {cause}. Choose another with -o."
        ) from cause


def _worst(trials: tuple[Trial, ...], count: int) -> tuple[Trial, ...]:
    """Return the most dangerous trials, each case once."""
    by_case = {trial.case: trial for trial in trials}
    return tuple(sorted(by_case.values(), key=lambda trial: -trial.danger)[:count])


def _table(found: Stress, options: StressOptions) -> dict[str, Any]:
    def rows(trials: tuple[Trial, ...]) -> list[dict[str, Any]]:
        return [
            {
                **dataclasses.asdict(trial.case),
                "outcome": trial.metrics.outcome,
                "collisions": trial.metrics.collisions,
                "min_clearance": trial.metrics.min_clearance,
                "danger": trial.danger,
                "digest": trial.metrics.digest,
                **({"dynamics": trial.metrics.dynamics} if trial.metrics.dynamics else {}),
            }
            for trial in trials
        ]

    return {
        "format": 1,
        "policy": found.policy,
        "scenario": found.scenario.name,
        "scenario_hash": found.scenario.content_hash,
        "vehicle": None if found.scenario.other_vehicle is None else dataclasses.asdict(found.scenario.other_vehicle),
        "own_files": found.own_files,
        "budget": options.budget,
        "seed": options.seed,
        "random": rows(found.drawn),
        "search": rows(found.searched),
        "worst": rows(found.worst),
    }
