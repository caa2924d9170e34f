"""All vehicles of a batch: their arrays on a device, and the kernels launched on them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch import kernels
from aquanav_tools.sim.batch.field import make_grid
from aquanav_tools.sim.batch.fleet_arrays import (
    Beginnings,
    Fans,
    Fleet,
    TaskNumbers,
    make_craft,
    make_rules,
    make_starts,
)
from aquanav_tools.sim.batch.progress import make_measure
from aquanav_tools.sim.batch.random import NEXT, draw_many
from aquanav_tools.sim.batch.runtime import find_device
from aquanav_tools.sim.batch.starts import DrawStart, UnlistedStarts
from aquanav_tools.sim.batch.water import make_water
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.sim.water import Water
from aquanav_tools.types import Array, Mesh

RaySource = Literal["field", "mesh"]
MAX_VEHICLES = 1 << 20
"""Chosen; 2 GB."""
PARTS_ON_GPU = 4
"""Threads that share the rays of a vehicle."""
MIN_SLICE = 256
"""Vehicles for which a further thread is worth its start."""
SORT_EVERY = 32
"""Decisions after which vehicles are put in order of place again: about a metre's way."""


class BatchWorld:
    """N vehicles in one cave. Each step is a decision of every vehicle; ended episodes are followed by new ones.

    The arrays in `fleet` are Warp's, on `device`; `as_numpy` and `as_torch` show them without a copy.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        task: TaskNumbers,
        num: int,
        *,
        water: Water,
        current_range: tuple[float, float] = (1.0, 1.0),
        rays: RaySource = "field",
        next_step: bool = True,
        device: str = "cpu",
        num_threads: int | None = None,
        draw_start: DrawStart | None = None,
    ) -> None:
        """Upload a scenario and make room for `num` vehicles; call `reset` next.

        Args:
            scenario: The cave.
            vehicle: Moves and collides as all of them do.
            task: What is observed and paid for, and when episodes end.
            num: Number of vehicles.
            water: Its currents and waves; each vehicle has gusts and eddies of its own.
            current_range: Between which each episode draws its share of the water's velocity.
            rays: Traced through the distance field, or cast exactly against the mesh.
            next_step: Whether an ended episode's successor begins at the next step (its command is not used then), or
                in the same one.
            device: "cpu", "cuda" or "cuda:0".
            num_threads: On the processor; None takes as many as the process may use.
            draw_start: Returns the start of the episode with a seed; None draws from the scenario's list.

        Raises:
            InputError: no such device, or a senseless number.
        """
        if not 1 <= num <= MAX_VEHICLES:
            raise InputError(f"A batch must have 1 to {MAX_VEHICLES} vehicles, got {num}.")
        self.num = num
        self.device = find_device(device)
        self._next_step = next_step
        self._num_starts = len(scenario.starts)
        middle = scenario.cavity.mesh.vertices.mean(axis=0)
        self._ray_mesh = _upload(scenario.cavity.mesh, middle, self.device) if rays == "mesh" else None
        self._wall = _upload(scenario.collision, middle, self.device)
        self._craft = make_craft(scenario, vehicle, self.device)
        states = np.array([vehicle.state_at(start.pose) for start in scenario.starts])
        self._beginnings = Beginnings()
        self._beginnings.listed = listed = make_starts(states, scenario, self.device)
        self._unlisted = UnlistedStarts(scenario, vehicle, draw_start, num, listed, self.device)
        self._beginnings.unlisted = self._unlisted.starts
        self._rules = make_rules(task, scenario, next_step, self.device)
        self._grid = make_grid(scenario.field, self.device)
        self._fans, self._middle = _make_fans(rays, self.device), wp.vec3d(*middle)
        limits = scenario.settings.limits
        self._water = make_water(water, current_range, limits.dt * limits.substeps, self.device)
        widths = {
            "extra": listed.extra.shape[1],
            "eddies": self._water.kept.shape[0],
            "waiting_commands": 3 * task.action_delay,
            "waiting_observations": task.size * task.observation_delay,
            "touched_panels": len(scenario.guide.panels) if task.progress == "original" else 0,
        }
        self.fleet = fleet = _make_fleet(num, task.size, widths, self.device)
        self._measure = make_measure(
            task.progress, scenario, vehicle.capsule, fleet.panels_crossed, fleet.touched_panels, self.device
        )
        self._num_slices = _num_slices(num, num_threads) if self.device.is_cpu else 1
        self._threads = ThreadPoolExecutor(self._num_slices) if self._num_slices > 1 else None
        self._decision, self._succession, self._beginning = self._record()
        self._steps_in_order = 0

    def reset(self, seeds: npt.NDArray[np.integer], starts: npt.NDArray[np.int32] | None = None) -> None:
        """Begin all episodes.

        Args:
            seeds: (N,) of the vehicles' first episodes, from 0 to 2^32 - 1: an episode draws from its own seed alone,
                and the seed of the one after it follows from it.
            starts: (N,) the first episode's; None draws them.
        """
        first = np.full(self.num, -1) if starts is None else np.asarray(starts)
        if first.shape != (self.num,) or first.max() >= self._num_starts:
            raise InputError(f"The starts must be {self.num} numbers from 0 to {self._num_starts - 1}.")
        self.fleet.seeds.assign(np.asarray(seeds).astype(np.uint32).view(np.int32))
        self.fleet.wanted_starts.assign(first.astype(np.int32))
        self.fleet.episodes.zero_()
        self._unlisted.reset()
        self._unlisted.draw(self.fleet, first < 0, np.asarray(seeds).astype(np.uint32))
        self._run(self._beginning)
        self._sort()

    def age(self, decisions: npt.NDArray[np.integer]) -> None:
        """Let time run out (N,) decisions earlier in the episodes that have just begun."""
        self.fleet.ages.assign(decisions.astype(np.int32))

    def rest(self, vehicles: Sequence[int]) -> None:
        """Draw no unlisted starts for these vehicles until the next reset."""
        self._unlisted.rest(vehicles)

    def step(self, judge: Callable[[], None] | None = None) -> None:
        """Carry out `fleet.commands`, (N, 3) ballast, steer and thrust in [-1, 1], for one decision.

        `judge` is called when it is done, and no successor of an ended episode has begun in the same step.
        """
        if self._next_step:
            self._draw_starts()
        self._run(self._decision)
        if judge is not None:
            judge()
        if not self._next_step:
            self._draw_starts()
            self._run(self._succession)
        self._steps_in_order += 1
        if self._steps_in_order == SORT_EVERY:
            self._sort()

    def _draw_starts(self) -> None:
        """Draw the starts of the episodes that follow those that have ended, where they are in no list."""
        if self._unlisted.is_used:
            has_ended = self.as_numpy("outcomes") > 0
            self._unlisted.draw(self.fleet, has_ended, draw_many(self.as_numpy("seeds").view(np.uint32), NEXT))

    def _sort(self) -> None:
        """Put vehicles that are near each other one after the other: they read the same parts of the field."""
        self._steps_in_order = 0
        if self.num > MIN_SLICE and self.device.is_cpu:
            place = (self.as_numpy("positions") / 2.0).astype(np.int32)
            self.fleet.order.assign(np.lexsort(place.T).astype(np.int32))

    def as_numpy(self, name: str) -> Any:
        """Return an array of `Fleet` as NumPy's: the same memory on the processor, a copy from a GPU."""
        return getattr(self.fleet, name).numpy()

    def write(self, name: str, values: npt.NDArray[Any]) -> None:
        """Change an array of `Fleet`."""
        getattr(self.fleet, name).assign(values)

    def as_torch(self, name: str) -> Any:
        """Return an array of `Fleet` as a torch tensor in the same memory, which changes with each step."""
        return wp.to_torch(getattr(self.fleet, name))

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on beside the commands: an array for each field of `Fleet`."""
        return {name: np.array(self.as_numpy(name)) for name in Fleet.vars}  # type: ignore[attr-defined]

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken, also by another batch of as many vehicles in the same task."""
        for name, values in state.items():
            getattr(self.fleet, name).assign(values)

    def close(self) -> None:
        """End the threads. Closing twice does nothing."""
        if self._threads is not None:
            self._threads.shutdown()

    def _run(self, slices: list[list[Any]]) -> None:
        """Launch the recorded kernels, each slice of the vehicles in a thread of its own: Warp lets go of Python."""
        if self._threads is None:
            _launch(slices[0])
        else:
            list(self._threads.map(_launch, slices))

    def _record(self) -> tuple[list[list[Any]], list[list[Any]], list[list[Any]]]:
        """Return the launches of a decision, of what follows ended episodes, of a beginning; for each slice."""
        bounds = np.linspace(0, self.num, self._num_slices + 1).astype(int)
        decision, succession, beginning = [], [], []
        wall, rays = self._wall.id, self._wall.id if self._ray_mesh is None else self._ray_mesh.id
        num_parts = 1 if self.device.is_cpu else PARTS_ON_GPU
        fleet, craft, rules, grid = self.fleet, self._craft, self._rules, self._grid
        beginnings, water, measure = self._beginnings, self._water, self._measure

        for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            num = last - first
            where = [first, fleet, beginnings, craft, water, rules, grid, measure, wall, self._middle]
            view = [fleet, craft, rules, grid, self._fans, rays, self._middle]
            move = self._launch_of(kernels.move, num, where)
            sense = self._launch_of(kernels.sense, (num, num_parts), [first, 0, num_parts, *view])
            score = self._launch_of(kernels.score, num, [first, fleet, rules, self._fans])
            anew = self._launch_of(kernels.restart, num, [first, 1, fleet, beginnings, craft, water, measure])
            again = self._launch_of(kernels.restart, num, [first, 0, fleet, beginnings, craft, water, measure])
            look_again = self._launch_of(kernels.sense, (num, num_parts), [first, 1, num_parts, *view])
            seen, seen_again = ([look] for look in (sense, look_again))
            if rules.disturbance.observation_delay > 0:
                seen.append(self._launch_of(kernels.deliver, num, [first, 0, fleet]))
                seen_again.append(self._launch_of(kernels.deliver, num, [first, 1, fleet]))
            decision.append([move, *seen, score])
            succession.append([again, *seen_again])
            beginning.append([anew, *seen, score])
        return decision, succession, beginning

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


def _upload(mesh: Mesh, middle: Array, device: Any) -> Any:
    """Return a mesh on a device, moved so that `middle` is at the origin: Warp's meshes are in float32."""
    points = wp.array((mesh.vertices - middle).astype(np.float32), dtype=wp.vec3, device=device)
    return wp.Mesh(points, wp.array(mesh.faces.ravel().astype(np.int32), dtype=wp.int32, device=device))


def _make_fans(rays: RaySource, device: Any) -> Fans:
    fans, pattern = Fans(), original_pattern()
    fans.directions = wp.array(pattern.directions.astype(np.float32), dtype=wp.vec3, device=device)
    fans.lengths = wp.array(pattern.lengths.astype(np.float32), dtype=wp.float32, device=device)
    fans.exact = int(rays == "mesh")
    return fans


def _make_fleet(num: int, size: int, widths: dict[str, int], device: Any) -> Fleet:
    """Return the arrays of N vehicles; `widths` are those of what depends on the vehicle's model and the water."""
    fleet = Fleet()
    fixed = {"commands": 3, "acting": 3, "rays": 28, "terms": 7}
    shapes = {name: (num, n) for name, n in (fixed | widths).items()}
    shapes |= {"observations": (num, size), "final_observations": (num, size)}
    for name, field in Fleet.vars.items():  # type: ignore[attr-defined]  # Warp makes the class a struct
        array = wp.zeros(shapes.get(name, (num,)), dtype=field.type.dtype, device=device)
        setattr(fleet, name, array)
    fleet.order.assign(np.arange(num, dtype=np.int32))
    return fleet
