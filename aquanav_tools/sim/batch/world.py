"""All vehicles of a batch: their arrays on a device, and the kernels launched on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.errors import InputError
from aquanav_tools.machine import num_cores
from aquanav_tools.sim.batch import kernels
from aquanav_tools.sim.batch.caves import Cave, make_cave
from aquanav_tools.sim.batch.craft import CONTACT_MARGIN, Craft, make_craft
from aquanav_tools.sim.batch.drawn import DrawnCrafts
from aquanav_tools.sim.batch.engine import ContactEngine, EngineLink
from aquanav_tools.sim.batch.episode import NUM_TERMS
from aquanav_tools.sim.batch.observation import ORIGINAL, PRESETS, make_fan
from aquanav_tools.sim.batch.random import NEXT, draw_many
from aquanav_tools.sim.batch.runtime import find_device, launch_kernel, run_slices, sequence
from aquanav_tools.sim.batch.sensors.fan_spec import PRESET_FANS
from aquanav_tools.sim.batch.setup import CaveSetup, WorldOptions
from aquanav_tools.sim.batch.starts import CaveStarts, UnlistedStarts
from aquanav_tools.sim.batch.state import BatchState, make_exchange, make_state
from aquanav_tools.sim.batch.table import StructTable
from aquanav_tools.sim.randomisation import Randomisation

MAX_VEHICLES = 1 << 20
"""Chosen; 2 GB."""
PARTS_ON_GPU = 4
"""Threads that share the rays of a vehicle."""
MIN_SLICE = 256
"""Vehicles for which a further thread is worth its start."""
SORT_EVERY = 32
"""Decisions after which vehicles are put in order of place again: about a metre's way."""
CONDITIONS = {"sensor_noise": "ray_noise", "sensor_dropout": "ray_dropout", "current_range": "current_ranges"}
"""Options of the task that each episode may have of its own, and the arrays that hold them."""


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
        ranges = options.randomisation
        most = (0, 0) if ranges is None else ranges.most_delays()
        self._delays = (max(options.action_delay, most[0]), max(options.observation_delay, most[1]))
        self._make_settings(options, bool(engines))
        self.arrays = make_state(num, self._widths(caves, options), device)
        self._options = options
        self.arrays.cave_of.assign(np.asarray(cave_of, dtype=np.int32))
        self._make_bodies(caves, np.asarray(cave_of), ranges)
        self._num_starts = np.array([len(cave.scenario.starts) for cave in caves])
        draws = [CaveStarts(cave.scenario, cave.vehicle, cave.draw_start) for cave in caves if cave.draw_start]
        self._unlisted = UnlistedStarts(draws or None, num, self.as_numpy("extra").shape[1], device)
        is_linked = bool(engines) or options.law is not None
        self._contacts = make_exchange(num if is_linked else 0, device)
        self._link = EngineLink(engines, options.law, self.arrays, self._contacts) if is_linked else None
        self.num_slices = _num_slices(num, options.num_threads) if device.is_cpu and not is_linked else 1
        self._threads = ThreadPoolExecutor(self.num_slices) if self.num_slices > 1 else None
        settings = self._settings
        settings.caves, settings.vehicles = self.caves.array, self._crafts.array
        settings.crafts = self._crafts.array if self._drawn_crafts is None else self._drawn_crafts.array
        settings.has_own_crafts = int(self._drawn_crafts is not None)
        settings.unlisted = self._unlisted.starts
        self._record()
        self._steps_in_order = 0

    def _make_caves(self, caves: Sequence[CaveSetup], options: WorldOptions, margin: float) -> None:
        """Bring the caves, and the vehicles in them, to the device; structures are kept, as they hold the memory."""
        self._margin = margin
        made = {id(cave): self._made(cave, options) for cave in dict.fromkeys(caves)}
        self.caves = StructTable(Cave, [made[id(cave)][0] for cave in caves], self.device)
        """What is on the device of each cave."""
        self._crafts = StructTable(Craft, [made[id(cave)][1] for cave in caves], self.device)

    def _made(self, cave: CaveSetup, options: WorldOptions) -> tuple[Cave, Craft]:
        """Return a cave, and the vehicle in it, on the device."""
        exact = options.rays == "mesh"
        return (
            make_cave(cave.scenario, cave.vehicle, cave.task, has_exact_rays=exact, device=self.device),
            make_craft(cave.scenario, cave.vehicle, self._margin, self.device),
        )

    def replace_cave(self, index: int, cave: CaveSetup) -> None:
        """Put another cave in the place of one that no vehicle is in; see `move`.

        Raises:
            InputError: the arrays of this batch have no room for what the cave needs of each vehicle.
        """
        found, craft = self._made(cave, self._options)
        needed = {"extra": found.starts.extra.shape[1], "eddies": found.water.kept.shape[0]}
        if cave.task.progress == "original":
            needed["touched_panels"] = len(cave.scenario.guide.panels)
        for name, width in needed.items():
            room = getattr(self.arrays, name).shape[1]
            if width > room:
                raise InputError(
                    f"{cave.scenario.name} needs {width} values of {name} for each vehicle, and the caves that the "
                    f"batch began with {room}. Begin with a cave like it."
                )
        self.caves.put(index, found)
        self._crafts.put(index, craft)
        self._num_starts[index] = len(cave.scenario.starts)
        if cave.draw_start is not None:
            self._unlisted.put(index, CaveStarts(cave.scenario, cave.vehicle, cave.draw_start))
        if self._drawn_crafts is not None:
            self._drawn_crafts.put(index, (cave.scenario, cave.vehicle), craft)

    def move(self, vehicles: npt.NDArray[np.integer], caves: npt.NDArray[np.integer]) -> None:
        """Let the next episodes of (n,) vehicles, whose episodes have just ended, begin in (n,) caves."""
        for name in ["cave_of"] if self._drawn_crafts is not None else ["cave_of", "craft_of"]:
            values = np.array(self.as_numpy(name))
            values[vehicles] = caves
            self.write(name, values)
        if self._drawn_crafts is not None:
            self._drawn_crafts.move(vehicles, caves)

    def _make_bodies(
        self, caves: Sequence[CaveSetup], cave_of: npt.NDArray[np.integer], ranges: Randomisation | None
    ) -> None:
        """Give each vehicle its cave's body, or one of its own that is drawn for each episode."""
        self._drawn_crafts: DrawnCrafts | None = None
        self.arrays.craft_of.assign(cave_of.astype(np.int32))
        self.arrays.ray_gain.fill_(1.0)
        self.arrays.action_delays.fill_(self._options.action_delay)
        self.arrays.observation_delays.fill_(self._options.observation_delay)
        if ranges is not None:
            pairs = [(cave.scenario, cave.vehicle) for cave in caves]
            self._drawn_crafts = DrawnCrafts(pairs, cave_of, self._crafts.rows, ranges, self.device)
            self.arrays.craft_of.assign(np.arange(self.num, dtype=np.int32))

    @property
    def dynamics(self) -> dict[str, npt.NDArray[np.float64]]:
        """(N,) what the episodes have drawn of their vehicles' dynamics, by name; nothing without a randomisation."""
        return {} if self._drawn_crafts is None else self._drawn_crafts.by_name

    def _draw_bodies(self, vehicles: npt.NDArray[np.integer], seeds: npt.NDArray[np.uint32]) -> None:
        """Draw the bodies of (n,) vehicles for the episodes with (n,) seeds."""
        if self._drawn_crafts is not None:
            self._drawn_crafts.draw(vehicles, seeds)
            self._drawn_crafts.write_sensing(self.arrays, vehicles)

    def _make_settings(self, options: WorldOptions, has_engine: bool) -> None:
        self._settings = settings = kernels.Settings()
        settings.fan = make_fan(PRESET_FANS[options.observation].pattern, self.device)
        settings.observation = PRESETS.index(options.observation)
        settings.has_engine = int(has_engine)
        settings.next_step, settings.has_law = int(options.next_step), int(options.law is not None)
        settings.has_delayed_actions = int(self._delays[0] > 0)

    def _widths(self, caves: Sequence[CaveSetup], options: WorldOptions) -> dict[str, int]:
        num_rays = self._settings.fan.lengths.shape[0]
        size = {"paper": num_rays + 3, "full": num_rays + 16, "original": 4 * num_rays + 8}[options.observation]
        chains = [len(cave.scenario.guide.panels) for cave in caves if cave.task.progress == "original"]
        return {
            "commands": 3,
            "acting": 3,
            "waiting_commands": 3 * self._delays[0],
            "waiting_observations": size * self._delays[1],
            "extra": max(cave.starts.extra.shape[1] for cave in self.caves.rows),
            "eddies": max(cave.water.kept.shape[0] for cave in self.caves.rows),
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
        num_starts = self._num_starts[self.as_numpy("cave_of")]
        if first.shape != (self.num,) or (first >= num_starts).any():
            raise InputError(f"The starts must be {self.num} numbers from 0 to {num_starts.min() - 1}.")
        for name, values in (conditions or {}).items():
            self.write(CONDITIONS[name], values)
        self.write("seeds", np.asarray(seeds).astype(np.uint32).view(np.int32))
        self.write("wanted_starts", first)
        self.write("episodes", 0)
        self._unlisted.reset()
        drawn, every = np.flatnonzero(first < 0), np.arange(self.num)
        self._unlisted.draw(self.arrays, drawn, np.asarray(seeds).astype(np.uint32)[drawn])
        self._draw_bodies(every, np.asarray(seeds).astype(np.uint32))
        run_slices(self._beginning, self._threads)
        if self._link is not None:
            self._link.forget_restarted()
        self._sort()

    def age(self, decisions: npt.NDArray[np.integer]) -> None:
        """Let time run out (N,) decisions earlier in the episodes that have just begun."""
        self.arrays.ages.assign(decisions.astype(np.int32))

    def retire(self, vehicles: Sequence[int]) -> None:
        """Draw no unlisted starts for these vehicles until the next reset."""
        self._unlisted.retire(vehicles)

    def step(self, judge: Callable[[], None] | None = None) -> None:
        """Carry out `arrays.commands`, (N, 3) ballast, steer and thrust in [-1, 1], for one decision.

        Args:
            judge: Called when the decision is over, before ended episodes are followed by others in the same step.
        """
        if self._next_step:
            self._draw_successors()
        run_slices(self._decision, self._threads)
        if self._link is not None:
            self._link.forget_restarted()
            while self._link.answer():
                run_slices(self._resumption, self._threads)
            run_slices(self._outlook, self._threads)
        if judge is not None:
            judge()
        if not self._next_step:
            self._draw_successors()
            run_slices(self._succession, self._threads)
        self._steps_in_order += 1
        if self._steps_in_order == SORT_EVERY:
            self._sort()

    def observe(self) -> None:
        """See from where the vehicles are now, without delay: for vehicles that were put somewhere."""
        run_slices(self._looks, self._threads)

    def _draw_successors(self) -> None:
        """Draw what the host draws of the episodes that follow those that have ended: bodies, and unlisted starts."""
        if not self._unlisted.is_used and self._drawn_crafts is None:
            return
        ended = np.flatnonzero(self.as_numpy("outcomes"))
        if len(ended) == 0:
            return
        if self._unlisted.is_used:
            self._unlisted.draw(self.arrays, ended, draw_many(self.as_numpy("seeds").view(np.uint32)[ended], NEXT))
        if self._drawn_crafts is not None:
            self._drawn_crafts.draw_successors(ended)
            self._drawn_crafts.write_sensing(self.arrays, ended)

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

    def write(self, name: str, values: Any) -> None:
        """Change an array of `BatchState`, to values for all vehicles or one for each."""
        if self.device.is_cpu:
            self.as_numpy(name)[...] = values  # in a microsecond, where `assign` takes 20
        else:
            array, host = getattr(self.arrays, name), self.as_numpy(name)
            array.assign(np.broadcast_to(values, host.shape).astype(host.dtype))

    @property
    def launched_on(self) -> tuple[BatchState, Any, Any]:
        """What kernels beside a step's read: the vehicles, the caves and the vehicles' bodies."""
        return self.arrays, self._settings.caves, self._settings.crafts

    @property
    def has_moved(self) -> npt.NDArray[np.bool_]:
        """(N,) whether the step was a decision of an episode, not its beginning."""
        has_moved: npt.NDArray[np.bool_] = self.as_numpy("restarted") == 0
        return has_moved

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
        if self._drawn_crafts is not None:
            self._drawn_crafts.move(np.arange(self.num), self.as_numpy("cave_of"))
        self._draw_bodies(np.arange(self.num), self.as_numpy("seeds").view(np.uint32))

    def close(self) -> None:
        """End the threads, and let go of the contact engines. Closing twice does nothing."""
        if self._link is not None:
            self._link.close()
        if self._threads is not None:
            self._threads.shutdown()

    def _record(self) -> None:
        """Record the launches of a decision, of what follows ended episodes, of a beginning; for each slice."""
        bounds = np.linspace(0, self.num, self.num_slices + 1).astype(int)
        self._decision: list[Callable[[], None]] = []
        self._resumption: list[Callable[[], None]] = []
        self._outlook: list[Callable[[], None]] = []
        self._succession: list[Callable[[], None]] = []
        self._beginning: list[Callable[[], None]] = []
        self._looks: list[Callable[[], None]] = []
        self.launches: list[list[Any]] = []
        """Of each slice, the kernels of a decision, one by one: for measuring them."""
        num_parts = 1 if self.device.is_cpu else PARTS_ON_GPU
        state, settings = self.arrays, self._settings
        for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            num = last - first
            move, resume = (
                self._launch_of(kernels.advance, num, [first, is_answer, state, settings, self._contacts])
                for is_answer in (0, 1)
            )
            seen, seen_again = (
                [self._launch_of(kernels.sense, (num, num_parts), [first, again, num_parts, state, settings])]
                for again in (0, 1)
            )
            self._looks.append(sequence(seen[:], self.device))
            if self._delays[1] > 0:
                seen.append(self._launch_of(kernels.deliver, num, [first, 0, state]))
                seen_again.append(self._launch_of(kernels.deliver, num, [first, 1, state]))
            score = self._launch_of(kernels.score, num, [first, state, settings])
            again, anew = (
                self._launch_of(kernels.restart, num, [first, is_anew, state, settings]) for is_anew in (0, 1)
            )
            self.launches.append([move, *seen, score])
            if self._link is None:
                self._decision.append(sequence(self.launches[-1], self.device))
            else:
                self._decision.append(sequence([move], self.device))
                self._outlook.append(sequence([*seen, score], self.device))
                self._resumption.append(sequence([resume], self.device))
            self._succession.append(sequence([again, *seen_again], self.device))
            self._beginning.append(sequence([anew, *seen, score], self.device))

    def _launch_of(self, kernel: Any, dim: Any, inputs: list[Any]) -> Any:
        return launch_kernel(kernel, dim=dim, inputs=inputs, device=self.device, record_cmd=True)


def _num_slices(num: int, num_threads: int | None) -> int:
    available = num_cores() if num_threads is None else num_threads
    if available < 1:
        raise InputError(f"num_threads must be at least 1, got {num_threads}.")
    return max(1, min(available, num // MIN_SLICE))
