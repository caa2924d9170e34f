"""The benchmark's task for N vehicles in caves: what `CaveEnv` is for one and the vector environment for many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.batch import Floats
from aquanav_tools.envs.batch_view import BatchView
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.dict_observation import Parts, parts_of
from aquanav_tools.envs.episode import COLLISION_RULES
from aquanav_tools.envs.extended_batch import ExtendedBatch
from aquanav_tools.envs.extensions import Extensions
from aquanav_tools.envs.observation import observation_space
from aquanav_tools.envs.reward import TERMS, cave_weights
from aquanav_tools.envs.starting import CONDITIONS, NUM_SEEDS, Starts, check_start
from aquanav_tools.envs.vehicles import prepared
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.command import DIVING
from aquanav_tools.sim.contacts import Contacts, load_bullet
from aquanav_tools.sim.randomisation import read_randomisation
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.time_limit import decision_limit
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.sim.water import WaterParts, water_of
from aquanav_tools.task import MEASURES, TaskOptions, task_options
from aquanav_tools.types import Array, Pose

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.oracle import BatchOracle
    from aquanav_tools.sim.batch.setup import CaveSetup

RAY_SOURCES = ("field", "mesh")
CaveSpec = str | Path | Scenario
CURRENT, ORACLE = "places/current", "oracle/"
"""Name of the array of the caves of now in `state`, and beginning of the names of what the oracle remembers."""


@dataclass(frozen=True, eq=False)
class _Room:
    """One cave, with what is made of it."""

    scenario: Scenario
    vehicle: Vehicle
    starts: Starts
    setup: CaveSetup


class CaveBatch(ExtendedBatch):
    """N vehicles in one cave or several, with the options and definitions of `CaveEnv`."""

    _oracle: BatchOracle | None = None

    def __init__(
        self,
        scenarios: CaveSpec | Sequence[CaveSpec],
        num: int,
        *,
        next_step: bool,
        observation: str | Parts = "full",
        action: str = "multidiscrete",
        vehicle: str | Path | Vehicle | None = None,
        max_decisions: int | None = None,
        rays: str = "field",
        contacts: Contacts = "own",
        device: str = "cpu",
        num_threads: int | None = None,
        replaceable: bool = False,
        **task: Any,
    ) -> None:
        """Load scenarios and prepare their physics.

        Args:
            scenarios: A scenario folder or a scenario in memory; or several, over which the vehicles are shared out
                evenly, in order.
            num: Number of vehicles.
            next_step: Whether an ended episode's successor begins at the next step, or in the same one.
            observation: "paper", "full" or "original"; or several parts by name, for a `Dict`: sensors
                (docs/sensors.md), and one of these at most.
            action: "multidiscrete", "discrete" or "continuous".
            vehicle: As `CaveEnv` takes it.
            max_decisions: Episode limit; None takes each scenario's, which grows with the way (`sim.time_limit`).
            rays: "field" traces them through the distance field, "mesh" casts them exactly, which takes about twice
                as long. The observation "original" casts spheres through the field.
            contacts: "own" solves them beside the rest, on many vehicles at once; "bullet" asks PyBullet about one
                vehicle after the other.
            device: "cpu", "cuda" or "cuda:0".
            num_threads: On the processor; None takes as many as the process may use.
            replaceable: Whether other caves may take the place of these while the batch goes on: see `replace`.
            task: The fields of `aquanav_tools.task.TaskOptions`.

        Raises:
            ScenarioError: a scenario cannot be read, or has no start.
            InputError: an option is unknown or senseless, the vehicle's hull does not fit, or there are fewer vehicles
                than caves.
            ResourceError: PyBullet is asked for, and not installed.
        """
        from aquanav_tools.sim.batch.setup import WorldOptions
        from aquanav_tools.sim.batch.world import BatchWorld

        several = [scenarios] if isinstance(scenarios, str | Path | Scenario) else list(scenarios)
        self.task = options = task_options(task)
        _check_choices(options, rays, contacts, device)
        _check_replaceable(replaceable, next_step, contacts)
        self.parts: tuple[str, ...] = DIVING
        self._actions = ActionModel(action)
        self.action_space = self._actions.space
        self._parts = parts_of(observation, options.observation_delay)
        self._own = own = Extensions(options, str(getattr(self._parts, "preset", observation)), self._parts)
        self.ray_lengths = original_pattern().lengths
        self._share_out(num, len(several))
        self._vehicle, self._max_decisions, self.contacts = vehicle, max_decisions, contacts
        pairs = [prepared(scenario, vehicle) for scenario in several]
        self._rooms = [self._room(*pair) for pair in pairs] * (2 if replaceable else 1)
        """Of each cave; the second half is for those that take the place of the first, and the other way round."""
        self.decision_seconds = _decision_seconds(self.scenarios)
        world_options = WorldOptions(
            observation=own.observation,
            rays="mesh" if rays == "mesh" else "field",
            action_delay=options.action_delay,
            observation_delay=own.observation_delay,
            randomisation=None if options.randomisation is None else read_randomisation(options.randomisation),
            next_step=next_step,
            device=device,
            num_threads=num_threads,
            law=own.law(pairs[0][0].settings.limits.dt),
        )
        setups = [room.setup for room in self._rooms]
        self.world = BatchWorld(setups, self.cave_of, world_options, self._engines(contacts))
        self.observation_space = self._prepare_observations(pairs, num_threads)

    def _share_out(self, num: int, num_caves: int) -> None:
        """Share the vehicles out over the caves."""
        self.num = num
        self.slices = slices_of(num, num_caves)
        """Vehicles of each scenario."""
        if len(self.slices) < num_caves:
            raise InputError(f"{num_caves} scenarios need at least as many vehicles, got {num}.")
        self.slots = np.repeat(np.arange(num_caves), [part.stop - part.start for part in self.slices])
        """(N,) place of each vehicle, which it keeps."""
        self.current_caves = np.arange(num_caves)
        """Index of the cave of now in each place."""
        self.cave_of = self.slots.copy()
        """(N,) index of the cave that each vehicle is in."""

    def _room(self, scenario: Scenario, vehicle: Vehicle) -> _Room:
        """Return what is made of a cave and the vehicle in it."""
        starts = Starts(scenario, vehicle.capsule, self.task.starts, self.task.start_range)
        setup = _setup(scenario, vehicle, self.task, self._own.reward, starts, self._max_decisions)
        return _Room(scenario, vehicle, starts, setup)

    def _prepare_observations(
        self, pairs: list[tuple[Scenario, Vehicle]], num_threads: int | None
    ) -> spaces.Space[Any]:
        """Return the space of what is observed, having made room for what the user's own code and sensors give."""
        from aquanav_tools.sim.batch.sensors.base import SensorBatch

        own, world, seconds = self._own, self.world, self.decision_seconds
        view = partial(BatchView, num=self.num, ray_lengths=self.ray_lengths, decision_seconds=seconds)
        make_sensors = partial(SensorBatch, world.arrays, world.caves, seconds, world.device, num_threads)
        preset = observation_space(own.observation)
        space = own.prepare(view, world, preset, pairs, make_sensors)
        return space if self._parts is None else self._parts.prepare(world, preset, pairs, make_sensors, own)

    def _engines(self, contacts: str) -> list[Any]:
        if contacts == "own":
            return []
        engine = load_bullet()
        rooms = [self._rooms[cave] for cave in self.cave_of.tolist()]
        return [engine(room.scenario, room.vehicle) for room in rooms]

    @property
    def scenarios(self) -> list[Scenario]:
        """The caves, by `cave_of`."""
        return [room.scenario for room in self._rooms]

    @property
    def vehicles(self) -> list[Vehicle]:
        """The vehicle in each cave."""
        return [room.vehicle for room in self._rooms]

    @property
    def starts(self) -> list[Starts]:
        """What chooses the starts in each cave."""
        return [room.starts for room in self._rooms]

    @property
    def limits(self) -> npt.NDArray[np.int64]:
        """(N,) decisions after which an episode is truncated."""
        return np.array([room.setup.task.max_decisions for room in self._rooms])[self.cave_of]

    @property
    def route_lengths(self) -> Array:
        """(N,) length of the guide, m."""
        return np.array([room.scenario.guide.length for room in self._rooms])[self.cave_of]

    @property
    def path_lengths(self) -> Array:
        """(N,) length of the shortest way to the goal from where each episode began, m."""
        rows = zip(self.cave_of, self.view_of("beginnings"), self.view_of("start_indices").tolist(), strict=True)
        starts = self.starts
        return np.array([starts[cave].way_to_goal(position, index) for cave, position, index in rows])

    def reset(
        self,
        seeds: Sequence[int],
        starts: Sequence[int | None] | None = None,
        conditions: dict[str, Any] | None = None,
    ) -> None:
        """Begin all episodes, each from a seed of its own: see `Batch`."""
        self._move(np.arange(self.num))
        first = None
        if starts is not None:
            counts = [len(self._rooms[cave].scenario.starts) for cave in self.cave_of.tolist()]
            chosen = zip(starts, counts, strict=True)
            first = np.array([-1 if start is None else check_start(start, count) for start, count in chosen], np.int32)
        given = {name: getattr(self.task, name) for name in CONDITIONS} | (conditions or {})
        self.world.reset(np.array([seed % NUM_SEEDS for seed in seeds]), first, given)
        self._begin_observing()

    def randomise_time_limits(self, seed: int) -> None:
        """Let time run out earlier, by chance, in the episodes that have just begun."""
        self.world.age(np.random.default_rng(seed).integers(self.limits))

    def replace(self, place: int, scenario: CaveSpec) -> bool:
        """Let another cave take a place: each vehicle there goes into it when its episode ends.

        Args:
            place: Which of the scenarios that the batch began with, by its index, or what took its place since.
            scenario: The cave, with the vehicle that dives it.

        Returns:
            Whether it does; not while vehicles are still in the cave before, and then nothing is changed.

        Raises:
            ScenarioError: the scenario cannot be read.
            InputError: it does not go into this batch.
        """
        other = self._other(place)
        if (self.cave_of == other).any():
            return False
        self.put(other, scenario)
        self.current_caves[place] = other
        return True

    def put(self, index: int, scenario: CaveSpec) -> None:
        """Put a cave where no vehicle is, in the second half of a place or in the first: see `replace`."""
        room = self._room(*prepared(scenario, self._vehicle))
        _decision_seconds([self._rooms[0].scenario, room.scenario])
        self.world.replace_cave(index, room.setup)
        self._rooms[index] = room
        if self._oracle is not None:
            self._oracle.put(index, room.scenario, room.vehicle)

    def advice(self) -> Floats:
        """Return the (N, 3) ballast, steer and thrust that the oracle, which knows map and water, would command now.

        The first call finds the ways in all caves: about a second for each.

        Raises:
            InputError: the batch is on a GPU, or the vehicle is the original's or has thrusters of its own.
            MeshError: there is no way for a vehicle in its cave.
        """
        return self._make_oracle()()

    def close(self) -> None:
        """End the threads, and let go of the physics. Closing twice does nothing."""
        if self._oracle is not None:
            self._oracle.close()
        super().close()

    def _make_oracle(self) -> BatchOracle:
        if self._oracle is None:
            from aquanav_tools.sim.batch.oracle import BatchOracle

            self._oracle = BatchOracle(self.world, [(room.scenario, room.vehicle) for room in self._rooms])
        return self._oracle

    @property
    def _is_replaceable(self) -> bool:
        return len(self._rooms) > len(self.slices)

    def _other(self, place: int) -> int:
        assert self._is_replaceable, "this batch's caves stay"
        num_places = len(self.slices)
        return int(place + num_places if self.current_caves[place] == place else place)

    def _judge(self) -> None:
        """Look at what the decision led to; then vehicles whose episodes have ended go into the caves of now."""
        super()._judge()
        if self._is_replaceable:
            self._move(np.flatnonzero(self.view_of("outcomes") > 0))

    def _move(self, vehicles: npt.NDArray[np.int64]) -> None:
        """Let the next episodes of vehicles begin in the caves that are in their places now."""
        wanted = self.current_caves[self.slots[vehicles]]
        is_new = wanted != self.cave_of[vehicles]
        if is_new.any():
            self.cave_of[vehicles] = wanted
            self.world.move(vehicles[is_new], wanted[is_new])

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all arrays. Which caves there are is not in it."""
        own = self._own.state() | ({} if self._parts is None else self._parts.state())
        places = {CURRENT: self.current_caves.copy()} if self._is_replaceable else {}
        advised = {} if self._oracle is None else {ORACLE + key: kept for key, kept in self._oracle.state().items()}
        return self.world.state() | places | own | advised

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken, with the same caves."""
        self.cave_of[:] = state["cave_of"]
        if self._is_replaceable:
            self.current_caves[:] = state[CURRENT]
        self.world.restore({name: values for name, values in state.items() if "/" not in name})
        if advised := {name.removeprefix(ORACLE): kept for name, kept in state.items() if name.startswith(ORACLE)}:
            self._make_oracle().restore(advised)
        self._own.restore(state)
        if self._parts is not None:
            self._parts.restore(state)


def slices_of(num: int, num_parts: int) -> list[slice]:
    """Return the vehicles of each part, as even as can be; none of them goes empty."""
    bounds = np.linspace(0, num, min(num_parts, num) + 1).round().astype(int).tolist()
    return [slice(first, last) for first, last in pairwise(bounds)]


def _check_choices(options: TaskOptions, rays: str, contacts: str, device: str) -> None:
    check_choice("source of rays", rays, RAY_SOURCES)
    check_choice("solver of contacts", contacts, get_args(Contacts))
    check_choice("measure of progress", options.progress, MEASURES)
    check_choice("collision rule", options.on_collision, COLLISION_RULES)
    if contacts == "bullet" and device != "cpu":
        raise InputError(f"PyBullet's contacts are solved on the processor, not on {device}. Choose contacts='own'.")
    if options.motion and device != "cpu":
        raise InputError(f"A law of motion of your own is computed on the processor, not on {device}. Leave that out.")


def _check_replaceable(replaceable: bool, next_step: bool, contacts: str) -> None:
    if replaceable and (next_step or contacts != "own"):
        raise InputError("Caves are replaced in batches with contacts of their own only, and not at the next step.")


def _decision_seconds(scenarios: Sequence[Scenario]) -> float:
    """Return how long a decision takes, s, which must be the same in all scenarios of a batch."""
    durations = {scenario.settings.limits.dt * scenario.settings.limits.substeps for scenario in scenarios}
    if len(durations) > 1:
        raise InputError(f"Decisions take {sorted(durations)} s in these scenarios; in one batch they must be as long.")
    return durations.pop()


def _setup(
    scenario: Scenario,
    vehicle: Vehicle,
    options: TaskOptions,
    reward: str,
    starts: Starts,
    max_decisions: int | None,
) -> CaveSetup:
    from aquanav_tools.sim.batch.caves import CaveTask
    from aquanav_tools.sim.batch.setup import CaveSetup

    limit = decision_limit(scenario, vehicle) if max_decisions is None else max_decisions
    if limit < 1:
        raise InputError(f"max_decisions must be at least 1, got {limit}.")
    weights = cave_weights(reward, vehicle)
    task = CaveTask(
        goal=np.array(scenario.settings.goal.position, dtype=np.float64),
        tolerance=scenario.settings.goal.tolerance,
        max_decisions=limit,
        ends_on_collision=weights.ends_on_collision or options.on_collision == "end",
        weights=tuple(getattr(weights, name) for name in TERMS),
        entrance=scenario.guide.centres[0],
        water=_water_of(scenario, options.current),
        progress=options.progress,
        start_numbers=starts.numbers,
    )
    return CaveSetup(scenario, vehicle, task, partial(_drawn, starts) if options.starts == "anywhere" else None)


def _drawn(starts: Starts, seed: int) -> Pose:
    return starts.draw(np.random.default_rng(seed))


def _water_of(scenario: Scenario, current: Current | None) -> WaterParts:
    try:
        return water_of(scenario, current)
    except ValueError as cause:
        raise InputError(f"{cause} Choose another current.") from cause
