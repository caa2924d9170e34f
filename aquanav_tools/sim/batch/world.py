"""All vehicles of a batch: their arrays on a device, and the kernels launched on them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch import kernels
from aquanav_tools.sim.batch.caves import Cave, CaveTask, make_cave
from aquanav_tools.sim.batch.craft import CONTACT_MARGIN, Craft, make_craft
from aquanav_tools.sim.batch.engine import ContactEngine, EngineLink
from aquanav_tools.sim.batch.observation import ORIGINAL, PRESETS, make_fan
from aquanav_tools.sim.batch.random import NEXT, draw_many
from aquanav_tools.sim.batch.runtime import find_device
from aquanav_tools.sim.batch.starts import CaveStarts, UnlistedStarts
from aquanav_tools.sim.batch.state import BatchState, make_exchange, make_state
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Pose

RaySource = Literal["field", "mesh"]
MAX_VEHICLES = 1 << 20
"""Chosen; 2 GB."""
PARTS_ON_GPU = 4
"""Threads that share the rays of a vehicle."""
MIN_SLICE = 256
"""Vehicles for which a further thread is worth its start."""
SORT_EVERY = 32
"""Decisions after which vehicles are put in order of place again: about a metre's way."""
NUM_TERMS = 7
CONDITIONS = {"sensor_noise": "ray_noise", "sensor_dropout": "ray_dropout", "current_range": "current_ranges"}
"""Options of the task that each episode may have of its own, and the arrays that hold them."""


@dataclass(frozen=True, eq=False)
class CaveSetup:
    """One of the caves of a batch."""

    scenario: Scenario
    vehicle: Vehicle
    """Moves and collides as all vehicles in this cave do."""
    task: CaveTask
    draw_start: Callable[[int], Pose] | None = None
    """Returns the start of the episode with a seed from 0 to 2^32 - 1; None draws from the scenario's list."""


@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """What all vehicles of a batch have in common."""

    observation: str = "full"
    """One of `observation.PRESETS`."""
    rays: RaySource = "field"
    """Traced through the distance field, or cast exactly against the mesh."""
    action_delay: int = 0
    """Decisions between choosing an action and its effect."""
    observation_delay: int = 0
    """Decisions by which observations are late."""
    next_step: bool = True
    """Whether an ended episode's successor begins at the next step (its command is not used then), or in the same."""
    device: str = "cpu"
    """"cpu", "cuda" or "cuda:0"."""
    num_threads: int | None = None
    """On the processor; None takes as many as the process may use."""


class BatchWorld:
    """N vehicles in caves. Each step is a decision of every vehicle; ended episodes are followed by new ones.

    The arrays in `arrays` are Warp's, on `device`; `as_numpy` and `as_torch` show them without a copy.
    """

    def __init__(
        self,
        caves: Sequence[CaveSetup],
        cave_of: npt.NDArray[np.integer],
        options: WorldOptions,
        engines: Sequence[ContactEngine] = (),
    ) -> None:
        """Upload caves and make room for vehicles; call `reset` next.

        Args:
            caves: One or several, all with starts drawn from lists, or none of them.
            cave_of: (N,) index of the cave that each vehicle is in.
            options: Of all vehicles.
            engines: (N,) what says for each vehicle what the wall does, outside of the kernels; none leaves it to them.

        Raises:
            InputError: no such device, or a senseless number.
        """
        self.num = num = len(cave_of)
        if not 1 <= num <= MAX_VEHICLES:
            raise InputError(f"A batch must have 1 to {MAX_VEHICLES} vehicles, got {num}.")
        self.device = device = find_device(options.device)
        self._next_step = options.next_step
        self._views: dict[str, Any] = {}
        self._make_caves(caves, options, engines[0].margin if engines else CONTACT_MARGIN)
        self._make_settings(options, bool(engines))
        self.arrays = make_state(num, self._widths(caves, options), device)
        self.arrays.cave_of.assign(np.asarray(cave_of, dtype=np.int32))
        self.arrays.craft_of.assign(np.asarray(cave_of, dtype=np.int32))
        self._num_starts = np.array([len(cave.scenario.starts) for cave in caves])[np.asarray(cave_of)]
        draws = [CaveStarts(cave.scenario, cave.vehicle, cave.draw_start) for cave in caves if cave.draw_start]
        self._unlisted = UnlistedStarts(draws or None, num, self.as_numpy("extra").shape[1], device)
        self._contacts = make_exchange(num if engines else 0, device)
        self._link = EngineLink(engines, self.arrays, self._contacts) if engines else None
        self._num_slices = _num_slices(num, options.num_threads) if device.is_cpu and not engines else 1
        self._threads = ThreadPoolExecutor(self._num_slices) if self._num_slices > 1 else None
        self._record()
        self._steps_in_order = 0

    def _make_caves(self, caves: Sequence[CaveSetup], options: WorldOptions, margin: float) -> None:
        """Bring the caves, and the vehicles in them, to the device; structures are kept, as they hold the memory."""
        exact = options.rays == "mesh"
        self._cave_parts: list[Cave] = [
            make_cave(cave.scenario, cave.vehicle, cave.task, has_exact_rays=exact, device=self.device)
            for cave in caves
        ]
        self._craft_parts: list[Craft] = [
            make_craft(cave.scenario, cave.vehicle, margin, self.device) for cave in caves
        ]
        self._caves = wp.array(self._cave_parts, dtype=Cave, device=self.device)
        self._crafts = wp.array(self._craft_parts, dtype=Craft, device=self.device)

    def _make_settings(self, options: WorldOptions, has_engine: bool) -> None:
        self._settings = settings = kernels.Settings()
        settings.fan = make_fan(original_pattern(), self.device)
        settings.observation = PRESETS.index(options.observation)
        settings.has_exact_rays, settings.has_engine = int(options.rays == "mesh"), int(has_engine)
        settings.next_step = int(options.next_step)
        settings.action_delay, settings.observation_delay = options.action_delay, options.observation_delay

    def _widths(self, caves: Sequence[CaveSetup], options: WorldOptions) -> dict[str, int]:
        num_rays = self._settings.fan.lengths.shape[0]
        size = {"paper": num_rays + 3, "full": num_rays + 16, "original": 4 * num_rays + 8}[options.observation]
        chains = [len(cave.scenario.guide.panels) for cave in caves if cave.task.progress == "original"]
        return {
            "commands": 3,
            "acting": 3,
            "waiting_commands": 3 * options.action_delay,
            "waiting_observations": size * options.observation_delay,
            "extra": max(cave.starts.extra.shape[1] for cave in self._cave_parts),
            "eddies": max(cave.water.kept.shape[0] for cave in self._cave_parts),
            "touched_panels": max(chains, default=0),
            "rays": num_rays,
            "tags": num_rays if options.observation == PRESETS[int(ORIGINAL)] else 0,
            "observations": size,
            "final_observations": size,
            "terms": NUM_TERMS,
        }

    def reset(
        self,
        seeds: npt.NDArray[np.integer],
        starts: npt.NDArray[np.integer] | None = None,
        conditions: dict[str, Any] | None = None,
    ) -> None:
        """Begin all episodes.

        Args:
            seeds: (N,) of the vehicles' first episodes, from 0 to 2^32 - 1: an episode draws from its own seed alone,
                and the seed of the one after it follows from it.
            starts: (N,) the first episode's; None, or -1, draws them.
            conditions: For names in CONDITIONS, (N,) or (N, 2) values, or one for all; they hold until the next reset.
                What is not named stays.
        """
        first = np.full(self.num, -1) if starts is None else np.asarray(starts)
        if first.shape != (self.num,) or (first >= self._num_starts).any():
            raise InputError(f"The starts must be {self.num} numbers from 0 to {self._num_starts.min() - 1}.")
        for name, values in (conditions or {}).items():
            array = getattr(self.arrays, CONDITIONS[name])
            array.assign(np.broadcast_to(values, array.numpy().shape).astype(array.numpy().dtype))
        self.arrays.seeds.assign(np.asarray(seeds).astype(np.uint32).view(np.int32))
        self.arrays.wanted_starts.assign(first.astype(np.int32))
        self.arrays.episodes.zero_()
        self._unlisted.reset()
        self._unlisted.draw(self.arrays, first < 0, np.asarray(seeds).astype(np.uint32))
        self._run(self._beginning)
        if self._link is not None:
            self._link.forget_restarted()
        self._sort()

    def age(self, decisions: npt.NDArray[np.integer]) -> None:
        """Let time run out (N,) decisions earlier in the episodes that have just begun."""
        self.arrays.ages.assign(decisions.astype(np.int32))

    def retire(self, vehicles: Sequence[int]) -> None:
        """Draw no unlisted starts for these vehicles until the next reset."""
        self._unlisted.retire(vehicles)

    def step(self) -> None:
        """Carry out `arrays.commands`, (N, 3) ballast, steer and thrust in [-1, 1], for one decision."""
        if self._next_step:
            self._draw_starts()
        self._run(self._decision)
        if self._link is not None:
            self._link.forget_restarted()
            while self._link.answer():
                self._run(self._resumption)
            self._run(self._outlook)
        if not self._next_step:
            self._draw_starts()
            self._run(self._succession)
        self._steps_in_order += 1
        if self._steps_in_order == SORT_EVERY:
            self._sort()

    def observe(self) -> None:
        """See from where the vehicles are now, without delay: for vehicles that were put somewhere."""
        self._run(self._looks)

    def _draw_starts(self) -> None:
        """Draw the starts of the episodes that follow those that have ended, where they are in no list."""
        if self._unlisted.is_used:
            has_ended = self.as_numpy("outcomes") > 0
            self._unlisted.draw(self.arrays, has_ended, draw_many(self.as_numpy("seeds").view(np.uint32), NEXT))

    def _sort(self) -> None:
        """Put vehicles that are near each other one after the other: they read the same parts of the field."""
        self._steps_in_order = 0
        if self.num > MIN_SLICE and self.device.is_cpu:
            place = (self.as_numpy("positions") / 2.0).astype(np.int32)
            keys = (*place.T, self.as_numpy("cave_of"))
            self.arrays.order.assign(np.lexsort(keys).astype(np.int32))

    def as_numpy(self, name: str) -> Any:
        """Return an array of `BatchState` as NumPy's: the same memory on the processor, a copy from a GPU."""
        if not self.device.is_cpu:
            return getattr(self.arrays, name).numpy()
        if name not in self._views:
            self._views[name] = getattr(self.arrays, name).numpy()
        return self._views[name]

    def as_torch(self, name: str) -> Any:
        """Return an array of `BatchState` as a torch tensor in the same memory, which changes with each step."""
        return wp.to_torch(getattr(self.arrays, name))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on beside the commands: each array of `BatchState`."""
        return {name: np.array(self.as_numpy(name)) for name in BatchState.vars}  # type: ignore[attr-defined]

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken, also by another batch of as many vehicles in the same task."""
        for name, values in state.items():
            getattr(self.arrays, name).assign(values)

    def close(self) -> None:
        """End the threads, and let go of the contact engines. Closing twice does nothing."""
        if self._link is not None:
            self._link.close()
        if self._threads is not None:
            self._threads.shutdown()

    def _run(self, slices: list[list[Any]]) -> None:
        """Launch the recorded kernels, each slice of the vehicles in a thread of its own: Warp lets go of Python."""
        if self._threads is None:
            _launch(slices[0])
        else:
            list(self._threads.map(_launch, slices))

    def _record(self) -> None:
        """Record the launches of a decision, of what follows ended episodes, of a beginning; for each slice."""
        bounds = np.linspace(0, self.num, self._num_slices + 1).astype(int)
        self._decision: list[list[Any]] = []
        self._resumption: list[list[Any]] = []
        self._outlook: list[list[Any]] = []
        self._succession: list[list[Any]] = []
        self._beginning: list[list[Any]] = []
        self._looks: list[list[Any]] = []
        num_parts = 1 if self.device.is_cpu else PARTS_ON_GPU
        state, caves, crafts, settings = self.arrays, self._caves, self._crafts, self._settings
        for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            num = last - first
            move, resume = (
                self._launch_of(
                    kernels.advance,
                    num,
                    [first, is_answer, state, self._unlisted.starts, caves, crafts, settings, self._contacts],
                )
                for is_answer in (0, 1)
            )
            seen, seen_again = (
                [
                    self._launch_of(
                        kernels.sense, (num, num_parts), [first, again, num_parts, state, caves, crafts, settings]
                    )
                ]
                for again in (0, 1)
            )
            self._looks.append(list(seen))
            if settings.observation_delay > 0:
                seen.append(self._launch_of(kernels.deliver, num, [first, 0, state]))
                seen_again.append(self._launch_of(kernels.deliver, num, [first, 1, state]))
            score = self._launch_of(kernels.score, num, [first, state, caves, settings])
            again, anew = (
                self._launch_of(kernels.restart, num, [first, is_anew, state, self._unlisted.starts, caves, crafts])
                for is_anew in (0, 1)
            )
            if self._link is None:
                self._decision.append([move, *seen, score])
            else:
                self._decision.append([move])
                self._outlook.append([*seen, score])
            self._resumption.append([resume])
            self._succession.append([again, *seen_again])
            self._beginning.append([anew, *seen, score])

    def _launch_of(self, kernel: Any, dim: Any, inputs: list[Any]) -> Any:
        return wp.launch(kernel, dim=dim, inputs=inputs, device=self.device, record_cmd=True)


def _launch(commands: list[Any]) -> None:
    for command in commands:
        command.launch()


def _num_slices(num: int, num_threads: int | None) -> int:
    available = len(os.sched_getaffinity(0)) if num_threads is None else num_threads
    if available < 1:
        raise InputError(f"num_threads must be at least 1, got {num_threads}.")
    return max(1, min(available, num // MIN_SLICE))
