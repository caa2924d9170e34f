"""Which episodes an evaluation runs: fixed by its options alone, so that policies meet the same episodes."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.envs.starting import listed_numbers
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.episode_counts import usual_episodes
from aquanav_tools.evaluate.metrics import region_of
from aquanav_tools.evaluate.options import MAX_CONDITIONS, Case, Grid, ProtocolOptions
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.registry import refuse_recorded
from aquanav_tools.shipped import shipped_path
from aquanav_tools.sim.randomisation import read_randomisation
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.task import TaskOptions, choices_of, named_code, task_options

FOLDER = "eval/protocols"
NOMINAL = "as given"
NO_RANGES = "none"
"""In a grid: the vehicle's dynamics as its file has them."""


@dataclass(frozen=True, slots=True)
class EpisodePlan:
    """How one episode begins."""

    seed: int
    """Seed of the environment and of the policy."""
    start_index: int | None
    """Which of the scenario's starts; None where the environment draws one."""


@dataclass(frozen=True)
class Condition:
    """Circumstances under which a policy is evaluated."""

    name: str
    changes: dict[str, Any]
    """Options of the task that differ from the protocol's."""
    region: str | None = None
    """Third of the route to start in; None for all."""


def read_protocol(name: str, is_trusted: bool = False) -> dict[str, Any]:
    """Return the options in a protocol: a shipped one by its name, or a file by a path that ends in .toml.

    Raises:
        InputError: no such protocol (with the closest name), an unknown or senseless value in it, or code that it names
            and nobody trusts.
    """
    path = Path(name) if name.endswith(".toml") else shipped_path(FOLDER, name)
    table = read_toml(path)
    if not is_trusted:
        names = [*named_code(table), table.get("observation")]
        refuse_recorded(names, str(path), "If you trust it, add --trust; or name the code as options instead.")
    options = from_table(ProtocolOptions, table, path.name)
    return {key: getattr(options, key) for key in table}


def conditions_of(grid: Grid) -> tuple[Condition, ...]:
    """Return every combination of a grid's values; a single one without changes for an empty grid.

    Raises:
        InputError: they are more than MAX_CONDITIONS, or there are no ranges of dynamics of a name.
    """
    drawing_delays = {
        name for name in grid.randomisation if name != NO_RANGES and read_randomisation(name).action_delay is not None
    }
    axes: list[list[tuple[str, Any, str]]] = [
        [("current", value, f"current x{value:g}") for value in grid.current],
        [("sensor_noise", value, f"noise {value:g} m") for value in grid.sensor_noise],
        [("action_delay", value, f"delay {value}") for value in grid.action_delay],
        [("randomisation", value, f"{value} dynamics") for value in grid.randomisation],
        [("region", value, str(value)) for value in grid.region],
    ]
    num = math.prod(len(axis) for axis in axes if axis)
    if num > MAX_CONDITIONS:
        raise InputError(f"The grid has {num} conditions, more than {MAX_CONDITIONS}. Give fewer values.")
    conditions = [
        _condition(combination, drawing_delays) for combination in itertools.product(*(axis for axis in axes if axis))
    ]
    return tuple(condition for n, condition in enumerate(conditions) if condition not in conditions[:n])


def case_condition(case: Case) -> Condition:
    """Return the circumstances of a case; cases that share them get the same."""
    changes = {"sensor_noise": case.sensor_noise, "current_range": (case.current, case.current)}
    return Condition(f"current x{case.current:g}, noise {case.sensor_noise:g} m", changes)


def plan_case(scenario: AnyScenario, case: Case) -> EpisodePlan:
    """Return the episode of a case.

    Raises:
        InputError: the scenario has no such start.
    """
    count = len(adapter_of(scenario).path_lengths)
    if case.start >= count:
        raise InputError(
            f"A case begins at start {case.start}, and {scenario.name} has {count} listed starts, counted from 0: the "
            "cases are of another scenario, or it was built anew. Search there with aquanav-eval stress."
        )
    return EpisodePlan(case.seed, case.start)


def write_cases(
    cases: Sequence[Case], task: TaskOptions, max_decisions: int | None, observation: str | None, path: Path
) -> None:
    """Write a protocol file of cases; options that are as usual are left out."""
    import tomli_w

    usual = choices_of(TaskOptions())
    table = {key: value for key, value in choices_of(task).items() if value != usual[key]}
    if max_decisions is not None:
        table["max_decisions"] = max_decisions
    if observation is not None:
        table["observation"] = observation
    table["cases"] = [dataclasses.asdict(case) for case in cases]
    path.write_text(tomli_w.dumps(table), encoding="utf-8")


def plan_episodes(num_starts: int, num_episodes: int, seed: int, is_anywhere: bool = False) -> tuple[EpisodePlan, ...]:
    """Return the episodes of an evaluation; with `is_anywhere` their seeds alone say where they start.

    Episode i has seed `seed + i`. All starts take their turn before any comes again, each round in an order shuffled by
    `seed`, so that no start counts more than once above another. A shorter evaluation is the beginning of a longer one.
    """
    if is_anywhere:
        return tuple(EpisodePlan(seed + i, None) for i in range(num_episodes))
    rng = np.random.default_rng(seed)
    rounds = -(-num_episodes // num_starts)
    order = np.concatenate([rng.permutation(num_starts) for _ in range(rounds)])[:num_episodes]
    return tuple(EpisodePlan(seed + i, int(start)) for i, start in enumerate(order))


def plan_condition(scenario: AnyScenario, options: ProtocolOptions, condition: Condition) -> tuple[EpisodePlan, ...]:
    """Return the episodes of one scenario under one condition.

    Raises:
        InputError: none of the scenario's starts lies in the condition's region.
    """
    starts = starts_in(scenario, condition, options)
    is_anywhere = options.starts == "anywhere" or not adapter_of(scenario).path_lengths
    if not starts and (condition.region is not None or not is_anywhere):
        raise InputError(
            f"None of the {len(adapter_of(scenario).path_lengths)} listed starts of {scenario.name} lies in the "
            f"{condition.region} of its route. Leave out that region, or build the scenario with more starts."
        )
    count = options.episodes or usual_episodes(
        scenario, task_under(condition, options), len(starts), options.observation
    )
    return tuple(_mapped(plan_episodes(len(starts), count, options.seed, is_anywhere), starts))


def starts_in(scenario: AnyScenario, condition: Condition, options: TaskOptions) -> list[int]:
    """Return the numbers of the scenario's listed starts in the task's range and the condition's region.

    Raises:
        InputError: none is in the task's range.
    """
    adapter = adapter_of(scenario)
    return [
        index
        for index in listed_numbers(scenario.name, adapter.start_shares, options.start_range).tolist()
        for length in adapter.path_lengths[index : index + 1]
        if condition.region in (None, region_of(length, adapter.reference.route_length or length))
    ]


def task_under(condition: Condition, options: TaskOptions) -> TaskOptions:
    """Return the task's options under a condition."""
    return task_options({**choices_of(options), **condition.changes})


def _mapped(plans: Sequence[EpisodePlan], starts: Sequence[int]) -> Iterator[EpisodePlan]:
    for plan in plans:
        chosen = None if plan.start_index is None else starts[plan.start_index]
        yield dataclasses.replace(plan, start_index=chosen)


def _condition(combination: tuple[tuple[str, Any, str], ...], drawing_delays: Collection[str]) -> Condition:
    """Return the condition of one value of each axis; without the delay of actions where the dynamics draw one."""
    values = {key: value for key, value, _ in combination}
    texts = {key: text for key, _, text in combination}
    if values.get("randomisation") in drawing_delays:
        values.pop("action_delay", None)
        texts.pop("action_delay", None)
    if values.get("randomisation") == NO_RANGES:
        # Left out of the name beside others, so that results from before there were ranges have the same condition.
        values["randomisation"] = None
        del texts["randomisation"]
        texts = texts or {"randomisation": "the file's dynamics"}
    region = values.pop("region", None)
    if "current" in values:
        fraction = values.pop("current")
        values["current_range"] = (fraction, fraction)
    return Condition(", ".join(texts.values()) or NOMINAL, values, region)
