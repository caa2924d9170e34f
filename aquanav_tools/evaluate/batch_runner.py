"""Running the episodes of an evaluation side by side, on the batched backend.

The episodes of one scenario and condition run beside each other, in the order of the plan. An episode draws from its
own seed alone, and a network computes blocks of one size (`padding.py`), so that an episode is the same to the bit
whatever runs beside it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.batch import Batch, row_of
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.factory import AnyScenario, make_batch
from aquanav_tools.evaluate.env_cache import EpisodeSpec, reference_of, task_of
from aquanav_tools.evaluate.episode_pool import Runner, Tasks
from aquanav_tools.evaluate.episode_worker import EpisodeWriter, EvaluationSpec, Plan, Row, Task
from aquanav_tools.evaluate.metrics import EpisodeMetrics, measure
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, check_batched, check_size, observed_by
from aquanav_tools.evaluate.policy_kinds import Adapting, BatchPrivileged, Policy, Vectorised
from aquanav_tools.evaluate.protocol import Condition, EpisodePlan
from aquanav_tools.evaluate.rollout import CallTimeout, begin_episode, choose
from aquanav_tools.report.trajectory import FAILED, Trajectory
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import TaskOptions

BATCH_SIZE = 256
"""Episodes side by side: chosen; more take memory, about 0.4 kB for each decision of each."""
KEPT = (
    "positions", "orientations", "velocities", "currents", "clearances", "touched", "collisions", "remaining",
    "rays", "terms", "rewards", "outcomes",
)  # fmt: skip
"""Arrays of the batch that a trajectory is made of."""


def check_plan(plan: Plan) -> None:
    """Refuse what runs one by one only, before anything is run.

    Raises:
        InputError: the policy looks at its environment, and not at a batch of these.
    """
    is_diving = all(isinstance(episode.scenario, Scenario) for episode in plan.episodes)
    check_batched(plan.policy, is_diving=is_diving, otherwise="Leave out --backend batch.")


@contextmanager
def open_batch(spec: EvaluationSpec, plan: Plan, count: int) -> Iterator[Runner]:
    """Yield what runs episodes side by side; their tasks come in the plan's order. See `open_runner`."""
    num = num_policies(plan.policy, min(count, BATCH_SIZE))

    def load() -> list[LoadedPolicy]:
        return [spec.load(spec.policy) for _ in range(num)]

    writer = EpisodeWriter(spec.output, is_filming=spec.options.film)
    with closing(BatchRunner(load(), spec.options, CallTimeout(spec.options.action_time_limit))) as runner:
        yield partial(_rows_of, runner, writer, plan, load)


def _rows_of(
    runner: BatchRunner, writer: EpisodeWriter, plan: Plan, load: Callable[[], list[LoadedPolicy]], tasks: Tasks
) -> Iterator[Row]:
    for batch in task_batches(plan, (task for task in tasks if task is not None)):
        runner.renew(batch[0].policy_sha256, load)
        episodes = [plan.episodes[task.index] for task in batch]
        for episode, task, (trajectory, metrics) in zip(episodes, batch, runner.run(episodes), strict=True):
            yield writer.keep(episode, task.record, trajectory, metrics)


def task_batches(plan: Plan, tasks: Iterable[Task]) -> Iterator[tuple[Task, ...]]:
    """Yield tasks of one scenario and condition, at most `BATCH_SIZE` together; none is asked for before its turn."""

    def key(task: Task) -> tuple[str, Condition]:
        episode = plan.episodes[task.index]
        return episode.scenario.name, episode.condition

    for _, group in itertools.groupby(tasks, key=key):
        while batch := tuple(itertools.islice(group, BATCH_SIZE)):
            yield batch


def num_policies(loaded: LoadedPolicy, size: int) -> int:
    """Return how many policies a batch of so many episodes takes."""
    return 1 if isinstance(loaded.policy, Vectorised | BatchPrivileged) else size


class BatchRunner:
    """Runs batches of episodes.

    A vectorised policy computes the logits of all vehicles at once, and one that knows the maps chooses for all of
    them; otherwise each vehicle has a policy of its own, as that may remember what it saw.
    """

    def __init__(
        self, policies: Sequence[LoadedPolicy], options: ProtocolOptions, timeout: CallTimeout | None = None
    ) -> None:
        """Take over policies that were loaded one by one: `num_policies` of them."""
        self._policies, self._options, self._timeout = policies, options, timeout or CallTimeout()
        self._policy_sha256: str | None = None
        self._task: Batch | None = None
        self._key: tuple[AnyScenario, TaskOptions, int] | None = None

    def renew(self, policy_sha256: str | None, load: Callable[[], Sequence[LoadedPolicy]]) -> None:
        """Take newly loaded policies where the file has another hash than at the last call; None is as they came."""
        if policy_sha256 != self._policy_sha256:
            self._policies, self._policy_sha256 = load(), policy_sha256

    def run(self, batch: Sequence[EpisodeSpec]) -> list[tuple[Trajectory, EpisodeMetrics]]:
        """Return the trajectory of each episode of a batch, and its metrics."""
        task = self._prepare(batch)
        plans = [episode.plan for episode in batch]
        task.reset([plan.seed for plan in plans], [plan.start_index for plan in plans])
        path_lengths, route_lengths, starts = task.path_lengths, task.route_lengths, task.copy_of("start_indices")
        policies = [_within(loaded.policy, task) for loaded in self._policies]
        slots = [EpisodeSlot(policy, plan) for policy, plan in zip(itertools.cycle(policies), plans, strict=False)]
        for name, values in task.dynamics.items():
            for slot, value in zip(slots, values.tolist(), strict=True):
                slot.dynamics[name] = float(value)
        with self._timeout.armed():
            states = self._run(task, slots)
        reference = reference_of(batch[0], task_of(batch[0], self._options))
        finished = []
        for index, (episode, slot) in enumerate(zip(batch, slots, strict=True)):
            rows = {name: values[:, index] for name, values in states.items()}
            trajectory = _trajectory(task, slot, rows, int(starts[index]), float(route_lengths[index]))
            finished.append((trajectory, measure(trajectory, float(path_lengths[index]), reference, episode.index)))
        return finished

    def close(self) -> None:
        """Free the batch."""
        if self._task is not None:
            self._task.close()
        self._task = self._key = None

    def _prepare(self, batch: Sequence[EpisodeSpec]) -> Batch:
        """Return the vehicles: the last ones where all but starts and seeds is the same."""
        key = (batch[0].scenario, task_of(batch[0], self._options), len(batch))
        if self._task is None or self._key is None or self._key[0] is not key[0] or self._key[1:] != key[1:]:
            self.close()
            self._task = make_batch(
                key[0],
                len(batch),
                next_step=True,
                max_decisions=self._options.max_decisions,
                **observed_by(self._policies[0], key[1]),
            )
            self._key = key
            check_size(self._policies[0], self._task.observation_space)
        return self._task

    def _run(self, task: Batch, slots: Sequence[EpisodeSlot]) -> dict[str, npt.NDArray[Any]]:
        """Run until the last episode has ended; return the batch's arrays, (D + 1, N, ...), at each decision."""
        timeout, form = self._timeout, ActionModel(self._policies[0].action, task.parts)
        policy = slots[0].policy if isinstance(slots[0].policy, Vectorised) else None
        for slot in slots:
            if isinstance(slot.policy, Adapting):
                slot.policy.adapt(task.action_space)
            slot.reason = timeout.outcome(partial(begin_episode, slot.policy, slot.plan.seed))[1]
        commands = np.zeros((len(slots), 3), dtype=np.float32)
        rows = [{name: task.copy_of(name) for name in KEPT}]
        running = _unfailed(task, slots, range(len(slots)))
        while running:
            seen: Any = task.view_of("observations")  # policies get copies
            if policy is not None:
                seen = self._logits(policy, slots, seen, running)
            for index in [index for index in running if not slots[index].reason]:
                slot, act = slots[index], slots[index].policy.act if policy is None else policy.decide
                told = seen[index] if policy is not None else row_of(seen, index)
                chosen, slot.reason = timeout.outcome(partial(choose, act, form, told))
                if not slot.reason:
                    slot.actions.append(chosen[0])
                    slot.commands.append(chosen[1])
                    commands[index] = chosen[1]
            task.set_commands(commands)
            task.step()
            rows.append({name: task.copy_of(name) for name in KEPT})
            was_running = running
            running = [index for index in _unfailed(task, slots, running) if rows[-1]["outcomes"][index] == 0]
            task.retire([index for index in was_running if index not in running])
        return {name: np.stack([row[name] for row in rows]) for name in KEPT}

    def _logits(
        self,
        policy: Vectorised,
        slots: Sequence[EpisodeSlot],
        observations: Any,
        running: Sequence[int],
    ) -> dict[int, npt.NDArray[np.float32]]:
        """Return a policy's logits for each vehicle, by its slot; where it fails, the vehicle's slot gets the reason.

        Where it cannot compute them for all at once, it is asked about one by one, to find out whom that is about.
        """

        def ask(indices: Sequence[int]) -> npt.NDArray[np.float32]:
            logits = np.asarray(policy.logits(row_of(observations, indices), np.array(indices)))
            if len(logits) != len(indices):
                raise ValueError(f"it gave {len(logits)} rows of logits for {len(indices)} vehicles")
            return logits

        together, reason = self._timeout.outcome(partial(ask, running))
        if not reason:
            return dict(zip(running, together, strict=True))
        logits = {}
        for index in running:
            alone, slots[index].reason = self._timeout.outcome(partial(ask, [index]))
            if not slots[index].reason:
                logits[index] = alone[0]
        return logits


@dataclass
class EpisodeSlot:
    """A policy that runs an episode, and what it did."""

    policy: Policy
    plan: EpisodePlan
    actions: list[Any] = field(default_factory=list)
    commands: list[tuple[float, ...]] = field(default_factory=list)
    reason: str = ""
    """Why it failed; empty unless it did."""
    dynamics: dict[str, float] = field(default_factory=dict)
    """What the episode drew of its vehicle's, by name."""


def _within(policy: Policy, task: Batch) -> Policy:
    """Return the policy, or what chooses in its place for the vehicles of a batch that it looks at."""
    return policy.within(task) if isinstance(policy, BatchPrivileged) else policy


def _unfailed(task: Batch, slots: Sequence[EpisodeSlot], places: Sequence[int]) -> list[int]:
    """Return at which of some places nothing failed; where code of the user's own did, the slot gets the reason."""
    for place in places:
        slots[place].reason = slots[place].reason or task.failures.get(place, "")
    return [place for place in places if not slots[place].reason]


def _trajectory(
    task: Batch, slot: EpisodeSlot, states: dict[str, npt.NDArray[Any]], start: int, length: float
) -> Trajectory:
    """Return the trajectory of one vehicle from its (D + 1, ...) states and those after the end of its episode."""
    count = len(slot.actions)
    rows = {name: values[: count + 1] for name, values in states.items()}
    touched = rows["touched"] > 0
    currents = rows["currents"].astype(np.float64)
    return Trajectory(
        seed=slot.plan.seed,
        start_index=start,
        outcome=FAILED if slot.reason else OUTCOMES[int(rows["outcomes"][-1])],
        times=task.decision_seconds * np.arange(count + 1, dtype=np.float64),
        positions=rows["positions"].astype(np.float64),
        orientations=rows["orientations"].astype(np.float64),
        velocities=rows["velocities"].astype(np.float64),
        currents=currents,
        rays=rows["rays"],
        clearances=rows["clearances"].astype(np.float64),
        collided=touched,
        progress=length - rows["remaining"],
        costs=touched.astype(np.float64),
        actions=np.array(slot.actions, dtype=np.float64).reshape(count, -1 if count else 0),
        commands=np.array(slot.commands, dtype=np.float64).reshape(-1, 3),
        rewards=rows["rewards"][1:].astype(np.float64),
        reward_terms={name: rows["terms"][1:, n].astype(np.float64) for n, name in enumerate(task.term_names)},
        num_collisions=int(rows["collisions"][-1]),
        reason=slot.reason,
        dynamics=slot.dynamics,
    )
