"""Flying the episodes of an evaluation side by side, on the batched backend.

The episodes of one scenario and condition fly beside each other, in the order of the plan. An episode draws from its
own seed alone, and a network computes blocks of one size (`padding.py`), so that an episode is the same to the bit
whatever flies beside it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.batch import Batch, check_batched
from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.places import Place, make_batch
from aquanav_tools.envs.reward import TERMS
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.flight import Flight, course_of, task_of
from aquanav_tools.evaluate.metrics import EpisodeMetrics, measure
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.pilot import Orders, Plan, Row, Scribe, Task
from aquanav_tools.evaluate.policies import Adapting, Boarding, LoadedPolicy, Policy, Vectorised
from aquanav_tools.evaluate.protocol import Condition, EpisodePlan
from aquanav_tools.evaluate.rollout import Watch, begin_episode, choose
from aquanav_tools.report.track import FAILED, Track
from aquanav_tools.task import TaskOptions, choices_of

BATCH_SIZE = 256
"""Episodes side by side: chosen; more take memory, about 0.4 kB for each decision of each."""
KEPT = (
    "positions", "orientations", "velocities", "currents", "clearances", "touched", "collisions", "remaining",
    "observations", "terms", "rewards", "outcomes",
)  # fmt: skip
"""Arrays of the fleet that a track is made of."""


def check_plan(plan: Plan) -> None:
    """Refuse what only PyBullet's backend can fly, before anything is flown.

    Raises:
        InputError: the policy looks at PyBullet's world, or at the original's observation.
    """
    if isinstance(plan.policy.policy, Boarding):
        raise InputError(
            f"{plan.policy.name} looks at its own vehicle or at the map in PyBullet's world, which a batch does not "
            "have. Leave out --backend batch."
        )
    check_batched(plan.policy.observation)


def run_batched(orders: Orders, plan: Plan, tasks: Iterator[Task | None], count: int) -> Iterator[Row]:
    """Yield the journal's rows of `count` tasks, which come in the plan's order."""
    if count == 0:
        return
    policies = [orders.load(orders.policy) for _ in range(num_policies(plan.policy, min(count, BATCH_SIZE)))]
    squadron = Squadron(policies, orders.options, Watch(orders.options.action_time_limit))
    scribe = Scribe(orders.output, is_filming=orders.options.film)
    asked = (task for task in tasks if task is not None)
    try:
        for batch in task_batches(plan, asked):
            flights = [plan.flights[task.index] for task in batch]
            for flight, task, (track, metrics) in zip(flights, batch, squadron.fly(flights), strict=True):
                yield scribe.keep(flight, task.record, track, metrics)
    finally:
        squadron.close()


def task_batches(plan: Plan, tasks: Iterable[Task]) -> Iterator[tuple[Task, ...]]:
    """Yield tasks of one scenario and condition, at most `BATCH_SIZE` together; none is asked for before its turn."""

    def place(task: Task) -> tuple[str, Condition]:
        flight = plan.flights[task.index]
        return flight.scenario.name, flight.condition

    for _, group in itertools.groupby(tasks, key=place):
        while batch := tuple(itertools.islice(group, BATCH_SIZE)):
            yield batch


def num_policies(loaded: LoadedPolicy, size: int) -> int:
    """Return how many policies a batch of so many episodes takes."""
    return 1 if isinstance(loaded.policy, Vectorised) else size


class Squadron:
    """Flies batches of episodes.

    A policy that can thinks about all vehicles at once; otherwise each vehicle has one of its own, as it may remember
    what it saw.
    """

    def __init__(self, policies: Sequence[LoadedPolicy], options: ProtocolOptions, watch: Watch | None = None) -> None:
        """Take over policies that were loaded one by one: `num_policies` of them."""
        self._policies, self._options, self._watch = policies, options, watch or Watch()
        self._task: Batch | None = None
        self._place: tuple[Place, TaskOptions, int] | None = None

    def fly(self, batch: Sequence[Flight]) -> list[tuple[Track, EpisodeMetrics]]:
        """Return the track of each episode of a batch, and its metrics."""
        task = self._prepare(batch)
        plans = [flight.plan for flight in batch]
        task.reset([plan.seed for plan in plans], [plan.start_index for plan in plans])
        ways, lengths, starts = task.ways, task.route_lengths, task.copy_of("start_indices")
        seats = [
            Seat(loaded.policy, plan) for loaded, plan in zip(itertools.cycle(self._policies), plans, strict=False)
        ]
        with self._watch.kept():
            states = self._fly(task, seats)
        course = course_of(batch[0], task_of(batch[0], self._options))
        flown = []
        for place, (flight, seat) in enumerate(zip(batch, seats, strict=True)):
            rows = {name: values[:, place] for name, values in states.items()}
            track = _track(task, seat, rows, int(starts[place]), float(lengths[place]))
            flown.append((track, measure(track, float(ways[place]), course, flight.index)))
        return flown

    def close(self) -> None:
        """Free the batch."""
        if self._task is not None:
            self._task.close()
        self._task = self._place = None

    def _prepare(self, batch: Sequence[Flight]) -> Batch:
        """Return the vehicles: the last ones where all but starts and seeds is the same."""
        place = (batch[0].scenario, task_of(batch[0], self._options), len(batch))
        if self._task is None or self._place is None or self._place[0] is not place[0] or self._place[1:] != place[1:]:
            self.close()
            self._task = make_batch(
                place[0],
                len(batch),
                next_step=True,
                observation=self._policies[0].observation,
                action=self._policies[0].action,
                max_decisions=self._options.max_decisions,
                **choices_of(place[1]),
            )
            self._place = place
        return self._task

    def _fly(self, task: Batch, seats: Sequence[Seat]) -> dict[str, npt.NDArray[Any]]:
        """Fly until the last episode has ended; return the fleet's arrays, (D + 1, N, ...), at each decision."""
        watch, form = self._watch, ActionModel(self._policies[0].action, task.parts)
        mind = seats[0].policy if isinstance(seats[0].policy, Vectorised) else None
        for seat in seats:
            if isinstance(seat.policy, Adapting):
                seat.policy.adapt(task.action_space)
            seat.reason = watch.outcome(partial(begin_episode, seat.policy, seat.plan.seed))[1]
        commands = np.zeros((len(seats), 3), dtype=np.float32)
        rows = [{name: task.copy_of(name) for name in KEPT}]
        flying = [place for place, seat in enumerate(seats) if not seat.reason]
        while flying:
            seen: Any = rows[-1]["observations"]
            if mind is not None:
                seen = self._thoughts(mind, seats, seen, flying)
            for place in [place for place in flying if not seats[place].reason]:
                seat, act = seats[place], seats[place].policy.act if mind is None else mind.decide
                chosen, seat.reason = watch.outcome(partial(choose, act, form, seen[place].copy()))
                if not seat.reason:
                    seat.actions.append(chosen[0])
                    seat.commands.append(chosen[1])
                    commands[place] = chosen[1]
            task.hold(commands)
            task.step()
            rows.append({name: task.copy_of(name) for name in KEPT})
            was_flying = flying
            flying = [place for place in flying if not seats[place].reason and rows[-1]["outcomes"][place] == 0]
            task.rest([place for place in was_flying if place not in flying])
        return {name: np.stack([row[name] for row in rows]) for name in KEPT}

    def _thoughts(
        self, mind: Vectorised, seats: Sequence[Seat], observations: npt.NDArray[np.float32], flying: Sequence[int]
    ) -> dict[int, npt.NDArray[np.float32]]:
        """Return by its place what a policy thinks about each vehicle; where it cannot, its seat gets the reason.

        Where it cannot think about all at once, it is asked about one by one, to find out whom that is about.
        """

        def think(places: Sequence[int]) -> npt.NDArray[np.float32]:
            thoughts = np.asarray(mind.think(observations[places], np.array(places)))
            if len(thoughts) != len(places):
                raise ValueError(f"it gave {len(thoughts)} thoughts about {len(places)} vehicles")
            return thoughts

        together, reason = self._watch.outcome(partial(think, flying))
        if not reason:
            return dict(zip(flying, together, strict=True))
        thoughts = {}
        for place in flying:
            alone, seats[place].reason = self._watch.outcome(partial(think, [place]))
            if not seats[place].reason:
                thoughts[place] = alone[0]
        return thoughts


@dataclass
class Seat:
    """A policy that flies an episode, and what it did."""

    policy: Policy
    plan: EpisodePlan
    actions: list[Any] = field(default_factory=list)
    commands: list[tuple[float, ...]] = field(default_factory=list)
    reason: str = ""
    """Why it failed; empty unless it did."""


def _track(task: Batch, seat: Seat, states: dict[str, npt.NDArray[Any]], start: int, length: float) -> Track:
    """Return the track of one vehicle from its (D + 1, ...) states and those after the end of its episode."""
    count = len(seat.actions)
    rows = {name: values[: count + 1] for name, values in states.items()}
    rays = rows["observations"][:, : len(task.ray_lengths)] * task.ray_lengths
    touched = rows["touched"] > 0
    # The fleet keeps the current of where a decision began, with its end.
    currents = np.concatenate([rows["currents"][1:], rows["currents"][-1:]]).astype(np.float64)
    return Track(
        seed=seat.plan.seed,
        start_index=start,
        outcome=FAILED if seat.reason else OUTCOMES[int(rows["outcomes"][-1])],
        times=task.decision_seconds * np.arange(count + 1, dtype=np.float64),
        positions=rows["positions"].astype(np.float64),
        orientations=rows["orientations"].astype(np.float64),
        velocities=rows["velocities"].astype(np.float64),
        currents=currents,
        rays=rays,
        clearances=rows["clearances"].astype(np.float64),
        collided=touched,
        progress=length - rows["remaining"],
        costs=touched.astype(np.float64),
        actions=np.array(seat.actions, dtype=np.float64).reshape(count, -1 if count else 0),
        commands=np.array(seat.commands, dtype=np.float64).reshape(-1, 3),
        rewards=rows["rewards"][1:].astype(np.float64),
        reward_terms={name: rows["terms"][1:, n].astype(np.float64) for n, name in enumerate(TERMS)},
        num_collisions=int(rows["collisions"][-1]),
        reason=seat.reason,
    )
