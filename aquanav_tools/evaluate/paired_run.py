"""Flying two policies pair by pair until they are told apart: the same episodes for both, in an order drawn once."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.envs.factory import say_left_out
from aquanav_tools.evaluate.comparing import Compared, compare, run_folders
from aquanav_tools.evaluate.episode_pool import Runner
from aquanav_tools.evaluate.episode_runner import open_runner
from aquanav_tools.evaluate.episode_worker import EvaluationSpec, Plan, Task, make_plan
from aquanav_tools.evaluate.evaluation import check_names, check_runner, open_journal, write_evaluation
from aquanav_tools.evaluate.journal import Journal, held_results
from aquanav_tools.evaluate.options import SequentialOptions
from aquanav_tools.evaluate.policies import policy_loader
from aquanav_tools.evaluate.sequential import Sequential, judge, verdict_of
from aquanav_tools.types import Array, Progress


@dataclass(frozen=True, eq=False)
class _Side:
    """One of the two policies on its way."""

    folder: Path
    spec: EvaluationSpec
    plan: Plan
    journal: Journal
    runner: Runner


def compare_pair_by_pair(options: SequentialOptions, progress: Progress) -> Compared:
    """Fly both policies in blocks of the same episodes until the verdict; write their evaluations and the comparison.

    Args:
        options: The two policies, where they fly, and when to stop.
        progress: Told how many pairs were flown, of how many there are at most.

    Raises:
        InputError: a policy cannot be used, a folder cannot be written to or holds episodes of something else.
        ScenarioError: a scenario cannot be read.
        ResourceError: the processes that run do not start.
    """
    options = dataclasses.replace(options, record="none")
    folders = run_folders(options.policies, options.output)
    load = policy_loader(options, is_trusted=options.trust)
    specs = [
        EvaluationSpec(load(policy).rules(options), policy, folder, load)
        for policy, folder in zip(options.policies, folders, strict=True)
    ]
    plans = [make_plan(spec) for spec in specs]
    check_names(plans[0].scenarios)
    say_left_out(plans[0].scenarios)
    for plan in plans:
        check_runner(plan, options)
    order, population = drawn_order(plans, options.seed)
    with ExitStack() as held:
        sides = []
        for folder, spec, plan in zip(folders, specs, plans, strict=True):
            held.enter_context(held_results(folder))
            journal = open_journal(folder, plan, spec)
            runner = held.enter_context(open_runner(spec, plan, min(options.block, len(order))))
            sides.append(_Side(folder, spec, plan, journal, runner))
        found = _fly(sides, order, options, population, progress)
        for side in sides:
            write_evaluation(side.folder, side.spec, side.plan, side.journal, {})
    return compare(folders, options.output, found)


def drawn_order(plans: Sequence[Plan], seed: int) -> tuple[list[int], int | None]:
    """Return the numbers of the episodes in the order in which they are flown, and how many there are of them at all.

    The order is a permutation over all scenarios, conditions and starts, so that any beginning of it is a fair sample
    of the whole. Where nothing is random, each start comes once, and those are all; else there is no end of them: None.
    """
    episodes = plans[0].episodes
    is_fixed = all(plan.num_possible is not None for plan in plans)
    if is_fixed:
        starts = {
            (item.scenario.name, item.condition.name, item.plan.start_index): item.index for item in reversed(episodes)
        }
        numbers = sorted(starts.values())
    else:
        numbers = [item.index for item in episodes]
    order: list[int] = np.random.default_rng(seed).permutation(numbers).tolist()
    return order, len(order) if is_fixed else None


def _fly(
    sides: Sequence[_Side], order: Sequence[int], options: SequentialOptions, population: int | None, progress: Progress
) -> Sequential:
    """Fly block after block until the verdict or the end; return what the pairs say."""
    for end in range(options.block, len(order) + options.block, options.block):
        flown = order[:end]
        for side in sides:
            missing = sorted(number for number in flown if number not in side.journal)
            for row in side.runner(Task(number, "never") for number in missing):
                side.journal.add(row)
        progress(len(flown), len(order))
        if verdict_of(_differences(sides, flown), options.smallest_difference, population) != "open":
            break
    found = judge(_differences(sides, flown), options.smallest_difference, population)
    return dataclasses.replace(found, max_pairs=len(order))


def _differences(sides: Sequence[_Side], numbers: Sequence[int]) -> Array:
    """Return of each pair 1 where only the first policy succeeded without a collision, -1 where only the second did."""
    first, second = (
        np.array([side.journal.episode(number).is_collision_free_success for number in numbers], dtype=float)
        for side in sides
    )
    difference: Array = first - second
    return difference
